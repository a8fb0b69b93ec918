"""A scene: what to look at, as plain frozen data."""

from __future__ import annotations

import itertools
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from malus.scenes.camera import Camera
from malus.scenes.core.errors import InputError
from malus.scenes.core.model import Model
from malus.scenes.lights.lights import Distant, Light, turned
from malus.scenes.materials.surface import Patterned, Surface
from malus.scenes.shapes.patterns import ImageTexture
from malus.scenes.shapes.shapes import Shape
from malus.scenes.surroundings import Placed, Surroundings

LEAST_INCIDENCE = 0.01
"""Degrees between viewer and distant light that a measured material asks for."""


def _increasing(wavelengths_nm: tuple[float, ...]) -> tuple[float, ...]:
    if any(b <= a for a, b in itertools.pairwise(wavelengths_nm)):
        raise ValueError("wavelengths in increasing order")
    return wavelengths_nm


Wavelength = Annotated[float, Field(gt=100, lt=20_000)]
Wavelengths = Annotated[
    tuple[Wavelength, ...], Field(min_length=1, max_length=512), AfterValidator(_increasing)
]


class Scene(Model):
    """What to look at: shape, surface, light, camera and the centres of narrow bands in nm.

    Shape and light stand in the world, whose axes are those of the image of a camera that is not
    rolled.

    Examples
    --------
    >>> from malus.scenes import Dielectric, Sphere, Uniform
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3), light=Uniform())
    >>> len(scene.id)
    16
    """

    shape: Shape
    surface: Surface
    light: Light
    camera: Camera = Camera()
    wavelengths_nm: Wavelengths = (550.0,)
    surroundings: Surroundings | None = Field(default=None, exclude_if=lambda value: value is None)

    @model_validator(mode="after")
    def _surfaces_fit(self) -> Self:
        for placed in self.objects:
            placed.surface.albedos(self.wavelengths_nm)
            if self.surroundings and placed.surface.kind == "measured":
                raise ValueError("measured surfaces only in scenes without surroundings")
        # Where there is more to see than the own shape, that may be small.
        if not (self.surroundings or self.camera.sees_the_object):
            hint = "use more resolution, or a camera that is nearer"
            raise InputError("camera", "an object that covers a pixel", "a smaller one", hint)
        return self

    @model_validator(mode="after")
    def _coordinates_of_the_shape(self) -> Self:
        for placed in self.objects:
            pattern = placed.surface.pattern if isinstance(placed.surface, Patterned) else None
            own = isinstance(pattern, ImageTexture) and pattern.projection == "uv"
            if own and placed.shape.kind != "mesh":
                raise ValueError('projection = "uv" only on mesh files')
        return self

    @model_validator(mode="after")
    def _light_beside_camera(self) -> Self:
        straight = isinstance(self.light, Distant) and self.light.incidence_deg < LEAST_INCIDENCE
        if self.surface.kind == "measured" and straight and self.camera.fov_deg is None:
            # Mitsuba's plugin then gives NaN.
            expected = f"an incidence_deg of {LEAST_INCIDENCE} or more"
            raise ValueError(f"{expected}: a pBRDF has no frame for light from the viewer")
        return self

    @property
    def objects(self) -> tuple[Placed, ...]:
        """All that is seen: the scene's own shape at the origin, and its surroundings."""
        own = Placed(shape=self.shape, surface=self.surface)
        return (own, *(self.surroundings.objects if self.surroundings else ()))

    @property
    def label(self) -> str:
        """Name of what is seen, in tables."""
        shape = self.shape.label
        return f"{shape} in {self.surroundings.name}" if self.surroundings else shape

    @property
    def eta(self) -> NDArray[np.inexact[Any]]:
        """Relative refractive index of every band, shape (bands,).

        Complex for a conductor; NaN for a measured material whose index nobody told.
        """
        return self.surface.indices(self.wavelengths_nm)

    @property
    def lobes_known(self) -> bool:
        """Whether mirrored light can be told from light that came from inside."""
        return self.surface.kind != "measured"

    @property
    def light_in_image(self) -> Light:
        """The light in the image frame: lights stay in the world when a camera is rolled."""
        return turned(self.light, -self.camera.roll_deg)


class Sampling(Model):
    """Monte Carlo effort: samples a pixel (even, for two independent halves) and the seed.

    `max_depth` counts the straight pieces of a light path, as Mitsuba does, where a scene has
    surroundings: 2 is light that met one object, 3 light that met two. Scenes of one object are
    rendered at depth 2.

    With a `target`, samples are added only until the noise is that small: the standard error of s1
    and s2, rms over the object's pixels and the bands, over the brightest pixel, in the noisiest
    scene of a family of renders. `samples` is then the most that are taken.
    """

    samples: int = Field(default=64, ge=2, le=1 << 20, multiple_of=2)
    # The scalar variant makes 16 seeds of 32 bits of one.
    seed: int = Field(default=1, ge=0, lt=1 << 28)
    max_depth: int = Field(default=5, ge=2, le=64, exclude_if=lambda depth: depth == 5)
    target: float | None = Field(default=None, gt=0, lt=1, exclude_if=lambda error: error is None)
