"""Lights: unpolarised, with a flat spectrum, and far away."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field

from malus.scenes.core.model import Model
from malus.scenes.core.named_file import NamedFile

Strength = Annotated[float, Field(ge=1e-9, le=1e9)]
"""Radiance or irradiance of a light; its square and its inverse must fit into float32."""


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
        return self.kind


class Distant(Model):
    """Unpolarised parallel light.

    `incidence_deg` is the angle between the direction to the light and the viewer, `azimuth_deg`
    that of its projection on the image, anticlockwise from +x. An irradiance of π makes a white
    Lambertian surface that faces the light as bright as under the uniform light of radiance 1.

    Examples
    --------
    >>> Distant(incidence_deg=60).label
    'distant 60°'
    """

    kind: Literal["distant"] = "distant"
    incidence_deg: float = Field(ge=0, lt=180)
    azimuth_deg: float = Field(default=35.0, ge=-360, le=360)
    irradiance: Strength = math.pi

    @property
    def label(self) -> str:
        """Name in tables."""
        return f"distant {self.incidence_deg:g}°"

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector towards the light in the image frame.

        Examples
        --------
        >>> Distant(incidence_deg=90, azimuth_deg=90).direction[1]
        1.0
        """
        return _direction(self.incidence_deg, self.azimuth_deg)

    @classmethod
    def towards(cls, direction: Iterable[float], irradiance: float = math.pi) -> Self:
        """Light from the direction of a vector (x, y, z) of any length but 0.

        Straight from behind is a billionth of a degree beside it.

        Examples
        --------
        >>> Distant.towards((0, 2, 2)).incidence_deg
        45.0
        """
        x, y, z = map(float, direction)
        incidence = math.degrees(math.atan2(math.hypot(x, y), z))
        return cls(
            incidence_deg=min(incidence, 180.0 - 1e-9),
            azimuth_deg=math.degrees(math.atan2(y, x)),
            irradiance=irradiance,
        )


class Area(Model):
    """A round lamp far away, equally bright all over, that subtends a cone of directions.

    `half_angle_deg` is the cone's half angle, the other angles are those of its axis as for
    `Distant`.

    Examples
    --------
    >>> Area(incidence_deg=60, half_angle_deg=15).label
    'area 60°'
    """

    kind: Literal["area"] = "area"
    incidence_deg: float = Field(ge=0, lt=180)
    azimuth_deg: float = Field(default=35.0, ge=-360, le=360)
    half_angle_deg: float = Field(default=20.0, gt=0, le=80)
    radiance: Strength = 8.0

    @property
    def label(self) -> str:
        """Name in tables."""
        return f"area {self.incidence_deg:g}°"

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector towards the middle of the lamp in the image frame."""
        return _direction(self.incidence_deg, self.azimuth_deg)


class Environment(NamedFile):
    """Light from all around: a radiance map that malus brings, or an EXR or HDR file.

    Maps are equirectangular with y up: see `malus.scenes.lights.environment`. `turn_deg` turns the
    map about the viewing axis, anticlockwise in the image of an unrolled camera.

    Examples
    --------
    >>> Environment().kind
    'environment'
    """

    kind: Literal["environment"] = "environment"
    name: str = Field(default="studio", min_length=1)
    turn_deg: float = Field(default=0.0, ge=-360, le=360, exclude_if=lambda turn: turn == 0.0)
    file_kind: ClassVar[str] = "radiance map"

    @property
    def file_name(self) -> str | None:
        """The map's path, unless malus brings it."""
        return None if self.name == "studio" else self.name

    @property
    def label(self) -> str:
        """Name in tables."""
        return f"environment {Path(self.name).stem}"


class Sky(Model):
    """A clear sky by day, with its sun or without, above a dark ground; y is up.

    The model of Hosek and Wilkie, as Mitsuba's: see `malus.scenes.lights.sky`. `sun_azimuth_deg`
    counts from straight behind the viewer, over the right, to straight ahead at 180. `turbidity` is
    2 for clear air, 10 for haze. Like every light the sky is unpolarised and has one radiance for
    all bands, that of its light at `wavelength_nm`: its colours take a scene for every wavelength.
    `turn_deg` turns it about the viewing axis as it does an `Environment`.

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
    turn_deg: float = Field(default=0.0, ge=-360, le=360, exclude_if=lambda turn: turn == 0.0)

    @property
    def label(self) -> str:
        """Name in tables."""
        return f"sky {self.sun_elevation_deg:g}°" + ("" if self.sun else " without sun")

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


Light = Annotated[Uniform | Distant | Area | Environment | Sky, Field(discriminator="kind")]


def turned(light: Light, angle_deg: float) -> Light:
    """Turn a light about the viewing axis, anticlockwise in the image of an unrolled camera.

    Examples
    --------
    >>> turned(Distant(incidence_deg=60, azimuth_deg=35), 20).azimuth_deg
    55.0
    """
    if angle_deg == 0.0 or isinstance(light, Uniform):
        return light
    key = "turn_deg" if isinstance(light, Environment | Sky) else "azimuth_deg"
    # Back into the keys' range, whatever the sum.
    angle = math.remainder(getattr(light, key) + angle_deg, 360.0)
    return light.model_copy(update={key: angle})


def _direction(incidence_deg: float, azimuth_deg: float) -> tuple[float, float, float]:
    incidence, azimuth = math.radians(incidence_deg), math.radians(azimuth_deg)
    sine = math.sin(incidence)
    return sine * math.cos(azimuth), sine * math.sin(azimuth), math.cos(incidence)
