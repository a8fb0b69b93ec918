"""Which facets mirror a known light to the viewer, and how the light is polarised thereby.

For an orthographic viewer the facet that mirrors a direction ω has the half vector H of ω and V
for its normal, whatever the pixel: Fresnel's reflectances and the plane of reflection belong to
the direction. A pixel only decides how many facets stand that way. Its Stokes vector is therefore
a sum over directions,

    s(N) ∝ Σ_ω D(N·H_ω) G1(N·ω) · L(ω) ΔΩ (½(F_⊥ + F_∥), −½(F_⊥ − F_∥) cos 2φ_H, … sin 2φ_H),

one matrix product for all pixels and bands. Where pixels have a view or a surface of their own,
nothing is shared, and `_each` sums pixel by pixel. D is Beckmann's distribution, G1 Smith's
shadowing; the viewer's masking and the factor 1/(4 N·V) are common to all directions and cancel
in s/s0.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.fresnel import EtaArray, excess, reflectances
from malus.reconstruct.lobe_models import Ratio
from malus.reconstruct.observation import Image, Observation
from malus.reconstruct.pixel_block import Block, below_one, uniform_alpha, uniform_eta
from malus.reconstruct.quadrature import Directions, quadrature

BLOCK = 1 << 24
"""Largest number of pixel-direction pairs in memory at once."""

DARK = 1e-30
"""Mirrored light below this share of the brightest direction is none: nearer to the smallest
float32 its polarisation would be rounding."""


def known_lights(observation: Observation) -> Ratio:
    """The lobe model: light mirrored by the facets that stand right for each direction."""
    light = observation.require("light")
    observation.require("normals")
    eta, alpha = uniform_eta(observation), uniform_alpha(observation)
    lamp = quadrature(light, _finest(observation) if alpha is None else alpha)
    shared = None
    if eta is not None and alpha is not None and observation.view_direction is None:
        shared = _mirrored(lamp, eta)

    def ratio(block: Block) -> Image:
        seen = block.mask & block.valid
        summed: Image
        if shared is None:
            summed = _each(block, seen, lamp)
        else:
            summed = _gather(block.normals[seen], lamp, block.alpha[0], shared)
            summed = summed.reshape(len(summed), shared.shape[1] // 3, 3)
        dark = summed[..., 0] < DARK
        # Rounding must not lift a degree of polarisation above one.
        total = np.where(dark, np.inf, summed[..., 0] / below_one(np.dtype(np.float32)))
        result = np.zeros((len(seen), summed.shape[1], 2), block.dtype)
        result[seen] = summed[..., 1:] / total[..., None]
        return result

    return ratio


def _finest(observation: Observation) -> float:
    """The smallest roughness of the object's pixels."""
    whole = Block(observation, slice(None))
    return float(np.min(whole.alpha[whole.mask & whole.valid], initial=1.0))


def _mirrored(lamp: Directions, eta: EtaArray) -> NDArray[np.float32]:
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
    from malus.reconstruct.known_light_kernels import weigh

    weights = np.empty((len(normals), len(lamp.power)), np.float32)
    weigh(normals.astype(np.float64), lamp.half, lamp.toward, alpha, weights)
    return weights


def _each(block: Block, seen: NDArray[np.bool_], lamp: Directions) -> NDArray[np.float64]:
    """What each seen pixel mirrors, (seen pixels, bands, 3), up to one factor."""
    from malus.reconstruct.known_light_kernels import mirror

    index = np.flatnonzero(seen)
    basis, alpha, eta = (
        values if len(values) == 1 else values[index]
        for values in (block.basis, block.alpha, block.eta)
    )
    delta = excess(eta).astype(np.complex128)
    summed = np.zeros((len(index), eta.shape[1], 3))
    normals = block.normals[index].astype(np.float64)
    mirror(normals, basis, alpha, delta, lamp.toward, lamp.power / lamp.power.max(), summed)
    return summed
