"""Stokes images as pictures for people: in colour, through a polariser, its degree and its angle.

A picture is (height, width, 3) of 8-bit sRGB codes. Bands become colours through the standard
observer; degree and angle are those of the light that the eye weighs, in the colours of the page.
"""

from __future__ import annotations

import base64
import json
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from malus.reports.templates.render import asset
from malus.scenes import polarisation
from malus.scenes.colour import band_weights, preview
from malus.scenes.core.arrays import AnyArray, Float64Array, FloatArray
from malus.scenes.core.colour_science import colour_science

Codes: TypeAlias = NDArray[np.uint8]

WHITE_QUANTILE = 0.97
"""Share of the lit pixels that are darker than a picture's white."""

LEAST_DOLP = 0.005
"""Degree below which an angle is noise, and shown grey, as on the page."""

_GREY = 128


def white_of(stokes: FloatArray, wavelengths_nm: tuple[float, ...]) -> float:
    """The linear sRGB value that a camera's exposure turns white."""
    light = preview(stokes[..., 0], wavelengths_nm).max(axis=-1)
    lit = light[light > 0]
    return float(np.quantile(lit, WHITE_QUANTILE)) if lit.size else 1.0


def most_of(stokes: FloatArray, wavelengths_nm: tuple[float, ...]) -> float:
    """The tenth of the degree that hardly a lit pixel exceeds: the end of a scale for `degree`."""
    light = weighed(stokes, wavelengths_nm)
    lit = light[light[..., 0] > 0]
    most = np.quantile(polarisation.dolp(lit), WHITE_QUANTILE) if lit.size else 1.0
    return min(1.0, max(0.1, math.ceil(10 * float(most)) / 10))


def photograph(stokes: FloatArray, wavelengths_nm: tuple[float, ...], white: float) -> Codes:
    """What an ordinary camera sees of Stokes images (height, width, bands, 3).

    Examples
    --------
    >>> grey = np.zeros((1, 1, 3, 3))
    >>> grey[..., 0] = 0.5
    >>> photograph(grey, (450.0, 550.0, 650.0), white=1.0).tolist()
    [[[188, 188, 188]]]
    """
    return encoded(preview(stokes[..., 0], wavelengths_nm) / white)


def through_polariser(
    stokes: FloatArray, wavelengths_nm: tuple[float, ...], white: float, angle_deg: float
) -> Codes:
    """The same through a polariser, exposed so that unpolarised light looks as without it."""
    light = 2.0 * polarisation.polarised(stokes, angle_deg)
    return encoded(preview(light, wavelengths_nm) / white)


def weighed(stokes: FloatArray, wavelengths_nm: tuple[float, ...]) -> Float64Array:
    """Stokes images (height, width, 3) of luminance: the bands as the eye weighs them."""
    weights = band_weights(wavelengths_nm)[:, 1]
    return np.asarray(np.einsum("...bs,b->...s", stokes.astype(np.float64), weights))


def degree(stokes: FloatArray, wavelengths_nm: tuple[float, ...], most: float) -> Codes:
    """Degree of linear polarisation of the luminance; `most` has the last colour of the table."""
    dolp = polarisation.dolp(weighed(stokes, wavelengths_nm))
    return _coloured(np.clip(dolp / most, 0.0, 1.0), "sequential")


def angle(stokes: FloatArray, wavelengths_nm: tuple[float, ...]) -> Codes:
    """Angle of linear polarisation of the luminance; grey where nearly nothing is polarised."""
    light = weighed(stokes, wavelengths_nm)
    codes = _coloured(polarisation.aolp(light) / np.pi % 1.0, "cyclic")
    return np.where(polarisation.dolp(light)[..., None] < LEAST_DOLP, _GREY, codes).astype(np.uint8)


def degree_bar(width: int, height: int) -> Codes:
    """The legend of `degree`: from 0 on the left to the most on the right."""
    return _coloured(np.tile(np.linspace(0.0, 1.0, width), (height, 1)), "sequential")


def angle_wheel(size: int, background: int) -> Codes:
    """The legend of `angle`: the colour on the rim is that of light that vibrates towards it."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    radius = np.hypot(x, y) / (size / 2)
    codes = _coloured(np.arctan2(-y, x) / np.pi % 1.0, "cyclic")
    ring = (radius <= 1.0) & (radius >= 0.45)
    return np.where(ring[..., None], codes, background).astype(np.uint8)


def encoded(linear: AnyArray) -> Codes:
    """Linear light, 1 is white, as 8-bit sRGB codes; what is brighter than white is white.

    Examples
    --------
    >>> encoded(np.array([0.0, 0.5, 2.0])).tolist()
    [0, 188, 255]
    """
    light = np.clip(linear, 0.0, 1.0)
    return np.rint(255 * colour_science().cctf_encoding(light, "sRGB")).astype(np.uint8)


def _coloured(share: AnyArray, table: str) -> Codes:
    """Colours (..., 3) of values 0 to 1 by a table of the page; NaN shows its first colour."""
    codes = np.frombuffer(base64.b64decode(json.loads(asset("colour_maps.json"))[table]), np.uint8)
    colours = codes.reshape(-1, 3)
    place = np.minimum((np.nan_to_num(share) * len(colours)).astype(int), len(colours) - 1)
    return colours[place]
