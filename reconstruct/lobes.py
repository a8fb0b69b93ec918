"""How each lobe of the reflected light is polarised, pixel by pixel and band by band.

A lobe model is given an observation once and prepares what the whole image shares, such as
tables. What it returns is called with one block of the image after another and gives the pair
(s1/s0, s2/s0) of the lobe, arrays that broadcast to (bands, height, width): one plane a band.
Specular light polarises perpendicular to the plane of reflection and light that left the body
parallel to the plane of N and V, so that with φ the azimuth of the plane

    specular: (−ρ cos 2φ, −ρ sin 2φ)        body: (+ρ_d cos 2φ, +ρ_d sin 2φ).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.fresnel import smooth_dolp
from malus.reconstruct.observation import Image, Inapplicable, Observation
from malus.reconstruct.ratio import Measure
from malus.reconstruct.table import BodyTable, DolpTable
from malus.scenes.lights import Distant

Polarisation = tuple[Image, Image]


@dataclass(frozen=True)
class Block:
    """Some rows of an observation, with what several models read computed once."""

    observation: Observation

    @functools.cached_property
    def normal(self) -> tuple[Image, Image, Image]:
        """Components of the normals as contiguous planes (height, width)."""
        normals = self.observation.require("normals")
        x, y, z = (np.ascontiguousarray(normals[..., k]) for k in range(3))
        return x, y, z

    @functools.cached_property
    def double_azimuth(self) -> Polarisation:
        """(cos 2φ, sin 2φ) of the normals."""
        return double_azimuth(*self.normal[:2])


BlockModel = Callable[[Block], Polarisation]
LobeModel = Callable[[Observation], BlockModel]


def double_azimuth(x: Image, y: Image) -> Polarisation:
    """(cos 2φ, sin 2φ) of the azimuth of (x, y) without trigonometry; (0, 0) at the origin.

    Examples
    --------
    >>> [v.item() for v in double_azimuth(np.array(0.0), np.array(2.0))]
    [-1.0, 0.0]
    """
    squared = x * x + y * y
    inverse = np.divide(1, squared, out=np.zeros_like(squared), where=squared > 0)
    return (x * x - y * y) * inverse, 2 * x * y * inverse


def microfacets(measure: Measure) -> LobeModel:
    """The paper's model: ρ(θ, σ, η) of Equation 8 about the mean normal, for one measure."""

    def prepare(observation: Observation) -> BlockModel:
        observation.require("normals")
        sigma = observation.sigma
        tables = [DolpTable(eta, sigma, measure) for eta in one_index(observation)]
        return functools.partial(_about_normals, tables=tables, sign=-1)

    return prepare


def body(observation: Observation) -> BlockModel:
    """Light that left the body: ρ_d from what the interface transmits at the zenith angle."""
    observation.require("normals")
    tables = [BodyTable(eta) for eta in one_index(observation)]
    return functools.partial(_about_normals, tables=tables, sign=1)


def _about_normals(
    block: Block, tables: Sequence[Callable[[Image], Image]], sign: int
) -> Polarisation:
    """± ρ of one table a band times (cos 2φ, sin 2φ) of the normals, in the normals' dtype."""
    cos2, sin2 = block.double_azimuth
    cosine = block.normal[2]
    rho = np.empty((len(tables), *cosine.shape), dtype=cosine.dtype)
    for plane, table in zip(rho, tables, strict=True):
        plane[...] = table(cosine)
    if sign < 0:
        np.negative(rho, out=rho)
    second = rho * sin2
    rho *= cos2
    return rho, second


def smooth(observation: Observation) -> BlockModel:
    """Wolff's smooth surface: Fresnel at the zenith angle, one mirror and no facets.

    Source: Wolff and Boult, "Constraining object features using a polarization reflectance
    model", IEEE TPAMI 13 (1991).
    """
    observation.require("normals")
    eta = _per_band(np.asarray(observation.require("eta")))

    def model(block: Block) -> Polarisation:
        cos2, sin2 = block.double_azimuth
        cosine = block.normal[2]
        rho = smooth_dolp(np.clip(cosine, 0, 1), eta).astype(cosine.dtype)
        return -rho * cos2, -rho * sin2

    return model


def half_vector(observation: Observation) -> BlockModel:
    """Facets that mirror a distant light: M is the half vector H of light and viewer."""
    light = observation.require("light")
    if not isinstance(light, Distant):
        raise Inapplicable(f"needs a distant light, found {light.kind}")
    half = np.array(light.direction) + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    cos2, sin2 = double_azimuth(half[0], half[1])
    rho = smooth_dolp(half[2], _per_band(np.asarray(observation.require("eta"))))
    dtype = observation.image.dtype
    polarisation = (-rho * cos2).astype(dtype), (-rho * sin2).astype(dtype)
    return lambda _: polarisation


def _per_band(eta: NDArray[Any]) -> NDArray[Any]:
    """One index a band as (bands, 1, 1)."""
    if eta.ndim != 1:
        raise Inapplicable("needs one index a band")
    return eta[:, None, None]


def one_index(observation: Observation) -> list[float]:
    """The refractive index of every band; raises Inapplicable where it varies over the image."""
    return [float(value) for value in _per_band(np.asarray(observation.require("eta"))).ravel()]
