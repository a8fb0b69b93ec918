"""How different an estimate looks: ΔE76 and ΔE2000 in CIELAB.

Bands are narrow. The integral of the observer's colour-matching functions over wavelength is a sum
over the bands' centres, each weighted by the width of its cell (half-way to its neighbours, the
outer cells symmetric). Lights have flat spectra, so that the illuminant is equal energy. White,
Y = 100, is a surface that is everywhere as bright as the brightest pixel of the true unpolarised
image in the mask: what an exposure without clipping makes of it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.bench.scoring.sums import PixelSums
from malus.scenes import polarisation
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import PAPER_ANGLES_DEG

Floats = NDArray[np.float64]
Image = NDArray[np.floating[Any]]

JUST_NOTICEABLE = 2.3
"""ΔE76 of one just noticeable difference (Mahy, Van Eycken and Oosterlinck, Color Research and
Application 19, 1994)."""

_OBSERVER = "CIE 1931 2 Degree Standard Observer"


def band_weights(wavelengths_nm: tuple[float, ...]) -> Floats:
    """What one unit of radiance in each band adds to X, Y, Z; a flat white has Y = 100.

    Returns
    -------
    (bands, 3) array.

    Raises
    ------
    InputError
        If no band is visible.

    Examples
    --------
    >>> round(float(band_weights((450.0, 550.0, 650.0))[:, 1].sum()), 9)
    100.0
    """
    import colour

    observer = colour.MSDS_CMFS[_OBSERVER]
    centres = np.asarray(wavelengths_nm, dtype=np.float64)
    inside = (centres >= observer.wavelengths[0]) & (centres <= observer.wavelengths[-1])
    matching = np.zeros((len(centres), 3))
    for axis in range(3):
        found = np.interp(centres, observer.wavelengths, observer.values[:, axis])
        matching[:, axis] = np.where(inside, found, 0.0)
    widths = np.gradient(centres) if len(centres) > 1 else np.ones(1)
    weights = matching * widths[:, None]
    white = float(weights[:, 1].sum())
    if not white > 0.0:
        raise InputError(
            "colour error", "bands within 360 to 830 nm", str(wavelengths_nm), "score without it"
        )
    return np.asarray(100.0 * weights / white)


def lab(radiance: Image, weights: Floats) -> Floats:
    """CIELAB (..., 3) of radiance (..., bands) over that of white.

    Examples
    --------
    >>> lab(np.ones(3), band_weights((450.0, 550.0, 650.0))).round(6).tolist()
    [100.0, 0.0, 0.0]
    """
    import colour

    # Negative radiance is a violation and counted as such; it looks black.
    xyz = np.maximum(radiance.astype(np.float64), 0.0) @ weights / 100.0
    white = weights.sum(axis=0) / 100.0
    found = colour.XYZ_to_Lab(xyz, colour.XYZ_to_xy(white))
    # Zero up to the rounding of the chromaticity's round trip.
    return np.asarray(found, dtype=np.float64) + 0.0


Found = Iterator[tuple[str, float | None, PixelSums]]
Maps = Iterator[tuple[str, float | None, Floats]]


def delta_e(
    estimated: Image, true: Image, wavelengths_nm: tuple[float, ...], method: str = "CIE 1976"
) -> Found:
    """Sums over pixels of the colour difference of I_max, I_min, every I(ϑ), and all I(ϑ).

    Parameters as those of `delta_e_maps`.

    Yields
    ------
    (suffix, polariser angle in degrees or None, PixelSums)
    """
    whole = PixelSums()
    for suffix, angle, difference in delta_e_maps(estimated, true, wavelengths_nm, method):
        sums = PixelSums.of(difference)
        if angle is not None:
            whole = whole + sums
        yield suffix, angle, sums
    yield "", None, whole


def delta_e_maps(
    estimated: Image, true: Image, wavelengths_nm: tuple[float, ...], method: str = "CIE 1976"
) -> Maps:
    """Colour difference (pixels,) of I_max, I_min and every I(ϑ).

    Parameters
    ----------
    estimated, true : (pixels, bands, 3)
        Stokes vectors over the radiance of white.
    wavelengths_nm : (bands,)
    method : str
        "CIE 1976" or "CIE 2000", as colour-science names them.

    Yields
    ------
    (suffix, polariser angle in degrees or None, (pixels,) differences)
    """
    import colour

    weights = band_weights(wavelengths_nm)
    for suffix, angle, image in _images():
        pair = (lab(image(stokes), weights) for stokes in (true, estimated))
        yield suffix, angle, np.asarray(colour.delta_E(*pair, method=method))


def _images() -> Iterator[tuple[str, float | None, Callable[[Image], Image]]]:
    yield "_i_max", None, lambda stokes: polarisation.extremes(stokes)[0]
    yield "_i_min", None, lambda stokes: polarisation.extremes(stokes)[1]
    for angle in PAPER_ANGLES_DEG:
        yield "", angle, functools.partial(polarisation.polarised, angle_deg=angle)
