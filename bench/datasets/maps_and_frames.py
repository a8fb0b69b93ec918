"""What a dataset holds beside the Stokes images: maps of the scene, and a camera's frame of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from malus.reconstruct.photos.sensor_stokes import demosaiced_stokes
from malus.renderers.datasets.dataset_record import CONVENTIONS
from malus.renderers.mitsuba.surface_maps import render_maps
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant
from malus.scenes.core.arrays import BoolArray
from malus.scenes.maps import MAPS, MapName
from malus.scenes.scene import Scene
from malus.scenes.sensor import Sensor
from malus.scenes.sensor_frame import SensorFrame, expose, seen
from malus.scenes.suite import Suite

SENSOR = "sensor"
"""Name, among the methods of a score, of a dataset's polarisation camera."""

WELL_LIT = 0.01
"""Share of the full well from which on a pixel's degree of polarisation is more than noise."""


@dataclass(frozen=True)
class Additions:
    """Maps and sensor that a suite asks for, and the seed of the sensor's noise."""

    maps: tuple[MapName, ...] = ()
    sensor: Sensor | None = None
    seed: int = 0

    @classmethod
    def of(cls, suite: Suite) -> Self:
        """What a suite asks for."""
        return cls(suite.maps, suite.sensor, suite.sampling.seed)

    @property
    def asked_for(self) -> bool:
        """Whether there is anything to add."""
        return bool(self.maps) or self.sensor is not None

    def identity(self) -> dict[str, Any]:
        """Content that decides what is added, for the origin of a scene; empty for nothing."""
        if not self.asked_for:
            return {}
        sensor = None if self.sensor is None else self.sensor.model_dump(mode="json")
        return {"maps": list(self.maps), "sensor": sensor, "seed": self.seed}

    @property
    def label(self) -> str:
        """What a dataset holds beside its Stokes images, in words."""
        maps = f"maps ({', '.join(self.maps)})" if self.maps else "no maps"
        frames = "no frames of a sensor" if self.sensor is None else "frames of a sensor"
        left = "" if self.asked_for else ": the suite asks for none"
        return f"{maps} and {frames}{left}"

    def values_of_a_pixel(self, bands: int) -> int:
        """Numbers of 32 bits in a pixel of a scene of so many bands, before compression."""
        sizes = {"": 1, "2": 2, "3": 3, "bands": bands}
        maps = sum(sizes[MAPS[name].shape] for name in self.maps)
        return maps + (0 if self.sensor is None else 4 * bands)

    def added_to(self, truth: Truth, variant: Variant) -> Truth:
        """The truth with its maps and the frame that the sensor takes of it.

        Raises
        ------
        InputError
            Maps in the scalar variant, or a sensor that does not see the scene's bands.
        """
        if not self.asked_for:
            return truth
        maps = render_maps(truth.scene, self.maps, variant)
        frame = None if self.sensor is None else self._frame(truth, self.sensor)
        return replace(truth, maps=maps, frame=frame)

    def _frame(self, truth: Truth, sensor: Sensor) -> SensorFrame:
        seed = (self.seed, seed_of(truth.scene))
        frame = expose(truth.stokes, sensor, truth.scene.wavelengths_nm, seed)
        return replace(frame, stokes=demosaiced_stokes(frame))

    def conventions(self) -> dict[str, str]:
        """Meaning of the numbers in the dataset, in words."""
        return CONVENTIONS | _map_words(self.maps) | ({} if self.sensor is None else _SENSOR)


NOTHING = Additions()


def seed_of(scene: Scene) -> int:
    """A number of a scene alone, so that noise does not depend on the order of scenes."""
    return int(scene.id, 16)


def sensor_truth(truth: Truth, frame: SensorFrame) -> Truth:
    """The truth in a sensor's channels: what a perfect camera of the same colours would measure.

    Without noise: the sensor saw this very light, the noise of its render with it.
    """
    bands = frame.channels.wavelengths_nm
    mixed = seen(truth.stokes, frame.channels)
    nothing = np.zeros_like(mixed)
    return replace(
        truth,
        # Only the bands of this scene are asked for by scores, and these are no real scene's.
        scene=truth.scene.model_copy(update={"wavelengths_nm": bands}),
        specular=mixed,
        diffuse=nothing,
        standard_error=nothing,
        specular_noise=nothing,
        diffuse_noise=nothing,
    )


def well_lit(ideal: Truth, frame: SensorFrame) -> BoolArray:
    """Pixels (height, width) with light for `WELL_LIT` of the full well in every channel."""
    electrons = 0.5 * frame.exposure * np.array(frame.channels.responses) * ideal.image
    return np.asarray((electrons >= WELL_LIT * frame.sensor.full_well).all(axis=-1))


def _map_words(names: tuple[MapName, ...]) -> dict[str, str]:
    if not names:
        return {}
    words = {"maps": "maps.exr; of the object that most of a pixel's 4 x 4 rays hit; 0 off all"}
    for name in names:
        one = MAPS[name]
        about = [one.unit and f"unit {one.unit}", one.frame and f"{one.frame} frame"]
        facts = ", ".join([one.dtype, *filter(None, about)])
        words[f"map {name}"] = f"{one.summary} ({facts}); in part covered: {one.partly_covered}"
    return words


_SENSOR = {
    "sensor": "raw.tiff: 16-bit pages of digital numbers, one a frame; electrons = (number - dark"
    " level) / gain, radiance = electrons / (exposure x response), as `scene.json` has them;"
    " mosaic angles count from +x (horizontal), anticlockwise as displayed; sensor.exr: the Stokes"
    " image that demosaicing makes of it, one band a channel, named by its mean wavelength",
}
