"""How narrow bands look: linear sRGB for the preview of a spectral image."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.floating[Any]]

_FAINT = 1e-3
"""Least sum of a colour matching function over the bands: bands below it show no such colour."""


def preview(image: Image, wavelengths_nm: tuple[float, ...]) -> NDArray[np.float32]:
    """Linear sRGB (height, width, 3) of radiances (height, width, bands).

    The bands are integrated with the CIE 1931 2° colour matching functions, scaled so that a flat
    spectrum is the equal-energy white, which Bradford adaptation turns into the white of sRGB.
    Bands that cannot show all colours (fewer than three, or invisible ones) give grey. Values
    are not clipped: a preview in an OpenEXR file is linear and may leave the gamut.

    Examples
    --------
    >>> preview(np.full((1, 1, 3), 0.5), (450.0, 550.0, 650.0)).round(2).tolist()
    [[[0.5, 0.5, 0.5]]]
    """
    weights = _weights(wavelengths_nm)
    result: NDArray[np.float32] = np.asarray(image @ weights, dtype=np.float32)
    return result


@functools.lru_cache(maxsize=16)
def _weights(wavelengths_nm: tuple[float, ...]) -> NDArray[np.float64]:
    """Matrix (bands, 3) from radiances to linear sRGB; a flat spectrum becomes white."""
    bands = len(wavelengths_nm)
    grey = np.full((bands, 3), 1.0 / bands)
    if bands < 3:
        return grey
    # colour-science takes a second to import, and most of malus never needs it.
    import colour

    # The observer has some response in 360 to 830 nm only; outside it the table extrapolates.
    wavelengths = np.asarray(wavelengths_nm)
    visible = (wavelengths >= 360.0) & (wavelengths <= 830.0)
    observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    responses = np.zeros((bands, 3))
    responses[visible] = observer[wavelengths[visible]]
    responses *= np.gradient(wavelengths)[:, None]
    sums = responses.sum(axis=0)
    if sums.min() < _FAINT:
        return grey
    white = colour.CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]["E"]
    rgb = colour.XYZ_to_RGB(responses / sums, "sRGB", white, "Bradford")
    return np.asarray(rgb, dtype=np.float64)
