"""Approximate a light by directions, as many as the lobe of a given roughness needs."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from malus.reconstruct.observation import Inapplicable
from malus.scenes.core.arrays import Float64Array
from malus.scenes.lights.environment import directions, light_shares, radiance_map
from malus.scenes.lights.lights import Area, Distant, Light, MapLight
from malus.scenes.lights.sky import parts

NODES_A_LOBE = 3.0
"""Directions of an environment across one roughness; it has 32 rows at least.

A Gaussian lobe of facets needs no more; but across the plane of reflection half vectors turn
1/(2 cos γ) as fast as the light, so that towards the rim the lobe is narrower among directions of
light. Against the integral under uniform light at α = 0.15, ρ is off by 2e-4 up to a zenith angle
of 30°, 2e-3 up to 60°, 7e-3 up to 75° and by up to 9e-2 at the rim; with twice as many directions
across, by a fifth of that.
"""

_ROWS = 512
"""Rows of directions of uniform light."""


@dataclass(frozen=True, eq=False)
class Directions:
    """Quadrature of a light over directions.

    Attributes
    ----------
    toward : (K, 3)
        Unit vectors towards the light, in the image frame.
    power : (K,)
        Radiance times solid angle of each.
    """

    toward: Float64Array
    power: Float64Array

    @functools.cached_property
    def half(self) -> Float64Array:
        """Half vectors (K, 3) of each direction and the viewer on +z."""
        summed = self.toward + np.array([0.0, 0.0, 1.0])
        result: Float64Array = summed / np.linalg.norm(summed, axis=-1, keepdims=True)
        return result


@functools.lru_cache(maxsize=8)
def quadrature(light: Light, alpha: float) -> Directions:
    """Directions of a light, fine enough for lobes of roughness `alpha`.

    Raises
    ------
    Inapplicable
        Where the lobe is narrower than the directions of a map, or of uniform light, stand apart.

    Examples
    --------
    >>> lamp = quadrature(Area(incidence_deg=0, half_angle_deg=60, radiance=1), alpha=0.3)
    >>> round(float(lamp.power.sum()) / math.pi, 9)
    1.0
    """
    several = parts(light)
    if len(several) > 1:
        pieces = [quadrature(part, alpha) for part in several]
        return Directions(
            np.concatenate([piece.toward for piece in pieces]),
            np.concatenate([piece.power for piece in pieces]),
        )
    if isinstance(light, Distant):
        return Directions(np.array([light.direction]), np.array([light.irradiance]))
    if isinstance(light, Area):
        return _cone(light, alpha)
    if isinstance(light, MapLight):
        # From every camera of an orbit a light is turned otherwise, and its map is the same.
        values = radiance_map(light.unturned).astype(np.float64)
        _check_lobe(alpha, len(values))
        return _sphere(values, alpha, light.rotation)
    _check_lobe(alpha, _ROWS)
    return _sphere(np.full((_ROWS, 2 * _ROWS), light.radiance), alpha)


def _check_lobe(alpha: float, rows: int) -> None:
    """Refuse lobes that pass between the rows of directions of a light from everywhere."""
    smallest = math.pi / (2.0 * rows)
    if alpha < smallest:
        told = f"roughness {alpha:g}: lobes pass between the {rows} rows of directions of the light"
        raise Inapplicable(f"{told}, which are fine enough from {smallest:.2g}")


def _cone(light: Area, alpha: float) -> Directions:
    """Directions in a cone: Gauss-Legendre in the cosine, equal steps about its axis."""
    half_angle = math.radians(light.half_angle_deg)
    rings = 4 + math.ceil(NODES_A_LOBE * half_angle / (2.0 * alpha))
    sectors = 4 * rings
    x, w = np.polynomial.legendre.leggauss(rings)
    span = 1.0 - math.cos(half_angle)
    cosine = 1.0 - 0.5 * span * (1.0 + x)
    turn = (np.arange(sectors) + 0.5) * (2.0 * math.pi / sectors)
    sine = np.sqrt(1.0 - cosine**2)[:, None]
    flat = np.broadcast_to(cosine[:, None], (rings, sectors))
    local = np.stack([sine * np.cos(turn), sine * np.sin(turn), flat], axis=-1).reshape(-1, 3)
    power = np.repeat(0.5 * span * w * (2.0 * math.pi / sectors), sectors)
    return Directions(local @ _frame(light.direction), power * light.radiance)


def _frame(axis: tuple[float, float, float]) -> Float64Array:
    """Matrix (3, 3) whose rows are an orthonormal basis, the axis its third vector."""
    third = np.array(axis)
    helper = np.eye(3)[np.argmin(np.abs(third))]
    first = np.cross(helper, third)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third])


def _sphere(values: Float64Array, alpha: float, rotation: Float64Array | None = None) -> Directions:
    """Directions of a map (height, width) of radiance, summed in blocks as fine as the lobe needs.

    A block shines from the centroid of its light, so that a sun in it stays where it is.
    """
    height, width = values.shape
    least_rows = max(math.pi * NODES_A_LOBE / (2.0 * alpha), 32.0)
    step = max(1, int(height / least_rows))  # the last block of a map may be shorter
    rows, columns = np.arange(0, height, step), np.arange(0, width, step)
    weight = light_shares(height, width) * values

    def summed(plane: Float64Array) -> Float64Array:
        return np.add.reduceat(np.add.reduceat(plane, rows, axis=0), columns, axis=1).ravel()

    pixels = directions(height, width, rotation)
    power = summed(weight)
    toward = np.stack([summed(weight * pixels[..., axis]) for axis in range(3)], axis=-1)[power > 0]
    power = power[power > 0]
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    # No facet mirrors light from straight behind the object to the viewer.
    visible = toward[:, 2] > -1.0 + 1e-9
    return Directions(toward[visible], power[visible])
