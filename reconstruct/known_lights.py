"""Which facets mirror a known light to the viewer, and how the light is polarised thereby.

For an orthographic viewer the facet that mirrors a direction ω has the half vector H of ω and V
for its normal, whatever the pixel: Fresnel's reflectances and the plane of reflection belong to
the direction. A pixel only decides how many facets stand that way. Its Stokes vector is therefore
a sum over directions,

    s(N) ∝ Σ_ω D(N·H_ω) G1(N·ω) · L(ω) ΔΩ (½(F_⊥ + F_∥), −½(F_⊥ − F_∥) cos 2φ_H, … sin 2φ_H),

one matrix product for all pixels and bands. D is Beckmann's distribution, G1 Smith's shadowing;
the viewer's masking and the factor 1/(4 N·V) are common to all directions and cancel in s/s0.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.block import Block, below_one
from malus.reconstruct.fresnel import reflectances
from malus.reconstruct.lobes import BlockModel, Polarisation, one_alpha, one_index
from malus.reconstruct.observation import Image, Inapplicable, Observation
from malus.scenes.environment import directions, radiance_map, solid_angles
from malus.scenes.lights import Area, Distant, Environment, Light

Floats = NDArray[np.float64]

NODES_A_LOBE = 3.0
"""Directions of an environment across one roughness: the lobe is Gaussian, so that three already
give 1e-4; the test halves the spacing and compares."""

BLOCK = 1 << 24
"""Largest number of pixel-direction pairs in memory at once."""

DARK = 1e-30
"""Mirrored light below this share of the brightest direction is none: nearer to the smallest
float32 its polarisation would be rounding."""


@dataclass(frozen=True, eq=False)
class Directions:
    """Quadrature of the light over directions: unit vectors (K, 3) and radiance · ΔΩ (K,)."""

    toward: Floats
    power: Floats

    @functools.cached_property
    def half(self) -> Floats:
        """Half vectors (K, 3) of each direction and the viewer on +z."""
        summed = self.toward + np.array([0.0, 0.0, 1.0])
        result: Floats = summed / np.linalg.norm(summed, axis=-1, keepdims=True)
        return result


@functools.lru_cache(maxsize=8)
def quadrature(light: Light, alpha: float) -> Directions:
    """Directions of a light, fine enough for lobes of roughness `alpha`.

    Examples
    --------
    >>> lamp = quadrature(Area(incidence_deg=0, half_angle_deg=60, radiance=1), alpha=0.3)
    >>> round(float(lamp.power.sum()) / math.pi, 9)
    1.0
    """
    if isinstance(light, Distant):
        return Directions(np.array([light.direction]), np.array([light.irradiance]))
    if isinstance(light, Area):
        return _cone(light, alpha)
    if isinstance(light, Environment):
        return _sphere(radiance_map(light).astype(np.float64), alpha, light.turn_deg)
    return _sphere(np.full((512, 1024), light.radiance), alpha)


def _cone(light: Area, alpha: float) -> Directions:
    """Gauss-Legendre in the cosine, equal steps in the angle about the axis."""
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


def _frame(axis: tuple[float, float, float]) -> Floats:
    """Rows are an orthonormal basis whose third vector is the axis."""
    third = np.array(axis)
    helper = np.eye(3)[np.argmin(np.abs(third))]
    first = np.cross(helper, third)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third])


def _sphere(values: Floats, alpha: float, turn_deg: float = 0.0) -> Directions:
    """All directions: a map's pixels averaged over blocks as small as the lobe asks for."""
    wanted = math.pi * NODES_A_LOBE / (2.0 * alpha)
    step = max(1, int(values.shape[0] / max(wanted, 32.0)))
    height, width = values.shape[0] // step, values.shape[1] // step
    weight = solid_angles(*values.shape) * values
    cut = weight[: height * step, : width * step]
    power = cut.reshape(height, step, width, step).sum(axis=(1, 3)).ravel()
    toward = directions(height, width, turn_deg).reshape(-1, 3)
    lit = (power > 0) & (toward[:, 2] > -1.0 + 1e-9)  # straight behind mirrors nothing to V
    return Directions(toward[lit], power[lit])


def known_lights(observation: Observation) -> BlockModel:
    """The lobe model: light mirrored by the facets that stand right for each direction."""
    light = observation.require("light")
    observation.require("normals")
    if observation.view is not None:
        raise Inapplicable("needs an orthographic camera")
    alpha = one_alpha(observation)
    eta = np.array(one_index(observation))
    lamp = quadrature(light, alpha)
    stokes = _mirrored(lamp, eta)

    def model(block: Block) -> Polarisation:
        seen = block.observation.mask & block.valid
        normals = np.stack([plane[seen] for plane in block.normal], axis=-1)
        summed = _gather(normals, lamp, alpha, stokes)
        summed = summed.reshape(len(summed), len(eta), 3)
        dark = summed[..., 0] < DARK
        # Rounding must not lift a degree of polarisation above one.
        total = np.where(dark, np.inf, summed[..., 0] / below_one(summed.dtype))
        planes = np.zeros((2, len(eta), *seen.shape), dtype=block.dtype)
        for component, plane in enumerate(planes, start=1):
            plane[:, seen] = (summed[..., component] / total).T
        one = np.ones((), dtype=block.dtype)
        return Polarisation([one] * len(eta), list(planes[0]), list(planes[1]))

    return model


def _mirrored(lamp: Directions, eta: Floats) -> NDArray[np.float32]:
    """What a facet makes of each direction, (K, bands · 3)."""
    perpendicular, parallel = reflectances(np.clip(lamp.half[:, 2:], 0.0, 1.0), eta[None, :])
    x, y = lamp.half[:, 0], lamp.half[:, 1]
    squared = np.where(x * x + y * y > 0, x * x + y * y, 1.0)
    cos2, sin2 = (x * x - y * y) / squared, 2 * x * y / squared
    difference = perpendicular - parallel
    stokes = np.stack(
        [perpendicular + parallel, -difference * cos2[:, None], -difference * sin2[:, None]],
        axis=-1,
    )
    scaled = stokes * (lamp.power / lamp.power.max())[:, None, None]
    return scaled.reshape(len(x), -1).astype(np.float32)


def _gather(
    normals: Image, lamp: Directions, alpha: float, stokes: NDArray[np.float32]
) -> NDArray[np.float32]:
    block = max(1, BLOCK // len(lamp.power))
    if len(normals) <= block:
        weights = _cached_weights(_Same(normals), lamp, alpha)
        result: NDArray[np.float32] = weights @ stokes
        return result
    parts = [
        _weights(normals[i : i + block], lamp, alpha) @ stokes
        for i in range(0, len(normals), block)
    ]
    return np.concatenate(parts)


class _Same:
    """An array as a key by content, so that scenes of one geometry share their weights."""

    def __init__(self, array: Image) -> None:
        self.array = array
        self._key = array.tobytes()

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self._key == other._key


@functools.lru_cache(maxsize=1)
def _cached_weights(normals: _Same, lamp: Directions, alpha: float) -> NDArray[np.float32]:
    return _weights(normals.array, lamp, alpha)


def _weights(normals: Image, lamp: Directions, alpha: float) -> NDArray[np.float32]:
    """Facets that stand at each half vector, times shadowing: (pixels, K)."""
    n = normals.astype(np.float32)
    n_h = n @ lamp.half.T.astype(np.float32)
    n_l = n @ lamp.toward.T.astype(np.float32)
    seen = (n_h > 1e-3) & (n_l > 0)
    squared = np.where(seen, n_h, 1) ** 2
    facets = np.exp((1 - 1 / squared) / np.float32(alpha**2)) / squared**2
    shadowed = _smith_g1(np.where(seen, n_l, 1), np.float32(alpha))
    return np.where(seen, facets * shadowed, 0)


def _smith_g1(cosine: NDArray[np.float32], alpha: np.float32) -> NDArray[np.float32]:
    """Smith's shadowing for Beckmann slopes: Walter et al., EGSR 2007, rational approximation."""
    tangent = np.sqrt(np.maximum(1 - cosine * cosine, 1e-12)) / cosine
    a = 1 / (alpha * tangent)
    rational = (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a)
    return np.where(a < 1.6, rational, 1).astype(np.float32)
