"""Lights: with a flat spectrum, far away, and unpolarised unless they say otherwise."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.model import Model
from malus.scenes.core.named_file import NamedFile
from malus.scenes.lights.angles import (
    about_axis,
    direction_at,
    incidence_and_azimuth,
    turns,
)
from malus.scenes.lights.labels import other_keys
from malus.scenes.polarisation import polariser_angle_deg, polariser_axis

LEAST_STRENGTH, MOST_STRENGTH = 1e-9, 1e9
Strength = Annotated[float, Field(ge=LEAST_STRENGTH, le=MOST_STRENGTH)]
"""Radiance or irradiance of a light; its square and its inverse must fit into float32."""


Turn = Annotated[float, Field(ge=-360, le=360, exclude_if=lambda turn: turn == 0.0)]
"""An angle of a light in degrees; at 0 it is left out, so that scenes keep their id."""


class Polariser(Model):
    """A linear polariser before a lamp.

    `angle_deg` is that of its transmission axis, as a camera beside the lamp that looks at the
    object displays it: anticlockwise from the vertical, which is the world's y axis (for a lamp
    straight above −z, straight below +z). Before a lamp at the camera it therefore counts as a
    polariser before the camera does: both pass light at equal angles, and are crossed 90° apart.
    `degree` is the degree of polarisation of the light that leaves it: 1 behind an ideal one.

    Examples
    --------
    >>> Distant(incidence_deg=0, polarised=Polariser(angle_deg=30)).label
    'distant 0° polarised 30°'
    """

    angle_deg: float = Field(default=0.0, ge=-360, le=360)
    degree: float = Field(default=1.0, gt=0, le=1)

    @property
    def label(self) -> str:
        """End of a light's name in tables."""
        share = "" if self.degree == 1.0 else f" to {self.degree:g}"
        return f" polarised {self.angle_deg:g}°{share}"


class SkyPolarisation(Model):
    """The polarisation of a clear sky, whose light is sunlight scattered once: Rayleigh's pattern.

    It oscillates across the plane of sun, sky and observer; its degree is
    `degree` · sin²γ / (1 + cos²γ) at the angle γ from the sun, largest 90° away: see
    `malus.scenes.lights.polarised`.

    Examples
    --------
    >>> Sky(polarised=SkyPolarisation(degree=0.7)).label
    'sky 45° polarised to 0.7'
    """

    degree: float = Field(default=0.8, gt=0, le=1)

    @property
    def label(self) -> str:
        """End of a light's name in tables."""
        return f" polarised to {self.degree:g}"


class Uniform(Model):
    """Unpolarised light of equal radiance from every direction.

    Examples
    --------
    >>> Uniform().kind
    'uniform'
    """

    kind: Literal["uniform"] = "uniform"
    radiance: Strength = 1.0

    @property
    def label(self) -> str:
        """Name in tables."""
        return self.kind + other_keys(self)


class Distant(Model):
    """Parallel light, unpolarised or `polarised` by a polariser before it.

    `incidence_deg` is the angle between the direction to the light and the world's z axis, where
    an unmoved camera stands, `azimuth_deg` that of its projection on the image of such a camera,
    anticlockwise from +x. An irradiance of π makes a white Lambertian surface that faces the light
    as bright as under the uniform light of radiance 1; it is that of the light which leaves the
    polariser.

    Examples
    --------
    >>> Distant(incidence_deg=60).label
    'distant 60°'
    >>> Distant(incidence_deg=60, azimuth_deg=90).label
    'distant 60° azimuth 90°'
    """

    kind: Literal["distant"] = "distant"
    incidence_deg: float = Field(ge=0, lt=180)
    azimuth_deg: float = Field(default=35.0, ge=-360, le=360)
    irradiance: Strength = math.pi
    polarised: Polariser | None = Field(default=None, exclude_if=lambda value: value is None)

    @property
    def label(self) -> str:
        """Name in tables."""
        named = f"distant {self.incidence_deg:g}°" + _how(self.polarised)
        return named + other_keys(self, "incidence_deg", "polarised")

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector towards the light in the world.

        Examples
        --------
        >>> Distant(incidence_deg=90, azimuth_deg=90).direction[1]
        1.0
        """
        return direction_at(self.incidence_deg, self.azimuth_deg)

    @classmethod
    def towards(cls, direction: Iterable[float], irradiance: float = math.pi) -> Self:
        """Light from the direction of a vector (x, y, z) of any length but 0.

        Straight from behind is a billionth of a degree beside it.

        Examples
        --------
        >>> Distant.towards((0, 2, 2)).incidence_deg
        45.0
        """
        return cls.model_validate(incidence_and_azimuth(direction) | {"irradiance": irradiance})


class Area(Model):
    """A round lamp far away, equally bright all over, that subtends a cone of directions.

    `half_angle_deg` is the cone's half angle, the other angles are those of its axis as for
    `Distant`. A flat polariser before it faces the object; what crosses it obliquely oscillates
    across its absorbing axis, as behind a sheet polariser.

    Examples
    --------
    >>> Area(incidence_deg=60, half_angle_deg=15).label
    'area 60° half angle 15°'
    """

    kind: Literal["area"] = "area"
    incidence_deg: float = Field(ge=0, lt=180)
    azimuth_deg: float = Field(default=35.0, ge=-360, le=360)
    half_angle_deg: float = Field(default=20.0, gt=0, le=80)
    radiance: Strength = 8.0
    polarised: Polariser | None = Field(default=None, exclude_if=lambda value: value is None)

    @property
    def label(self) -> str:
        """Name in tables."""
        named = f"area {self.incidence_deg:g}°" + _how(self.polarised)
        return named + other_keys(self, "incidence_deg", "polarised")

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector towards the middle of the lamp in the world."""
        return direction_at(self.incidence_deg, self.azimuth_deg)


class AllAround(Model):
    """How a light from all around is turned in the world: about y, then about x, then about z.

    Attributes
    ----------
    heading_deg : turn about the vertical; its front, in which the camera stands, goes to the right
    tilt_deg : turn about +x; its top comes towards the viewer
    turn_deg : turn about the viewing axis, anticlockwise in the image of an unmoved camera

    Examples
    --------
    >>> (AllAround(tilt_deg=90).rotation @ [0, 1, 0]).round(9).tolist()
    [0.0, 0.0, 1.0]
    """

    turn_deg: Turn = 0.0
    tilt_deg: Turn = 0.0
    heading_deg: Turn = 0.0

    @property
    def unturned(self) -> Self:
        """The same light before it is turned: it has the same map, which is read once.

        Examples
        --------
        >>> Environment(turn_deg=20, heading_deg=30).unturned == Environment()
        True
        """
        return self.model_copy(update=dict.fromkeys(AllAround.model_fields, 0.0))

    @property
    def rotation(self) -> Float64Array:
        """Rotation matrix (3, 3) from the light's own axes to the world."""
        return (
            about_axis(2, self.turn_deg)
            @ about_axis(0, self.tilt_deg)
            @ about_axis(1, self.heading_deg)
        )


class Environment(NamedFile, AllAround):
    """Light from all around: a radiance map that malus brings, or an EXR, HDR or PFM file.

    Maps are equirectangular with y up: see `malus.scenes.lights.environment`, and turned as
    `AllAround` says.

    Examples
    --------
    >>> Environment().kind
    'environment'
    """

    kind: Literal["environment"] = "environment"
    name: str = Field(default="studio", min_length=1)
    file_kind: ClassVar[str] = "radiance map"
    file_key: ClassVar[str] = "name"

    @property
    def file_name(self) -> str | None:
        """The map's path, unless malus brings it."""
        return None if self.name == "studio" else self.name

    @property
    def label(self) -> str:
        """Name in tables; maps of one name in different folders differ in their digest."""
        digest = f" {self.digest[:4]}" if self.digest else ""
        return f"environment {Path(self.name).stem}{digest}" + other_keys(self, "name")


class Sky(AllAround):
    """A clear sky by day, with its sun or without, above a dark ground; y is up.

    The model of Hosek and Wilkie, as Mitsuba's: see `malus.scenes.lights.sky`. `sun_azimuth_deg`
    counts from straight behind the viewer, over the right, to straight ahead at 180. `turbidity` is
    2 for clear air, 10 for haze. Like every light the sky has one radiance for all bands, that of
    its light at `wavelength_nm`: its colours take a scene for every wavelength. It is unpolarised
    unless it is `polarised`; the light of the sun itself always is. Lower than 2° and higher than
    88° the sun is as bright as there, where the model's table ends. `AllAround` says how the sky is
    turned.

    Examples
    --------
    >>> Sky().kind
    'sky'
    """

    kind: Literal["sky"] = "sky"
    sun_elevation_deg: float = Field(default=45.0, ge=0, le=90)
    sun_azimuth_deg: float = Field(default=60.0, ge=-360, le=360)
    turbidity: float = Field(default=3.0, ge=1, le=10)
    sun: bool = True
    wavelength_nm: float = Field(default=550.0, ge=400, le=720)
    polarised: SkyPolarisation | None = Field(default=None, exclude_if=lambda value: value is None)

    @property
    def label(self) -> str:
        """Name in tables."""
        sun = "" if self.sun else " without sun"
        named = f"sky {self.sun_elevation_deg:g}°{sun}" + _how(self.polarised)
        return named + other_keys(self, "sun_elevation_deg", "sun", "polarised")

    @property
    def to_sun(self) -> tuple[float, float, float]:
        """Unit vector towards the sun before the sky is turned.

        Examples
        --------
        >>> Sky(sun_elevation_deg=90).to_sun[1]
        1.0
        """
        elevation = math.radians(self.sun_elevation_deg)
        azimuth = math.radians(self.sun_azimuth_deg)
        level = math.cos(elevation)
        return level * math.sin(azimuth), math.sin(elevation), level * math.cos(azimuth)


class Interior(AllAround):
    """A room drawn at random, seen from its middle: walls, windows and lamps; y is up.

    Its `radiance` is the mean over all directions. The lamps are 50 to 1000 times as bright as a
    bright wall: see `malus.scenes.lights.interior`. `AllAround` says how it is turned.

    Examples
    --------
    >>> Interior(seed=2).label
    'interior-2'
    """

    kind: Literal["interior"] = "interior"
    seed: int = Field(default=0, ge=0)
    radiance: Strength = 1.0

    @property
    def label(self) -> str:
        """Name in tables."""
        named = self.kind if self.seed == 0 else f"{self.kind}-{self.seed}"
        return named + other_keys(self, "seed")


MapLight = Environment | Sky | Interior
"""Lights that are radiance maps."""

Light = Annotated[
    Uniform | Distant | Area | Environment | Sky | Interior, Field(discriminator="kind")
]


def turned(light: Light, angle_deg: float) -> Light:
    """Turn a light about the viewing axis, anticlockwise in the image of an unmoved camera.

    Examples
    --------
    >>> turned(Distant(incidence_deg=60, azimuth_deg=35), 20).azimuth_deg
    55.0
    """
    if angle_deg == 0.0 or isinstance(light, Uniform):
        return light
    if isinstance(light, Distant | Area) and light.polarised:
        return rotated(light, about_axis(2, angle_deg))
    key = "turn_deg" if isinstance(light, MapLight) else "azimuth_deg"
    # Back into the keys' range, whatever the sum.
    angle = math.remainder(getattr(light, key) + angle_deg, 360.0)
    return light.model_copy(update={key: angle})


def rotated(light: Light, rotation: Float64Array) -> Light:
    """A light turned by a rotation matrix (3, 3) about the origin, with its polariser.

    Examples
    --------
    >>> quarter = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    >>> round(rotated(Distant(incidence_deg=60, azimuth_deg=90), quarter).incidence_deg, 9)
    30.0
    """
    if isinstance(light, Uniform):
        return light
    if isinstance(light, MapLight):
        return light.model_copy(update=turns(rotation @ light.rotation))
    direction = rotation @ np.array(light.direction)
    update: dict[str, object] = {**incidence_and_azimuth(direction)}
    if light.polarised:
        axis = rotation @ transmission_axis(light)
        angle = polariser_angle_deg(np.array(light.model_copy(update=update).direction), axis)
        update["polarised"] = light.polarised.model_copy(update={"angle_deg": angle})
    return light.model_copy(update=update)


def transmission_axis(light: Distant | Area) -> Float64Array:
    """Transmission axis (3,), a unit vector in the world, of the polariser before a lamp.

    Raises
    ------
    ValueError
        If there is none.

    Examples
    --------
    >>> above = Distant(incidence_deg=90, azimuth_deg=90, polarised=Polariser(angle_deg=90))
    >>> transmission_axis(above).tolist()
    [-1.0, 0.0, 0.0]
    """
    if light.polarised is None:
        raise ValueError("light: expected a polarised one, found an unpolarised")
    return polariser_axis(np.array(light.direction), light.polarised.angle_deg)


def _how(polarised: Polariser | SkyPolarisation | None) -> str:
    return polarised.label if polarised else ""
