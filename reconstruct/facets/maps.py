"""ρ where index or roughness vary over the image: several objects, or textures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.facets.ratio import Measure, specular_dolp
from malus.reconstruct.facets.table import DolpTable
from malus.reconstruct.fresnel import EtaArray
from malus.reconstruct.observation import Observation
from malus.reconstruct.pixel_block import Block

FloatArray = NDArray[np.float64]

_FEW = 64
"""Surfaces up to which a table of each, 5 ms, is faster than an interpolant of all."""
_PIXELS_A_TABLE = 100
"""Pixels of a surface from which its table, of as many integrals, is the better deal."""
_TOLERANCE = 9e-7  # of the interpolant, so that float32 ends below 1e-6


def mapped_dolp(
    observation: Observation, measure: Measure
) -> Callable[[Block], NDArray[np.floating[Any]]]:
    """ρ (pixels, bands) of any rows of an image whose `eta` or `alpha` is a map.

    Computed for the whole image at once, where there is specular light; elsewhere 0.
    """
    whole = Block(observation, slice(None))
    specular = whole.lobe("specular")
    lit: NDArray[np.bool_] = np.any(specular, axis=-1)
    cosine, eta, sigma = whole.cosine[lit], _at(whole.eta, lit), _at(whole.alpha, lit) ** -2.0
    result = np.zeros(specular.shape, whole.dtype)
    for band in range(specular.shape[1]):
        result[lit, band] = scattered_dolp(cosine, eta[:, band], sigma, measure)
    return lambda block: result[block.pixels]


def _at(values: NDArray[Any], chosen: NDArray[np.bool_]) -> NDArray[Any]:
    """The chosen pixels of a map; one value stands for all."""
    return values if len(values) == 1 < len(chosen) else values[chosen]


def scattered_dolp(
    cosine: FloatArray, eta: EtaArray, sigma: FloatArray, measure: Measure
) -> FloatArray:
    """ρ of pixels (pixels,) of few or many surfaces within 1e-6; eta and sigma may have length 1.

    Examples
    --------
    >>> cosine, eta, sigma = np.array([0.5, 0.5]), np.array([1.5, 2.0]), np.array([11.0])
    >>> scattered_dolp(cosine, eta, sigma, "eq8").round(3).tolist()
    [0.767, 0.842]
    """
    eta, sigma = (np.broadcast_to(values, cosine.shape) for values in (eta, sigma))
    indices, which = np.unique(eta, return_inverse=True)
    exponents, how = np.unique(sigma, return_inverse=True)
    surfaces, label = np.unique(which * len(exponents) + how, return_inverse=True)
    if len(surfaces) > min(_FEW, len(cosine) / _PIXELS_A_TABLE):
        return specular_dolp(np.arccos(cosine), eta, sigma, measure, tolerance=_TOLERANCE)
    result = np.empty(cosine.shape)
    for number, surface in enumerate(surfaces):
        index, exponent = divmod(int(surface), len(exponents))
        chosen = label == number
        table = DolpTable(indices[index], exponents[exponent], measure)
        result[chosen] = table(cosine[chosen])
    return result
