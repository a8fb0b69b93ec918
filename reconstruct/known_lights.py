"""Specular light from lights that are given: which facets mirror them, and the polarisation.

For an orthographic viewer the facet that mirrors a direction ω has the half vector H of ω and V
for its normal, whatever the pixel: Fresnel's reflectances and the plane of reflection belong to
the direction. A pixel only decides how many facets stand that way. Its Stokes vector is therefore
a sum over directions,

    s(N) ∝ Σ_ω D(N·H_ω) G1(N·ω) · L(ω) ΔΩ (½(F_⊥ + F_∥), −½(F_⊥ − F_∥) cos 2φ_H, … sin 2φ_H),

one matrix product for all pixels and bands. Where pixels have a direction to the camera or a
surface of their own, nothing is shared, and `_pixelwise_stokes` sums pixel by pixel. D is
Beckmann's distribution, or GGX where the observation says so, G1 Smith's shadowing; the viewer's
masking and the factor 1/(4 N·V) are common to all directions and cancel in s/s0.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from malus.reconstruct.fresnel import EtaArray, excess, reflectances
from malus.reconstruct.lobe_models import Lobe, half_vector
from malus.reconstruct.observation import Image, Observation
from malus.reconstruct.pixel_block import Block, below_one, uniform_alpha, uniform_eta
from malus.reconstruct.quadrature import Directions, quadrature
from malus.scenes.core.arrays import BoolArray, Float32Array, Float64Array
from malus.scenes.lights.lights import Distant

BLOCK = 1 << 24
"""Largest number of pixel-direction pairs in memory at once."""

DARK = 1e-30
"""Specular light below this share of the brightest direction counts as none: so near to the
smallest float32, rounding would decide its polarisation."""


def known_lights(observation: Observation) -> Lobe:
    """Lobe model of specular light: facets weighted by the light that each mirrors to the viewer.

    Raises
    ------
    Inapplicable
        If light, normals, eta or alpha is not given.
    """
    light = observation.require("light")
    observation.require("normals")
    eta, alpha = uniform_eta(observation), uniform_alpha(observation)
    if isinstance(light, Distant):  # one direction: whatever facets mirror it polarise it alike
        return half_vector(observation)
    lamp = quadrature(light, _smallest_alpha(observation) if alpha is None else alpha)
    ggx = observation.distribution == "ggx"
    shared = None
    if eta is not None and alpha is not None and observation.view_direction is None:
        shared = _facet_stokes(lamp, eta)

    def ratios(block: Block) -> Image:
        inside = block.mask & block.valid
        stokes: Image
        if shared is None:
            stokes = _pixelwise_stokes(block, inside, lamp, ggx)
        else:
            facets = FacetsOfAll(float(block.alpha[0]), ggx)
            stokes = _shared_stokes(block.normals[inside], lamp, facets, shared)
            stokes = stokes.reshape(len(stokes), shared.shape[1] // 3, 3)
        dark = stokes[..., 0] < DARK
        # Rounding must not lift a degree of polarisation above one.
        total = np.where(dark, np.inf, stokes[..., 0] / below_one(np.dtype(np.float32)))
        result = np.zeros((len(inside), stokes.shape[1], 2), block.dtype)
        result[inside] = stokes[..., 1:] / total[..., None]
        return result

    return ratios


def _smallest_alpha(observation: Observation) -> float:
    """The smallest roughness of the object's pixels."""
    whole = Block(observation, slice(None))
    return float(np.min(whole.alpha[whole.mask & whole.valid], initial=1.0))


def _facet_stokes(lamp: Directions, eta: EtaArray) -> Float32Array:
    """Stokes vectors (K, bands · 3) of the specular light from each direction."""
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


class FacetsOfAll(NamedTuple):
    """Roughness of all pixels, and whether facets are GGX, not Beckmann's."""

    alpha: float
    ggx: bool


def _shared_stokes(
    normals: Image, lamp: Directions, facets: FacetsOfAll, facet_stokes: Float32Array
) -> Float32Array:
    """Stokes vectors (pixels, bands · 3) of pixels with one roughness, up to one factor."""
    block = max(1, BLOCK // len(lamp.power))
    if len(normals) <= block:
        weights = _cached_weights(_ArrayKey(normals), lamp, facets)
        result: Float32Array = weights @ facet_stokes
        return result
    parts = [
        _weights(normals[i : i + block], lamp, facets) @ facet_stokes
        for i in range(0, len(normals), block)
    ]
    return np.concatenate(parts)


class _ArrayKey:
    """An array as a key by its content, so that scenes of one geometry share their weights."""

    def __init__(self, array: Image) -> None:
        self.array = array
        self._key = array.tobytes()

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ArrayKey) and self._key == other._key


@functools.lru_cache(maxsize=1)
def _cached_weights(normals: _ArrayKey, lamp: Directions, facets: FacetsOfAll) -> Float32Array:
    """As `_weights`, kept for the next image of the same geometry."""
    return _weights(normals.array, lamp, facets)


def _weights(normals: Image, lamp: Directions, facets: FacetsOfAll) -> Float32Array:
    """Density of facets at each half vector times shadowing of the light: (pixels, K)."""
    from malus.reconstruct.known_light_kernels import weigh_facets

    weights = np.empty((len(normals), len(lamp.power)), np.float32)
    weigh_facets(normals.astype(np.float64), lamp.half, lamp.toward, *facets, weights)
    return weights


def _pixelwise_stokes(block: Block, chosen: BoolArray, lamp: Directions, ggx: bool) -> Float64Array:
    """Specular Stokes vectors (chosen pixels, bands, 3), up to one factor for the whole image."""
    from malus.reconstruct.known_light_kernels import sum_stokes

    index = np.flatnonzero(chosen)
    basis, alpha, eta = (
        values if len(values) == 1 else values[index]
        for values in (block.basis, block.alpha, block.eta)
    )
    delta = excess(eta).astype(np.complex128)
    stokes = np.zeros((len(index), eta.shape[1], 3))
    normals = block.normals[index].astype(np.float64)
    power = lamp.power / lamp.power.max()
    sum_stokes(normals, basis, alpha, delta, lamp.toward, power, ggx, stokes)
    return stokes
