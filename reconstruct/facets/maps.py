"""Specular ρ where index or roughness vary over the image: several objects, or textures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from malus.reconstruct.facets.ratio import Measure, specular_dolp
from malus.reconstruct.facets.table import DolpTable
from malus.reconstruct.fresnel import EtaArray
from malus.reconstruct.observation import Observation
from malus.reconstruct.pixel_block import Block
from malus.scenes.core.arrays import AnyArray, BoolArray, Float64Array, FloatArray

_FEW = 64
"""Number of surfaces up to which a table of each, 5 ms, is faster than an interpolant of all."""
_PIXELS_A_TABLE = 100
"""Pixels of a surface from which on its table, of as many integrals, takes less time."""
_TOLERANCE = 9e-7  # of the interpolant, so that float32 ends below 1e-6


def mapped_dolp(observation: Observation, measure: Measure) -> Callable[[Block], FloatArray]:
    """A function that gives ρ (pixels, bands) of any rows of an image with a map of η or alpha.

    ρ is computed for the whole image at once, where there is specular light; elsewhere it is 0.
    """
    whole = Block(observation, slice(None))
    specular = whole.lobe("specular")
    lit: BoolArray = np.any(specular, axis=-1)
    cosine, eta = whole.cosine[lit], _chosen(whole.eta, lit)
    sigma = _chosen(whole.alpha, lit) ** -2.0
    result = np.zeros(specular.shape, whole.dtype)
    for band in range(specular.shape[1]):
        result[lit, band] = scattered_dolp(cosine, eta[:, band], sigma, measure)
    return lambda block: result[block.pixels]


def _chosen(values: AnyArray, chosen: BoolArray) -> AnyArray:
    """The chosen pixels of a map (pixels, …); a single value holds for all."""
    return values if len(values) == 1 < len(chosen) else values[chosen]


def scattered_dolp(
    cosine: Float64Array, eta: EtaArray, sigma: Float64Array, measure: Measure
) -> Float64Array:
    """ρ (pixels,) at cosines of the zenith angle, within 1e-6; eta and sigma may have length 1.

    Few surfaces are tabulated, many are interpolated.

    Examples
    --------
    >>> cosine, eta, sigma = np.array([0.5, 0.5]), np.array([1.5, 2.0]), np.array([11.0])
    >>> scattered_dolp(cosine, eta, sigma, "eq8").round(3).tolist()
    [0.767, 0.842]
    """
    eta, sigma = (np.broadcast_to(values, cosine.shape) for values in (eta, sigma))
    indices, index_of = np.unique(eta, return_inverse=True)
    exponents, exponent_of = np.unique(sigma, return_inverse=True)
    surfaces, label = np.unique(index_of * len(exponents) + exponent_of, return_inverse=True)
    if len(surfaces) > min(_FEW, len(cosine) / _PIXELS_A_TABLE):
        return specular_dolp(np.arccos(cosine), eta, sigma, measure, tolerance=_TOLERANCE)
    result = np.empty(cosine.shape)
    for number, surface in enumerate(surfaces):
        index, exponent = divmod(int(surface), len(exponents))
        chosen = label == number
        table = DolpTable(indices[index], exponents[exponent], measure)
        result[chosen] = table(cosine[chosen])
    return result
