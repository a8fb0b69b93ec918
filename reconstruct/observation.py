"""The input and the output of a method: `Observation` and `Components`. No truth is among them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from malus.scenes import polarisation
from malus.scenes.core.arrays import BoolArray, FloatArray, NumberArray
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.errors import InputError
from malus.scenes.lights.lights import Light
from malus.scenes.materials.surface import Distribution

Image = FloatArray
"""An image (height, width, bands) or its pixels (pixels, bands), float32 or float64."""


class Inapplicable(ValueError):
    """A method cannot work on this observation; the message says why. It is no mistake of input.

    Examples
    --------
    >>> Observation(np.ones((1, 1, 1)), np.ones((1, 1), bool)).require("eta")
    Traceback (most recent call last):
        ...
    malus.reconstruct.observation.Inapplicable: eta is not known
    """


def as_mask(values: object) -> BoolArray:
    """A mask as True and False; numbers 0 and 1, or 0 and 255 as pictures have them, are taken so.

    Other arrays would be taken for indices of pixels.

    Raises
    ------
    InputError
        For other numbers.

    Examples
    --------
    >>> as_mask(np.array([[0, 255]], np.uint8)).tolist()
    [[False, True]]
    """
    array = np.asarray(values)
    if array.dtype == np.bool_:
        return array
    levels = set(np.unique(array).tolist()) if array.dtype.kind in "iuf" else {None}
    if levels <= {0, 1} or levels <= {0, 255}:
        return np.asarray(array != 0)
    expected, hint = "True and False, 0 and 1, or 0 and 255", "compare it with a threshold"
    raise InputError("mask", expected, f"other values of {array.dtype}", hint)


_ARRAYS = ("image", "specular", "diffuse", "normals", "view_direction", "eta", "illuminant")
"""Attributes of an Observation that are arrays; lists are taken for them."""

INPUTS = frozenset(
    ("specular", "diffuse", "normals", "eta", "alpha", "distribution", "light", "illuminant")
)
"""Names of all that a method can be told besides the picture."""


@dataclass(frozen=True)
class Observation:
    """One unpolarised picture and what a method is told besides; None where it is not told.

    Attributes
    ----------
    image : (height, width, bands)
        Radiance without a polariser.
    mask : (height, width) bool
        The object's pixels.
    wavelengths_nm : (bands,) or None
        Centres of the bands.
    specular, diffuse : (height, width, bands) or None
        I_s and I_d, radiance of both lobes.
    normals : (height, width, 3) or None
        Unit surface normals in the image frame: x right, y up, z towards the viewer.
    view_direction : (height, width, 3) or None
        Unit vectors from the surface to the camera in the image frame; None is an orthographic
        camera, (0, 0, 1) everywhere.
    eta : (bands,) or (height, width, bands) or None
        Relative refractive index, complex for metals.
    alpha : float or (height, width) or None
        Roughness of the facets; σ = 1/alpha². Of anisotropic ones the geometric mean of both.
    distribution : 'beckmann' or 'ggx' or None
        How the facets' normals are distributed. Methods take them for Beckmann's where they are
        not told, and where surfaces of the image differ; `shadowed` and `lights` know GGX.
    light : Light or None
        A light of `malus.scenes`, in the image frame.
    illuminant : (bands,) or None
        Colour of the light, mean 1.

    Raises
    ------
    ValueError
        If an array's shape is not that of the image; the message names the array and both shapes.

    Examples
    --------
    >>> picture = Observation(np.ones((2, 3, 1)), np.ones((2, 3), bool), eta=np.array([1.5]))
    >>> picture.require("eta").tolist()
    [1.5]
    """

    __repr__ = brief_repr

    image: Image
    mask: BoolArray
    wavelengths_nm: tuple[float, ...] | None = None
    specular: Image | None = None
    diffuse: Image | None = None
    normals: Image | None = None
    view_direction: Image | None = None
    eta: NumberArray | None = None
    alpha: float | Image | None = None
    light: Light | None = None
    distribution: Distribution | None = None
    illuminant: FloatArray | None = None

    def __post_init__(self) -> None:
        """Check that the arrays belong together.

        Raises
        ------
        ValueError
            Naming the array, the shape expected and the shape found; for another distribution.
        """
        if self.distribution not in (None, *get_args(Distribution)):
            names = " or ".join(get_args(Distribution))
            raise ValueError(f"distribution: expected {names}, found {self.distribution!r}")
        for name in _ARRAYS:
            value = getattr(self, name)
            if value is not None and not isinstance(value, np.ndarray):
                object.__setattr__(self, name, np.asarray(value))
        if self.light is not None and not hasattr(self.light, "kind"):
            raise ValueError(f"light: expected one of malus.scenes, found {self.light!r}")
        if np.ndim(self.image) != 3:
            raise ValueError(f"image: expected (height, width, bands), found {self.image.shape}")
        height, width, bands = self.image.shape
        allowed_shapes: dict[str, list[tuple[int, ...]]] = {
            "mask": [(height, width)],
            "specular": [(height, width, bands)],
            "diffuse": [(height, width, bands)],
            "normals": [(height, width, 3)],
            "view_direction": [(height, width, 3)],
            "eta": [(bands,), (height, width, bands)],
            "alpha": [(), (height, width)],
            "illuminant": [(bands,)],
        }
        for name, shapes in allowed_shapes.items():
            value = getattr(self, name)
            if value is not None and np.shape(value) not in shapes:
                wanted = " or ".join(map(str, shapes))
                raise ValueError(f"{name}: expected shape {wanted}, found {np.shape(value)}")
        object.__setattr__(self, "mask", as_mask(self.mask))

    def with_own_arrays(self) -> Self:
        """The same with copies of all arrays: what is written into them changes no others.

        Examples
        --------
        >>> picture = np.ones((1, 1, 1))
        >>> Observation(picture, np.ones((1, 1), bool)).with_own_arrays().image is picture
        False
        """
        given = {field.name: getattr(self, field.name) for field in fields(self)}
        own: dict[str, Any] = {
            name: value.copy() for name, value in given.items() if isinstance(value, np.ndarray)
        }
        return replace(self, **own)

    def require(self, name: str) -> Any:
        """Value of an attribute that the method cannot do without.

        Raises
        ------
        Inapplicable
            If it is None.
        """
        value = getattr(self, name)
        if value is None:
            raise Inapplicable(f"{name} is not known")
        return value


def checked_picture(image: ArrayLike, mask: object) -> tuple[Image, BoolArray]:
    """A picture and its mask as arrays that belong together.

    Raises
    ------
    InputError
        For an image that is not (height, width, bands), or a mask of another size.

    Examples
    --------
    >>> image, mask = checked_picture([[[0.5], [1.0]]], [[0, 1]])
    >>> image.shape, mask.tolist()
    ((1, 2, 1), [[False, True]])
    """
    values, inside = np.asarray(image), as_mask(mask)
    if values.ndim != 3:
        hint = "grey pictures have one band: image[..., None]"
        raise InputError("image", "(height, width, bands)", f"shape {values.shape}", hint)
    if inside.shape != values.shape[:2]:
        expected = f"shape {values.shape[:2]}, as the image has"
        raise InputError("mask", expected, f"{inside.shape}", "give one that belongs to it")
    return values, inside


@dataclass(frozen=True)
class Components:
    """Radiance through a turning polariser: one sinusoid for each pixel and band.

    Stored as the linear Stokes vector, which adds over lobes of different phase; the extremes
    and the phase of the paper's Equation 1 follow from it.

    Attributes
    ----------
    image : (height, width, bands)
        I = I_max + I_min.
    s1, s2 : (height, width, bands)
        Linear Stokes components, reference axis +x.
    valid : (height, width) bool or None
        False where the inputs were no physical values; the components are zero there. None means
        that the method does not tell.
    converged : bool or None
        Whether the search behind the estimate ended where it explains the image; None means that
        nothing was searched.
    deviation : (height, width, bands) or None
        Standard deviation of s1/image, and of s2/image, that the method states for its own error.
        None means that it does not tell.

    Examples
    --------
    >>> pixel = np.ones((1, 1, 1))
    >>> light = Components(image=pixel, s1=0.5 * pixel, s2=0 * pixel)
    >>> light.i_max.item(), light.i_min.item(), light.polarised(0.0).item()
    (0.75, 0.25, 0.25)
    """

    __repr__ = brief_repr

    image: Image
    s1: Image
    s2: Image
    valid: BoolArray | None = None
    converged: bool | None = None
    deviation: Image | None = None

    @classmethod
    def from_extremes(cls, i_max: Image, i_min: Image, phase: Image) -> Self:
        """From I_max, I_min and ψ (radians, from the vertical), each (height, width, bands).

        I_min and ψ may have a single band that stands for all.

        Raises
        ------
        ValueError
            If one has another shape; the message names it.

        Examples
        --------
        >>> pixel = np.ones((1, 1, 1))
        >>> Components.from_extremes(3 * pixel, pixel, 0 * pixel).image.item()
        4.0
        """
        shape = np.shape(i_max)
        for name, values in (("i_min", i_min), ("phase", phase)):
            own = np.shape(values)
            if len(own) != len(shape) or any(
                n not in (1, m) for n, m in zip(own, shape, strict=True)
            ):
                raise ValueError(f"{name}: expected shape {shape}, as of i_max, found {own}")
        stokes = polarisation.stokes_from_extremes(i_max, i_min, phase)
        return cls(stokes[..., 0], stokes[..., 1], stokes[..., 2])

    def invalid(self, mask: BoolArray) -> int:
        """Number of the mask's pixels that are not `valid`; 0 where the method does not tell.

        Examples
        --------
        >>> image, mask = np.ones((1, 2, 1)), np.array([[True, True]])
        >>> Components(image, image, image, valid=np.array([[True, False]])).invalid(mask)
        1
        """
        return 0 if self.valid is None else int(np.count_nonzero(as_mask(mask) & ~self.valid))

    @property
    def stokes(self) -> Image:
        """Stokes image (height, width, bands, 3)."""
        return np.stack([self.image, self.s1, self.s2], axis=-1)

    @property
    def i_max(self) -> Image:
        """Largest radiance behind a turning polariser."""
        return polarisation.extremes(self.stokes)[0]

    @property
    def i_min(self) -> Image:
        """Smallest radiance behind a turning polariser."""
        return polarisation.extremes(self.stokes)[1]

    @property
    def phase(self) -> Image:
        """ψ of Equation 1: polariser angle of I_max, radians from the vertical, in [0, π)."""
        return polarisation.phase(self.stokes)

    @property
    def dolp(self) -> Image:
        """Degree of linear polarisation (height, width, bands); 0 where there is no light."""
        return polarisation.dolp(self.stokes)

    @property
    def aolp(self) -> Image:
        """Angle of linear polarisation (height, width, bands): radians in [0, π), from +x."""
        return polarisation.aolp(self.stokes)

    def polarised(self, angle_deg: float) -> Image:
        """Image (height, width, bands) through a polariser at ϑ, degrees: Equation 1."""
        return polarisation.polarised(self.stokes, angle_deg)
