"""Values of a picture that can be computed with: which pixels are finite, and a unit near 1."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from malus.reconstruct.observation import Image, Inapplicable
from malus.scenes.core.arrays import BoolArray

_DOUBLE = np.dtype(np.float64)
_ORDINARY = 16
"""Powers of two around 1 within which a peak is left as it is: codes of 16 bits are ordinary."""


def unit_scale(peak: float, dtype: np.dtype[Any] = _DOUBLE) -> float:
    """Power of two, which rounds nothing, that brings a peak near 1; 1 for one that is ordinary.

    Squares of very small and of very large numbers leave the range of floats, and a search over
    logarithms has bounds. The power is a number of `dtype`, even where its inverse is not.

    Examples
    --------
    >>> unit_scale(0.25), unit_scale(2.0**-60), unit_scale(3 * 2.0**60) == 2.0**-62
    (1.0, 5.764607523034235e+17, True)
    """
    exponent = math.frexp(peak)[1]
    if abs(exponent) <= _ORDINARY:
        return 1.0
    return math.ldexp(1.0, min(-exponent, np.finfo(dtype).maxexp - 2))


def all_finite(image: Image) -> bool:
    """Whether every value is a number, told without an array of the image's size.

    Examples
    --------
    >>> all_finite(np.ones((1, 2, 1))), all_finite(np.array([[[1.0], [np.nan]]]))
    (True, False)
    """
    return image.size == 0 or all(math.isfinite(float(end)) for end in (image.min(), image.max()))


def finite_pixels(image: Image, mask: BoolArray) -> BoolArray:
    """Pixels (height, width) of which every band is finite.

    Raises
    ------
    Inapplicable
        If the object has pixels, and none of them is.

    Examples
    --------
    >>> finite_pixels(np.array([[[1.0], [np.nan]]]), np.ones((1, 2), bool)).tolist()
    [[True, False]]
    """
    if all_finite(image):
        return np.ones(image.shape[:-1], dtype=bool)
    finite = np.asarray(np.isfinite(image).all(axis=-1))
    if mask.any() and not (mask & finite).any():
        raise Inapplicable("no pixel of the object is finite")
    return finite
