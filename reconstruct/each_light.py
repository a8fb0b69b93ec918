"""Light that facets mirror to viewers of many positions, or from many surfaces, pixel by pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.block import Block
from malus.reconstruct.fresnel import EtaArray, reflectances
from malus.reconstruct.quadrature import Directions

Floats = NDArray[np.float64]

_PAIRS = 1 << 17
"""Pixel-direction pairs in memory at once: a dozen arrays of 1 MB."""
_FAINT = 1e-10
"""Directions below this share of a pixel's brightest are left out: thousands change nothing."""


def facet_weights(n_h: NDArray[Any], n_l: NDArray[Any], alpha: Any) -> NDArray[Any]:
    """Beckmann's facets at N·H, times Smith's shadowing of N·L, in the precision given."""
    seen = (n_h > 1e-3) & (n_l > 0)
    squared = np.where(seen, n_h, 1) ** 2
    facets = np.exp((1 - 1 / squared) / alpha**2) / squared**2
    shadowed = _smith_g1(np.where(seen, n_l, 1), alpha)
    return np.asarray(np.where(seen, facets * shadowed, 0), n_h.dtype)


def _smith_g1(cosine: NDArray[Any], alpha: Any) -> NDArray[Any]:
    """Smith's shadowing for Beckmann slopes: Walter et al., EGSR 2007, rational approximation."""
    tangent = np.sqrt(np.maximum(1 - cosine * cosine, 1e-12)) / cosine
    a = 1 / (alpha * tangent)
    rational = (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a)
    return np.asarray(np.where(a < 1.6, rational, 1))


def each_pixel(block: Block, seen: NDArray[np.bool_], lamp: Directions) -> Floats:
    """What each seen pixel mirrors as Stokes vectors (seen pixels, bands, 3), up to one factor."""
    index = np.flatnonzero(seen)
    step = max(1, _PAIRS // len(lamp.power))
    parts = [_some(block, index[i : i + step], lamp) for i in range(0, len(index), step)]
    return np.concatenate(parts) if parts else np.zeros((0, block.lobe("specular").shape[1], 3))


def _some(block: Block, index: NDArray[np.intp], lamp: Directions) -> Floats:
    """The same of pixels `index`. All vectors are in the frame of the pixel, where V = z."""
    basis, alpha, eta = (_of(values, index) for values in (block.basis, block.alpha, block.eta))
    normal = block.normals[index].astype(np.float64)[..., None]
    x, y, z = (basis[:, k] @ lamp.toward.T for k in range(3))
    n_l = normal[:, 0] * x + normal[:, 1] * y + normal[:, 2] * z
    length = np.sqrt(np.maximum(2.0 + 2.0 * z, 1e-30))  # of L + V
    n_h = (n_l + normal[:, 2]) / length
    weights = facet_weights(n_h, n_l, alpha[:, None]) * (lamp.power / lamp.power.max())
    pixel, direction = np.nonzero(weights > _FAINT * weights.max(axis=1, keepdims=True))
    chosen = weights[pixel, direction]
    shared = (0 if len(x) == 1 else pixel), direction
    x, y, cosine = x[shared], y[shared], np.minimum(0.5 * length[shared], 1.0)
    across = np.maximum(x * x + y * y, 1e-300)
    frame = np.stack([(x * x - y * y) / across, 2.0 * x * y / across])
    own = eta if len(eta) == 1 else eta[pixel]
    own = np.broadcast_to(own, (len(pixel), eta.shape[1]))
    return _summed(chosen, cosine, frame, own, pixel, len(index))


def _of(values: NDArray[Any], index: NDArray[np.intp]) -> NDArray[Any]:
    return values if len(values) == 1 else values[index]


def _summed(
    weights: Floats,
    cosine: Floats,
    frame: Floats,
    eta: EtaArray,
    pixel: NDArray[np.intp],
    count: int,
) -> Floats:
    """Sums of weight times Fresnel over the pairs of each of `count` pixels."""
    result = np.empty((count, eta.shape[1], 3))
    for band in range(eta.shape[1]):
        perpendicular, parallel = reflectances(cosine, eta[:, band])
        polarised = weights * (parallel - perpendicular)
        for k, part in enumerate([weights * (perpendicular + parallel), *(polarised * frame)]):
            result[:, band, k] = np.bincount(pixel, part, count)
    return result
