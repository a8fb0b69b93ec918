"""Colour of narrow bands and of linear sRGB: CIELAB, colour differences, previews.

An integral over wavelength is a sum over the bands' centres, each band as wide as its cell: half
the way to its neighbours. Bands show a colour through the CIE 1931 2° colour matching functions,
under light of a flat spectrum.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import resources
from typing import Literal

import numpy as np

from malus.scenes import polarisation
from malus.scenes.core.arrays import Float32Array, Float64Array, FloatArray
from malus.scenes.core.colour_science import colour_science
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import PAPER_ANGLES_DEG

JUST_NOTICEABLE = 2.3
"""ΔE76 of one just noticeable difference (Mahy, Van Eycken and Oosterlinck, Color Research and
Application 19, 1994)."""

_OBSERVER = "CIE 1931 2 Degree Standard Observer"
_FAINT = 1e-3
"""Least sum of a colour matching function over the bands: bands below it show no such colour."""

_XYZ_TO_SRGB = np.array(
    [
        [3.1462980624321326, -0.995187803032164, 0.06366240363778476],
        [-1.6662654804053003, 1.9555754230400555, -0.21458887554061587],
        [-0.4801892993520599, 0.03971152892827865, 1.1510009095928009],
    ]
)
"""Linear sRGB (IEC 61966-2-1) of X, Y and Z, whose equal-energy white Bradford adaptation turns
into that of sRGB, as colour-science has it: its import takes a second."""

DifferenceMaps = Iterator[tuple[str, float | None, Float64Array]]
"""Suffix of a column, polariser angle in degrees or None, and differences (pixels,)."""


def matching_functions(
    wavelengths_nm: tuple[float, ...], between: Literal["linear", "sprague"] = "linear"
) -> Float64Array:
    """Colour matching functions x̄, ȳ, z̄ at wavelengths in nm, shape (bands, 3).

    The table has a row every nanometre from 360 to 830 nm; elsewhere the functions are zero.
    `between` two rows either straight lines or the polynomials that the CIE recommends are taken.

    Examples
    --------
    >>> matching_functions((555.0, 1000.0))[:, 1].tolist()
    [1.0, 0.0]
    """
    table_nm, *functions = _observer()
    wavelengths = np.asarray(wavelengths_nm, dtype=np.float64)
    visible = (wavelengths >= table_nm[0]) & (wavelengths <= table_nm[-1])
    responses = np.zeros((len(wavelengths), 3))
    # At the rows themselves both are the table.
    at_rows = bool(np.equal(wavelengths % 1, 0).all())
    if between == "sprague" and not at_rows:
        responses[visible] = colour_science().MSDS_CMFS[_OBSERVER][wavelengths[visible]]
        return responses
    for axis, values in enumerate(functions):
        responses[visible, axis] = np.interp(wavelengths[visible], table_nm, values)
    return responses


@functools.cache
def _observer() -> Float64Array:
    """Wavelengths in nm and the three colour matching functions, shape (4, rows)."""
    entry = resources.files("malus.scenes") / "data" / "cie_1931_observer.txt"
    with entry.open("r", encoding="utf-8") as lines:
        return np.loadtxt(lines).T


def cell_widths(wavelengths_nm: tuple[float, ...]) -> Float64Array:
    """Width of the cell of each band in nm, shape (bands,); 1 for a single band.

    Examples
    --------
    >>> cell_widths((400.0, 500.0, 700.0)).tolist()
    [100.0, 150.0, 200.0]
    """
    return np.gradient(wavelengths_nm) if len(wavelengths_nm) > 1 else np.ones(1)


def band_weights(wavelengths_nm: tuple[float, ...]) -> Float64Array:
    """What one unit of radiance in each band adds to X, Y, Z; a flat white has Y = 100.

    Returns
    -------
    (bands, 3) array.

    Raises
    ------
    InputError
        If no band is visible, or none of which Z is made: then white has no Z to compare with.

    Examples
    --------
    >>> round(float(band_weights((450.0, 550.0, 650.0))[:, 1].sum()), 9)
    100.0
    """
    weights = matching_functions(wavelengths_nm) * cell_widths(wavelengths_nm)[:, None]
    white = float(weights[:, 1].sum())
    if not (weights.sum(axis=0) > 0.0).all():
        expected, found = "a band from 360 to 649 nm", f"{', '.join(map(str, wavelengths_nm))} nm"
        raise InputError("colour error", expected, found, "score without it")
    return np.asarray(100.0 * weights / white)


def lab(radiance: FloatArray, weights: Float64Array) -> Float64Array:
    """CIELAB (..., 3) of radiance (..., bands) over that of white; `weights` of `band_weights`.

    CIE 015:2018, Equations 8.3 to 8.8; colour-science has the same, and its import takes a second.

    Examples
    --------
    >>> lab(np.ones(3), band_weights((450.0, 550.0, 650.0))).round(6).tolist()
    [100.0, 0.0, 0.0]
    """
    # Negative radiance is a violation and counted as such; it looks black.
    xyz = np.maximum(radiance.astype(np.float64), 0.0) @ weights
    ratio = xyz / weights.sum(axis=0)
    bright = ratio > (24 / 116) ** 3
    f = np.where(bright, ratio ** (1 / 3), (841 / 108) * ratio + 16 / 116)
    fx, fy, fz = np.moveaxis(f, -1, 0)
    return np.stack([116 * fy - 16, 500 * (fx - fy), 200 * (fy - fz)], axis=-1)


GREY = ("grey",)
RGB = ("red", "green", "blue")
"""Names of the channels of a photograph, in linear light of the primaries of sRGB."""


def channel_weights(channels: tuple[str, ...]) -> Float64Array:
    """What one unit of light in each channel of a photograph adds to X, Y, Z; white has Y = 100.

    Returns
    -------
    (channels, 3) array, for `lab` and `weighted_colours`.

    Raises
    ------
    InputError
        If the channels are neither `RGB` nor `GREY`: bands of a spectrum have no such colour.

    Examples
    --------
    >>> lab(np.array([1.0]), channel_weights(GREY)).round(6).tolist()
    [100.0, 0.0, 0.0]
    """
    if channels not in (RGB, GREY):
        expected = "red, green and blue, or grey"
        raise InputError("channels", expected, ", ".join(channels), "score without colours")
    of_primaries = 100.0 * colour_science().RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ.T
    return np.asarray(of_primaries if channels == RGB else of_primaries.sum(axis=0)[None])


@dataclass(frozen=True)
class ComparedColours:
    """CIELAB (pixels, 3) of I_max, I_min and every I(ϑ) of one Stokes image.

    What several estimates are compared with is computed once.
    """

    labs: tuple[Float64Array, ...]
    weights: Float64Array


def compared_colours(stokes: FloatArray, wavelengths_nm: tuple[float, ...]) -> ComparedColours:
    """Colours of Stokes vectors (pixels, bands, 3) over the radiance of white.

    Raises
    ------
    InputError
        If no band is visible.
    """
    return weighted_colours(stokes, band_weights(wavelengths_nm))


def weighted_colours(stokes: FloatArray, weights: Float64Array) -> ComparedColours:
    """The same from what the bands add to X, Y, Z, of `band_weights` or `channel_weights`."""
    labs = (lab(image(stokes), weights) for _, _, image in _compared_images())
    return ComparedColours(tuple(labs), weights)


def differences_from(
    true: ComparedColours, estimated: FloatArray, method: str = "CIE 1976"
) -> DifferenceMaps:
    """Colour difference (pixels,) of I_max, I_min and every I(ϑ).

    Parameters
    ----------
    true : ComparedColours
    estimated : (pixels, bands, 3)
        Stokes vectors over the radiance of white.
    method : str
        "CIE 1976" or "CIE 2000", as colour-science names them.

    Yields
    ------
    (suffix, polariser angle in degrees or None, (pixels,) differences)

    Examples
    --------
    >>> stokes = np.full((4, 3, 3), 0.2)
    >>> true = compared_colours(stokes, (450.0, 550.0, 650.0))
    >>> [suffix for suffix, angle, _ in differences_from(true, stokes)][:3]
    ['_i_max', '_i_min', '']
    """
    for (suffix, angle, image), colours in zip(_compared_images(), true.labs, strict=True):
        estimate = lab(image(estimated), true.weights)
        yield suffix, angle, _difference(colours, estimate, method)


def _difference(true: Float64Array, estimated: Float64Array, method: str) -> Float64Array:
    if method == "CIE 1976":
        return np.sqrt(np.square(true - estimated).sum(axis=-1))
    return np.asarray(colour_science().delta_E(true, estimated, method=method))


def _compared_images() -> Iterator[tuple[str, float | None, Callable[[FloatArray], FloatArray]]]:
    """Suffix, angle and function of Stokes vectors of every image whose colours are compared."""
    yield "_i_max", None, lambda stokes: polarisation.extremes(stokes)[0]
    yield "_i_min", None, lambda stokes: polarisation.extremes(stokes)[1]
    for angle in PAPER_ANGLES_DEG:
        yield "", angle, functools.partial(polarisation.polarised, angle_deg=angle)


def preview(image: FloatArray, wavelengths_nm: tuple[float, ...]) -> Float32Array:
    """Linear sRGB (height, width, 3) of radiances (height, width, bands).

    The matching functions are scaled so that a flat spectrum is the equal-energy white, which
    Bradford adaptation turns into the white of sRGB. Bands that cannot show all colours (fewer
    than three, or invisible ones) give grey. Values are not clipped: a preview in an OpenEXR file
    is linear and may leave the gamut.

    Examples
    --------
    >>> preview(np.full((1, 1, 3), 0.5), (450.0, 550.0, 650.0)).round(2).tolist()
    [[[0.5, 0.5, 0.5]]]
    """
    return np.asarray(image @ srgb_weights(wavelengths_nm), dtype=np.float32)


@functools.lru_cache(maxsize=16)
def srgb_weights(wavelengths_nm: tuple[float, ...]) -> Float64Array:
    """Matrix (bands, 3) from radiances to linear sRGB, as `preview` has it.

    Examples
    --------
    >>> srgb_weights((450.0, 550.0, 650.0)).sum(axis=0).round(2).tolist()
    [1.0, 1.0, 1.0]
    """
    bands = len(wavelengths_nm)
    grey = np.full((bands, 3), 1.0 / bands)
    if bands < 3:
        return grey
    # Previews are files: the smoother interpolation is the one that they were written with.
    responses = matching_functions(wavelengths_nm, between="sprague")
    responses *= cell_widths(wavelengths_nm)[:, None]
    sums = responses.sum(axis=0)
    if sums.min() < _FAINT:
        return grey
    return np.asarray(responses / sums @ _XYZ_TO_SRGB)
