"""Separate one picture into diffuse and specular light by colour.

The dichromatic model: a pixel is I = m_d c + m_s g, body colour c, light colour g. Divided by g the
specular light is white. With s the mean over the bands and u = I − s the rest, u holds diffuse
light only (the specular-free part), and |u| / s is the saturation, which specular light lowers:

    |u| = κ m_d,    s = m_d + m_s,    κ = |c/g − 1| for mean(c/g) = 1.

Every method here has to find κ of each body colour: by maximum chromaticity
(`separation_chromaticity`), by erosion along colours (`separation_suv`) or by the ratio of
intensity and range (`separation_ratio`). Grey bodies under grey light cannot be separated by
colour at all; `separate` says so instead of guessing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from malus.reconstruct.observation import Image, Inapplicable, checked_picture
from malus.reconstruct.single_image.separation_chromaticity import chromaticity_diffuse
from malus.reconstruct.single_image.separation_ratio import ratio_diffuse
from malus.reconstruct.single_image.separation_space import SourceSpace, source_space
from malus.reconstruct.single_image.separation_suv import suv_diffuse
from malus.reconstruct.single_image.value_range import all_finite, finite_pixels, unit_scale
from malus.scenes.core.arrays import BoolArray
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.registry import lookup

GREY = 0.06
"""Saturation |u|/s that noise and dispersion may cause: specular light of carbon disulfide has
0.045."""
_COLOURED = 0.05
"""Share of the lit pixels that must be more saturated than `GREY`."""


class Separation(NamedTuple):
    """I_d and I_s of one picture; they add up to the image on the mask and are zero off it.

    Attributes
    ----------
    diffuse, specular : (height, width, bands)
        In the unit of the image and its dtype, but float32 at least.

    Examples
    --------
    >>> picture = np.full((4, 4, 2), [3.0, 1.0])
    >>> separate(picture, np.ones((4, 4), bool)).specular.max().item()
    0.0
    """

    diffuse: Image
    specular: Image

    def __repr__(self) -> str:
        """Shapes of its arrays, in one line."""
        return brief_repr(self)


class SeparationMethod(NamedTuple):
    """A way to separate: `diffuse_light` takes the source space, returns m_d (height, width)."""

    name: str
    diffuse_light: Callable[[SourceSpace], Image]
    summary: str


SEPARATIONS = {
    method.name: method
    for method in (
        SeparationMethod(
            "chromaticity",
            chromaticity_diffuse,
            "maximum chromaticity-intensity space (Tan, Nishino, Ikeuchi 2004)",
        ),
        SeparationMethod("suv", suv_diffuse, "SUV space, multiscale erosion (Mallick et al. 2006)"),
        SeparationMethod(
            "ratio", ratio_diffuse, "clustered intensity ratio (after Shen and Zheng 2013)"
        ),
    )
}
"""The separations by name."""


def check_separation(name: str, parameter: str) -> None:
    """Raise InputError, which names the parameter, where there is no separation of that name."""
    lookup(name, SEPARATIONS, parameter, "the name of a separation")


def separations() -> dict[str, SeparationMethod]:
    """The methods that separate diffuse from specular light by colour, by name.

    Returns
    -------
    dict
        Of name to `SeparationMethod`, whose `summary` is one line with the source. `separate`
        takes the name.

    Examples
    --------
    >>> list(separations())
    ['chromaticity', 'suv', 'ratio']
    """
    return dict(SEPARATIONS)


def separate(
    image: Image,
    mask: BoolArray,
    illuminant: ArrayLike | None = None,
    method: str = "ratio",
    tint: ArrayLike | None = None,
) -> Separation:
    """Separate one picture into diffuse light I_d and specular light I_s by colour.

    Parameters
    ----------
    image : (height, width, bands) array
        Linear radiance in any unit, at least two bands. A pixel that is not finite counts as off
        the mask.
    mask : (height, width) bool array
        The object's pixels.
    illuminant : (bands,) array, optional
        Colour of the light; white by default. `estimate_illuminant` tells it from the picture.
    method : 'chromaticity', 'suv' or 'ratio'
    tint : (bands,) array, optional
        Colour that the surface gives to white light it mirrors:
        `malus.reconstruct.single_image.illuminant.specular_tint`. A body must be coloured in the
        light itself, not only beside this tint.

    Returns
    -------
    Separation
        `diffuse` and `specular`, (height, width, bands) each.

    Raises
    ------
    Inapplicable
        For a grey image where colour is needed, one band, a dark image, or an object without a
        finite pixel.
    InputError
        If there is no such method.
    ValueError
        If `illuminant` or `tint` is not one positive value a band.

    Notes
    -----
    Gu et al., "Reconstructing Polarisation Components from Unpolarised Images", start from I_d and
    I_s (Equations 9 to 12). The dichromatic model is Shafer's, "Using color to separate reflection
    components", Color Research and Application 10 (1985). `chromaticity`: Tan, Nishino and Ikeuchi
    (2004); `suv`: Mallick et al. (2006); `ratio`: after Shen and Zheng (2013).

    Examples
    --------
    >>> shading, specular = np.linspace(0.2, 1, 256).reshape(16, 16, 1), np.zeros((16, 16, 1))
    >>> specular[4:8, 4:8] = 0.5
    >>> parts = separate(shading * [1.5, 0.5] + specular, np.ones((16, 16), bool))
    >>> bool(np.abs(parts.specular - specular).max() < 1e-6)
    True
    """
    check_separation(method, "method")
    image, mask = checked_picture(image, mask)
    if image.shape[-1] < 2:
        raise Inapplicable("grey image where colour is needed: it has one band")
    image = np.asarray(image, np.result_type(image.dtype, np.float32))
    if not all_finite(image):
        finite = finite_pixels(image, mask)
        image, mask = np.where(finite[..., None], image, 0), mask & finite
    unit = image.dtype.type(unit_scale(float(image.max(initial=0)), image.dtype))
    parts = _separated(image if unit == 1 else image * unit, mask, illuminant, method, tint)
    return parts if unit == 1 else Separation(*(light / unit for light in parts))


def _separated(
    image: Image,
    mask: BoolArray,
    illuminant: ArrayLike | None,
    method: str,
    tint: ArrayLike | None,
) -> Separation:
    """`separate` for a finite image of floats whose squares are floats too."""
    colour = _light_colour(image, illuminant)
    space = source_space(image, mask, colour)
    _require_colour(space)
    if tint is not None:
        colour = colour * _light_colour(image, tint)
        space = source_space(image, mask, colour)
    diffuse_light = SEPARATIONS[method].diffuse_light(space)
    # Neither lobe can be negative, and both add up to the image.
    unbounded = np.clip(space.intensity - diffuse_light, 0, None)[..., None] * colour
    # In pixels too dark to have a colour, noise would pass for highlights: they are all diffuse.
    specular = np.where(space.lit[..., None], np.minimum(unbounded, np.maximum(image, 0)), 0)
    specular = specular.astype(image.dtype, copy=False)
    return Separation(np.where(mask[..., None], image, 0) - specular, specular)


def _light_colour(image: Image, illuminant: ArrayLike | None) -> Image:
    """Colour of the light (bands,), scaled to mean 1; white if None."""
    if illuminant is None:
        return np.ones(image.shape[-1], dtype=image.dtype)
    expected = f"{image.shape[-1]} positive values"
    try:
        colour = np.asarray(illuminant, dtype=image.dtype)
    except (TypeError, ValueError):
        raise ValueError(f"illuminant: expected {expected}, found {illuminant!r}") from None
    if colour.shape != image.shape[-1:] or not np.all(np.isfinite(colour) & (colour > 0)):
        raise ValueError(f"illuminant: expected {expected}, found {colour.tolist()}")
    return np.asarray(colour / colour.mean(dtype=np.float64), dtype=image.dtype)


def _require_colour(space: SourceSpace) -> None:
    """Raise Inapplicable for a picture that is dark or grey."""
    lit = space.lit
    if not lit.any():
        raise Inapplicable("the image is dark: nothing to separate")
    coloured = float(np.mean(space.chroma[lit] > GREY * space.intensity[lit]))
    if coloured < _COLOURED:
        raise Inapplicable(
            "grey image where colour is needed: "
            f"{coloured:.1%} of the lit pixels are more saturated than {GREY:g}"
        )
