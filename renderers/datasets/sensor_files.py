"""The raw frame of a polarisation camera and its Stokes image, as files of a scene's folder."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from malus.renderers.datasets.spectral_exr import read_spectral, write_spectral
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.model import Model
from malus.scenes.sensor import Channels, Sensor
from malus.scenes.sensor_frame import SensorFrame

RAW: Literal["raw.tiff"] = "raw.tiff"
DEMOSAICED: Literal["sensor.exr"] = "sensor.exr"

_NOWHERE = logging.NullHandler()


class SensorRecord(Model):
    """Content of the key `sensor` in `scene.json`: all that is needed to read the raw frame.

    `gain` is that of the frame, whether the sensor's own `gain` was given or not.
    """

    sensor: Sensor
    gain: float = Field(gt=0, default_factory=lambda known: known["sensor"].digital_gain)
    exposure: float = Field(gt=0)
    channels: Channels
    frames: int = Field(ge=1, le=512)
    demosaiced: bool = True

    @model_validator(mode="after")
    def _frames_of_channels(self) -> Self:
        if self.gain != self.sensor.digital_gain:
            raise ValueError(f"the gain of the sensor, {self.sensor.digital_gain}")
        names = self.channels.names
        if self.sensor.bayer is None:
            if self.frames != len(names) or any(names):
                raise ValueError("a frame a channel, without colours")
        elif self.frames != 1 or sorted(names) != ["b", "g", "r"]:
            raise ValueError("one frame of the channels r, g and b")
        return self

    @classmethod
    def of(cls, frame: SensorFrame) -> Self:
        """The record of a frame."""
        return cls(
            sensor=frame.sensor,
            exposure=frame.exposure,
            channels=frame.channels,
            frames=len(frame.raw),
            demosaiced=frame.stokes is not None,
        )


def write_frame(folder: Path, frame: SensorFrame) -> None:
    """Write the raw frames as the pages of a 16-bit TIFF, and the Stokes image if there is one."""
    import tifffile

    # One page a frame; no time or name of a program, so that equal frames are equal files.
    tifffile.imwrite(
        folder / RAW, frame.raw, photometric="minisblack", metadata=None, software=False
    )
    if frame.stokes is not None:
        write_spectral(folder / DEMOSAICED, frame.stokes, frame.channels.wavelengths_nm)


def read_frame(folder: Path, record: SensorRecord, shape: tuple[int, int]) -> SensorFrame:
    """The frame in a scene's folder, whose files have been checked against their hashes.

    Raises
    ------
    InputError
        If the raw frame is not what the record says.
    """
    import tifffile

    # What is wrong with a file is told once, by the error below.
    logging.getLogger("tifffile").addHandler(_NOWHERE)
    path, hint = folder / RAW, "render this scene again"
    # Uncompressed, as they are written: no file is smaller than what is decoded of it.
    expected = {(shape, "uint16", tifffile.COMPRESSION.NONE)}
    with (
        reading(str(path), "a TIFF file of 16-bit frames", hint),
        path.open("rb") as file,
        tifffile.TiffFile(file) as tiff,
    ):
        kinds = {(page.shape, str(page.dtype), page.compression) for page in tiff.pages}
        if len(tiff.pages) != record.frames or kinds != expected:
            wanted = f"{record.frames} uncompressed frames {shape} of 16 bits"
            raise InputError(str(path), wanted, f"{len(tiff.pages)} of {kinds}", hint)
        if path.stat().st_size < 2 * record.frames * shape[0] * shape[1]:
            raise InputError(str(path), "every frame at its full size", "a smaller file", hint)
        raw = np.stack([page.asarray() for page in tiff.pages])
    stokes = None
    if record.demosaiced:
        stokes = read_spectral(folder / DEMOSAICED, shape, record.channels.wavelengths_nm)
    return SensorFrame(record.sensor, raw, record.exposure, record.channels, stokes)
