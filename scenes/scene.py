"""A scene as frozen data: shape, surface, light, camera, bands and surroundings."""

from __future__ import annotations

import itertools
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from malus.scenes.camera import Camera
from malus.scenes.core.arrays import NumberArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.model import Model
from malus.scenes.lights.lights import Distant, Light, rotated, turned
from malus.scenes.lights.polarised import is_polarised
from malus.scenes.materials.surface import (
    Distribution,
    Patterned,
    Surface,
    anisotropic,
    by_band,
    has_metal,
)
from malus.scenes.shapes.patterns import ImageTexture
from malus.scenes.shapes.shapes import CONVEX, Shape
from malus.scenes.surroundings import Placed, Surroundings

LEAST_INCIDENCE = 0.01
"""Least angle in degrees between viewer and distant light for a measured material."""


DEPTH_AMONG_OBJECTS = 5
"""Depth of light paths in scenes with surroundings, unless a sampling names another."""

WITH_TANGENTS = ("sphere", "plane", "mesh")
"""Kinds of shapes with coordinates, whose tangent dp/du anisotropic facets refer to."""


def _increasing(wavelengths_nm: tuple[float, ...]) -> tuple[float, ...]:
    if any(b <= a for a, b in itertools.pairwise(wavelengths_nm)):
        raise ValueError("wavelengths in increasing order")
    # Files name bands to a millionth of a nanometre.
    if any(b - a < 1e-5 for a, b in itertools.pairwise(wavelengths_nm)):
        raise ValueError("wavelengths at least 1e-5 nm apart")
    return wavelengths_nm


Wavelength = Annotated[float, Field(gt=100, lt=20_000)]
Wavelengths = Annotated[
    tuple[Wavelength, ...], Field(min_length=1, max_length=512), AfterValidator(_increasing)
]


class Scene(Model):
    """One object under one light before a camera, with the centres of narrow bands in nm.

    Shape and light are given in world coordinates, whose axes are those of the image of a camera
    that is neither moved nor rolled. `surroundings` are further objects.

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
            if by_band(placed.surface):  # named ones of stored scenes are taken as they are
                placed.surface.indices(self.wavelengths_nm)
            if self.surroundings and placed.surface.kind == "measured":
                expected, hint = (
                    "measured surfaces only in scenes without surroundings",
                    "choose one",
                )
                raise InputError("surface", expected, placed.surface.label, hint)
        # Among surroundings the scene's own shape may be small.
        if not (self.surroundings or self.camera.sees_the_object):
            hint = "use more resolution, or a camera that is nearer"
            raise InputError("camera", "an object that covers a pixel", "a smaller one", hint)
        return self

    @model_validator(mode="after")
    def _coordinates_of_the_shape(self) -> Self:
        for placed in self.objects:
            pattern = placed.surface.pattern if isinstance(placed.surface, Patterned) else None
            by_texture = isinstance(pattern, ImageTexture) and pattern.projection == "uv"
            if by_texture and placed.shape.kind != "mesh":
                hint = "choose planar or spherical"
                expected = 'projection = "uv" only on mesh files'
                raise InputError("pattern", expected, placed.shape.kind, hint)
        return self

    @model_validator(mode="after")
    def _tangents_of_the_shape(self) -> Self:
        for placed in self.objects:
            if anisotropic(placed.surface) and placed.shape.kind not in WITH_TANGENTS:
                expected = f"two alphas on one of {', '.join(WITH_TANGENTS)}"
                hint = "only these have a tangent; choose one alpha"
                raise InputError("surface", expected, placed.shape.kind, hint)
        return self

    @model_validator(mode="after")
    def _light_beside_camera(self) -> Self:
        light = self.light_in_image
        if self.surface.kind != "measured" or self.camera.fov_deg is not None:
            return self
        if isinstance(light, Distant) and light.incidence_deg < LEAST_INCIDENCE:
            # Mitsuba's plugin then gives NaN.
            expected = f"an incidence_deg of {LEAST_INCIDENCE} or more between viewer and light"
            hint = "move the lamp or the camera: a pBRDF has no frame for light from the viewer"
            raise InputError("light", expected, f"{light.incidence_deg:g}", hint)
        return self

    @property
    def objects(self) -> tuple[Placed, ...]:
        """All objects: the scene's own shape at the origin, then its surroundings."""
        own = Placed(shape=self.shape, surface=self.surface)
        return (own, *(self.surroundings.objects if self.surroundings else ()))

    @property
    def label(self) -> str:
        """Name of the shape, its surroundings and where a moved camera stands, in tables."""
        shape = self.shape.label
        whole = f"{shape} in {self.surroundings.name}" if self.surroundings else shape
        return whole + self.camera.label

    @property
    def eta(self) -> NumberArray:
        """Relative refractive index of every band, shape (bands,).

        Complex for a conductor; NaN for a measured material of unknown index.
        """
        return self.surface.indices(self.wavelengths_nm)

    @property
    def lobes_known(self) -> bool:
        """Whether specular and diffuse light can be told apart: not for a measured material."""
        return self.surface.kind != "measured"

    @property
    def distribution(self) -> Distribution | None:
        """Distribution of the facets of all objects; None where they differ or nobody knows."""
        names = {placed.surface.distribution for placed in self.objects}
        return names.pop() if len(names) == 1 else None

    @property
    def light_in_image(self) -> Light:
        """The light in the image frame, turned against where the camera stands and its roll."""
        if self.camera.moved:
            return rotated(self.light, self.camera.axes)
        return turned(self.light, -self.camera.roll_deg)


def may_be_circular(scene: Scene, depth: int) -> bool:
    """Whether the fourth Stokes component, s3, can be non-zero in the image of a scene.

    That takes light that arrives polarised, from the lamp or by an earlier reflection, at a surface
    that shifts the phases of its two directions against each other: a metal. A dielectric shifts
    none without total reflection, which its index above 1 excludes, and diffuse light is
    depolarised.

    Parameters
    ----------
    scene : Scene
    depth : int
        Most straight pieces of a light path, `Sampling.depth`.

    Examples
    --------
    >>> from malus.scenes import Conductor, Dielectric, Torus, Uniform
    >>> gold = Conductor(material="gold", alpha=0.3)
    >>> may_be_circular(Scene(shape=Torus(), surface=gold, light=Uniform()), depth=3)
    True
    >>> paint = Dielectric(eta=1.5, alpha=0.3)
    >>> may_be_circular(Scene(shape=Torus(), surface=paint, light=Uniform()), depth=3)
    False
    """
    arrives_polarised = depth > 2 or is_polarised(scene.light)
    return arrives_polarised and any(has_metal(placed.surface) for placed in scene.objects)


class Sampling(Model):
    """Effort of a Monte Carlo render: samples a pixel (even, for two independent halves), seed.

    `max_depth` counts the straight pieces of a light path, as Mitsuba does: 2 is light from one
    reflection, 3 from two. Left out, it is 5 where a scene has surroundings, and 2 for one object,
    which may light itself too: in its hollows, where `max_depth` is larger. `depth` tells.

    With a `target`, samples are added only until the noise is that small: the standard error of s1
    and s2, rms over the object's pixels and the bands, over the brightest pixel, in the noisiest
    scene of a family of renders. `samples` is then the most that are taken.

    Examples
    --------
    >>> Sampling(samples=64, seed=2).samples
    64
    """

    samples: int = Field(default=64, ge=2, le=1 << 20, multiple_of=2)
    # The scalar variant makes 16 seeds of 32 bits of one.
    seed: int = Field(default=1, ge=0, lt=1 << 28)
    max_depth: int | None = Field(default=None, ge=2, le=64, exclude_if=lambda depth: depth is None)
    target: float | None = Field(default=None, gt=0, lt=1, exclude_if=lambda error: error is None)

    def depth(self, scene: Scene) -> int:
        """Most straight pieces of a light path in a scene.

        A sphere alone lights no point of itself, so that more than 2 would change nothing.

        Examples
        --------
        >>> from malus.scenes import Dielectric, Sphere, Torus, Uniform
        >>> paint = Dielectric(eta=1.5, alpha=0.3)
        >>> ring = Scene(shape=Torus(), surface=paint, light=Uniform())
        >>> ball = Scene(shape=Sphere(), surface=paint, light=Uniform())
        >>> Sampling(max_depth=4).depth(ring), Sampling(max_depth=4).depth(ball)
        (4, 2)
        >>> Sampling().depth(ring)
        2
        """
        if scene.surroundings is not None:
            return self.max_depth or DEPTH_AMONG_OBJECTS
        return 2 if scene.shape.kind in CONVEX else self.max_depth or 2
