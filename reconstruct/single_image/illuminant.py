"""Colour of the light, estimated from the picture itself, and the assumption behind it in words.

A colour is an array (bands,) whose mean is 1. Dividing an image by it makes the light white, so
that specular light of a dielectric has equal values in all bands.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from skimage.util import view_as_blocks

from malus.reconstruct.observation import Image, Inapplicable, checked_picture
from malus.reconstruct.single_image.value_range import all_finite
from malus.scenes.core.arrays import BoolArray, Float64Array, FloatArray
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.registry import lookup
from malus.scenes.materials.materials import FRAUNHOFER_C_NM, FRAUNHOFER_D_NM, FRAUNHOFER_F_NM

_PATCH = 8
"""Side of a patch in pixels: small beside a highlight, large beside noise."""
_STRAIGHT = 0.9
"""Least squared correlation of a patch that counts as one highlight over one colour."""
_FEWEST = 3
"""Least number of patches whose median counts as an estimate."""


class Illuminant(NamedTuple):
    """Colour of the light, and the assumption behind it.

    Attributes
    ----------
    colour : (bands,) float64 array
        Mean 1; without unit.
    assumption : str
        One sentence.

    Examples
    --------
    >>> estimate_illuminant(np.ones((4, 4, 3)), method="gray-world").assumption
    'the mean of the scene is grey'
    """

    colour: Float64Array
    assumption: str

    def __repr__(self) -> str:
        """Shapes of its arrays, in one line."""
        return brief_repr(self)


def illuminants() -> dict[str, Callable[[Image, BoolArray | None], Illuminant]]:
    """The methods that estimate the colour of the light, by name.

    Returns
    -------
    dict
        Of name to a function of an image (height, width, bands) and a mask (height, width) or
        None that returns an `Illuminant`. `estimate_illuminant` takes the name.

    Examples
    --------
    >>> list(illuminants())
    ['neutral', 'gray-world', 'shades-of-grey', 'highlights']
    """
    return dict(ILLUMINANTS)


def estimate_illuminant(
    image: Image, mask: BoolArray | None = None, method: str = "highlights"
) -> Illuminant:
    """Estimate the colour of the light from one picture.

    Parameters
    ----------
    image : (height, width, bands) array
        Linear radiance in any unit.
    mask : (height, width) bool array, optional
        The object's pixels; all by default.
    method : 'neutral', 'gray-world', 'shades-of-grey' or 'highlights'

    Returns
    -------
    Illuminant
        `colour` (bands,), mean 1, and the `assumption` behind it in words.

    Raises
    ------
    Inapplicable
        If a band is dark, or, for 'highlights', fewer than three patches of 8 × 8 pixels hold a
        highlight over a coloured body.
    InputError
        If there is no such method.

    Notes
    -----
    'gray-world': Buchsbaum (1980), the choice of Gu, Huynh and Robles-Kelly (their reference 23);
    'shades-of-grey': Finlayson and Trezzi (2004); 'highlights': Tan, Nishino and Ikeuchi (2004),
    Equation 11; 'neutral' takes the light for white.

    Examples
    --------
    >>> picture = np.full((8, 8, 2), [3.0, 1.0])
    >>> estimate_illuminant(picture, method="gray-world").colour.tolist()
    [1.5, 0.5]
    """
    estimator = lookup(method, ILLUMINANTS, "method", "the name of an estimator")
    picture, inside = checked_picture(image, np.ones(np.shape(image)[:2]) if mask is None else mask)
    return estimator(picture, None if mask is None else inside)


def neutral(image: Image, mask: BoolArray | None = None) -> Illuminant:
    """White light, for a picture that was balanced before.

    Examples
    --------
    >>> neutral(np.ones((4, 4, 3))).colour.tolist()
    [1.0, 1.0, 1.0]
    """
    return Illuminant(np.ones(image.shape[-1]), "the light is white: the image is balanced")


def shades_of_grey(image: Image, mask: BoolArray | None = None, order: float = 6.0) -> Illuminant:
    """Minkowski mean of every band; order 1 is Gray World and order ∞ is White Patch.

    Parameters
    ----------
    image : (height, width, bands) array, linear radiance
    mask : (height, width) bool array, optional
    order : float >= 1

    Raises
    ------
    Inapplicable
        If a band is dark everywhere.

    Notes
    -----
    Finlayson and Trezzi, "Shades of gray and colour constancy", Color Imaging Conference (2004).

    Examples
    --------
    >>> shades_of_grey(np.full((4, 4, 2), [3.0, 1.0])).colour.round(6).tolist()
    [1.5, 0.5]
    """
    pixels = _lit(image, mask)
    peak = pixels.max()
    mean = np.mean((pixels / peak) ** order, axis=0) ** (1.0 / order)
    return _normalised(mean, f"the Minkowski mean of order {order:g} of the scene is grey")


def gray_world(image: Image, mask: BoolArray | None = None) -> Illuminant:
    """Mean of every band: the choice of Gu, Huynh and Robles-Kelly (their reference 23).

    Arguments and errors as in `shades_of_grey`. On an object of one colour it returns the colour
    of the object, so that a separation by colour finds nothing to separate.

    Notes
    -----
    Buchsbaum, "A spatial processor model for object colour perception", J. Franklin Inst. (1980).

    Examples
    --------
    >>> gray_world(np.full((4, 4, 2), [3.0, 1.0])).colour.tolist()
    [1.5, 0.5]
    """
    return _normalised(_lit(image, mask).mean(axis=0), "the mean of the scene is grey")


def from_highlights(image: Image, mask: BoolArray | None = None) -> Illuminant:
    """Colour of the picture's own highlights, in inverse-intensity chromaticity space.

    Where diffuse light hardly changes within a patch and the highlight does, the chromaticity of a
    band is a straight line over 1 / (sum of the bands), and meets the axis at the light's
    chromaticity. The median over all straight patches is the estimate.

    Raises
    ------
    Inapplicable
        If the image is dark or grey, or fewer than three patches hold a highlight over a colour.

    Notes
    -----
    Tan, Nishino and Ikeuchi, "Color constancy through inverse-intensity chromaticity space",
    JOSA A 21 (2004), Equation 11; medians of patches stand for their Hough transform.

    Examples
    --------
    >>> highlight = np.linspace(0, 3, 64).reshape(8, 8, 1) * [1.2, 0.8]
    >>> picture = np.tile(highlight + [0.3, 0.9], (2, 2, 1))
    >>> from_highlights(picture).colour.round(3).tolist()
    [1.2, 0.8]
    """
    _lit(image, mask)
    patches = _patches(image, mask)
    total = patches.sum(axis=-1, keepdims=True)
    chromaticity = patches / np.maximum(total, np.finfo(np.float64).tiny)
    intercepts, squared = _lines(1.0 / np.maximum(total, 1e-12 * total.max()), chromaticity)
    physical = np.all(intercepts > 0, axis=-1) & np.all(intercepts < 1, axis=-1)
    bright = total.mean(axis=(1, 2, 3)) > np.median(total)
    straight = physical & (squared > _STRAIGHT) & bright
    if straight.sum() < _FEWEST:
        raise Inapplicable(
            f"no highlight over a coloured body: {straight.sum()} of the {_FEWEST} patches needed"
        )
    return _normalised(
        np.median(intercepts[straight], axis=0), "highlights have the colour of the light"
    )


def specular_tint(
    wavelengths_nm: tuple[float, ...], eta: float = 1.5, abbe: float = 45.0
) -> Float64Array:
    """Colour (bands,), mean 1, that dispersion gives to specular light of a typical dielectric.

    Separations take highlights to be exactly as white as the light. A plastic reflects blue a few
    percent better than red, and this tint of a substance with Cauchy dispersion corrects most of it
    without knowing the substance. Only for narrow bands whose wavelengths are known.

    Notes
    -----
    F ∝ ((η − 1)/(η + 1))² at moderate incidence, so that d ln F / dη = 4 / (η² − 1).

    Examples
    --------
    >>> specular_tint((450.0, 650.0)).round(3).tolist()
    [1.024, 0.976]
    """
    inverse = 1.0 / np.square(np.asarray(wavelengths_nm, dtype=np.float64))
    lines = FRAUNHOFER_F_NM**-2 - FRAUNHOFER_C_NM**-2
    index = eta + (eta - 1.0) / abbe * (inverse - FRAUNHOFER_D_NM**-2) / lines
    reflectance = np.square((index - 1.0) / (index + 1.0))
    return np.asarray(reflectance / reflectance.mean(), dtype=np.float64)


ILLUMINANTS: dict[str, Callable[[Image, BoolArray | None], Illuminant]] = {
    "neutral": neutral,
    "gray-world": gray_world,
    "shades-of-grey": shades_of_grey,
    "highlights": from_highlights,
}
"""The estimators by name."""


def _lit(image: Image, mask: BoolArray | None) -> Float64Array:
    """Radiances (n, bands) of the object's finite pixels; Inapplicable if one band has no light."""
    chosen = image[mask] if mask is not None else image.reshape(-1, image.shape[-1])
    if not all_finite(chosen):
        chosen = chosen[np.isfinite(chosen).all(axis=-1)]
        if not len(chosen):
            raise Inapplicable("no pixel is finite: no light to estimate a colour from")
    pixels = np.clip(np.asarray(chosen, dtype=np.float64), 0.0, None)
    if pixels.size == 0 or not np.all(pixels.max(axis=0) > 0):
        raise Inapplicable("the image is dark: no light to estimate a colour from")
    return pixels


def _normalised(colour: FloatArray, assumption: str) -> Illuminant:
    """The estimate with its colour scaled to mean 1."""
    return Illuminant(np.asarray(colour / colour.mean(), dtype=np.float64), assumption)


def _patches(image: Image, mask: BoolArray | None) -> Float64Array:
    """Patches (n, pixels, 1, bands) that are finite and lie entirely on the object."""
    height, width = (side // _PATCH * _PATCH for side in image.shape[:2])
    if min(height, width) == 0:
        raise Inapplicable(f"the image is smaller than a patch of {_PATCH} pixels")
    bands = image.shape[-1]
    cropped = np.ascontiguousarray(image[:height, :width], dtype=np.float64)
    blocks = view_as_blocks(cropped, (_PATCH, _PATCH, bands)).reshape(-1, _PATCH**2, 1, bands)
    usable = np.isfinite(cropped).all(axis=-1)
    if mask is not None:
        usable &= mask[:height, :width]
    whole = view_as_blocks(usable, (_PATCH, _PATCH)).all(axis=(2, 3)).ravel()
    chosen = np.asarray(blocks[whole])
    if not len(chosen):
        raise Inapplicable(f"no patch of {_PATCH} pixels lies on the object")
    return chosen


def _lines(x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Intercepts (n, bands) of y over x in n patches, and their best squared correlations (n,)."""
    x, y = x[:, :, 0, :], y[:, :, 0, :]
    dx, dy = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
    spread = (dx * dx).sum(axis=1)
    cross = (dx * dy).sum(axis=1)
    variance = (dy * dy).sum(axis=1)
    slope = cross / np.maximum(spread, np.finfo(np.float64).tiny)
    intercept = y.mean(axis=1) - slope * x.mean(axis=1)
    varies = variance > 1e-8 * y.shape[1]
    correlation = cross**2 / np.maximum(spread * variance, np.finfo(np.float64).tiny)
    # A band whose chromaticity does not vary says nothing; the band of best correlation decides.
    return intercept, np.where(varies, correlation, 0.0).max(axis=-1)
