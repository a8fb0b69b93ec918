"""Colour of narrow bands: CIELAB, colour differences, and linear sRGB for previews."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator

import numpy as np

from malus.scenes import polarisation
from malus.scenes.core.arrays import Float32Array, Float64Array, FloatArray
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import PAPER_ANGLES_DEG

JUST_NOTICEABLE = 2.3
"""ΔE76 of one just noticeable difference (Mahy, Van Eycken and Oosterlinck, Color Research and
Application 19, 1994)."""


_OBSERVER = "CIE 1931 2 Degree Standard Observer"


def band_weights(wavelengths_nm: tuple[float, ...]) -> Float64Array:
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


def lab(radiance: FloatArray, weights: Float64Array) -> Float64Array:
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


def lab_of_linear_srgb(linear: FloatArray, white: float) -> Float64Array:
    """CIELAB (..., 3) of linear sRGB (..., 1 or 3) over the radiance of white."""
    import colour

    rgb = np.broadcast_to(np.clip(linear / white, 0, None), (*linear.shape[:-1], 3))
    space = colour.RGB_COLOURSPACES["sRGB"]
    xyz = rgb.astype(np.float64) @ space.matrix_RGB_to_XYZ.T
    return np.asarray(colour.XYZ_to_Lab(xyz, space.whitepoint))


Maps = Iterator[tuple[str, float | None, Float64Array]]


def delta_e_maps(
    estimated: FloatArray,
    true: FloatArray,
    wavelengths_nm: tuple[float, ...],
    method: str = "CIE 1976",
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


def _images() -> Iterator[tuple[str, float | None, Callable[[FloatArray], FloatArray]]]:
    yield "_i_max", None, lambda stokes: polarisation.extremes(stokes)[0]
    yield "_i_min", None, lambda stokes: polarisation.extremes(stokes)[1]
    for angle in PAPER_ANGLES_DEG:
        yield "", angle, functools.partial(polarisation.polarised, angle_deg=angle)


_FAINT = 1e-3
"""Least sum of a colour matching function over the bands: bands below it show no such colour."""


def preview(image: FloatArray, wavelengths_nm: tuple[float, ...]) -> Float32Array:
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
    result: Float32Array = np.asarray(image @ weights, dtype=np.float32)
    return result


@functools.lru_cache(maxsize=16)
def _weights(wavelengths_nm: tuple[float, ...]) -> Float64Array:
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
