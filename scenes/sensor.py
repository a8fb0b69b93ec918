"""Polarisation cameras: colour channels, exposure, noise and micro-polarisers of an image sensor.

A sensor has a linear polariser before every pixel, four directions in each square of 2 x 2. The
noise model is that of EMVA Standard 1288, Release 4.0 Linear, section 2: photon noise, read noise
and quantisation, with a gain of K digital numbers (DN) an electron.
"""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from malus.scenes.colour import cell_widths
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.colour_science import colour_science
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.model import Model
from malus.scenes.core.named_file import NamedFile
from malus.scenes.core.registry import lookup, table
from malus.scenes.polarisation import FROM_VERTICAL_DEG, tell_stokes

SETS = {"nikon-5100": "Nikon 5100 (NPL)", "sigma-sd-merrill": "Sigma SDMerill (NPL)"}
"""Measured sensitivities of red, green and blue by their names in colour-science.

Source: Darrodi, Finlayson, Goodman and Mackiewicz, "Reference data set for camera spectral
sensitivity estimation", JOSA A 32 (2015).
"""

SensitivitySet = Literal["bands", "flat", "nikon-5100", "sigma-sd-merrill"]
Degrees = Annotated[float, Field(ge=-360, le=360)]
FourAngles = tuple[Degrees, Degrees, Degrees, Degrees]

LEAST_SIDE, LEAST_SIDE_WITH_BAYER = 4, 12
"""Least pixels a side of a frame that can be demosaiced."""

_COLOURS = {"r": 0, "red": 0, "g": 1, "green": 1, "b": 2, "blue": 2}
_MOST_CURVE_BYTES = 1 << 20
_DISTINCT_NM = 0.2


class SensitivityFile(NamedFile):
    """A table of spectral sensitivities: a CSV file, `wavelength_nm` and one or three columns."""

    file_kind: ClassVar[str] = "sensitivity table"
    path: str = Field(min_length=1, max_length=4096)

    @property
    def file_name(self) -> str:
        """The file's path."""
        return self.path

    def curves(self) -> Float64Array:
        """Rows of the table (samples, 1 + channels): wavelength in nm, then sensitivities.

        Three channels are red, green and blue, which the line of names may have in another order.

        Raises
        ------
        InputError
            If it is no such table.
        """
        file = self.checked()
        hint = "one line a wavelength, such as 450,0.12 or 450,0.02,0.1,0.9"
        with reading(str(file), "a CSV file of numbers below one line of names", hint):
            if file.stat().st_size > _MOST_CURVE_BYTES:
                raise ValueError("more than 1 MiB")
            with file.open(newline="", encoding="utf-8-sig") as text:
                rows = [row for row in csv.reader(text) if row]
            names = rows.pop(0) if rows and not any(map(_is_number, rows[0])) else []
            curves = np.array([[float(value) for value in row] for row in rows])
        columns = curves.shape[1] if curves.ndim == 2 else 0
        if columns not in (2, 4):
            raise InputError(str(file), "2 or 4 columns of numbers", str(columns), hint)
        if not np.isfinite(curves).all() or (curves[:, 1:] < 0).any():
            raise InputError(str(file), "sensitivities of 0 or more", "others", hint)
        if (np.diff(curves[:, 0]) <= 0).any():
            raise InputError(str(file), "increasing wavelengths", "others", "sort the lines")
        return curves if columns == 2 else curves[:, _order_of_columns(str(file), names)]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _order_of_columns(where: str, names: list[str]) -> list[int]:
    """Columns of wavelength, red, green and blue; as they stand where no name is a colour's."""
    words = [re.findall("[a-z]+", name.lower()) or [""] for name in names]
    colours = [_COLOURS.get(first) for first, *_ in words]
    if set(colours) <= {None}:
        return [0, 1, 2, 3]
    if colours[0] is not None or sorted(map(str, colours[1:])) != ["0", "1", "2"]:
        hint = "name the columns wavelength_nm,r,g,b in the order in which they stand"
        expected = "a column of wavelengths, then one named r, g and b each"
        raise InputError(where, expected, ",".join(names), hint)
    return [0, *(colours.index(colour) for colour in range(3))]


class Channels(Model):
    """Colour channels of a sensor for the bands of a scene, by increasing wavelength.

    Attributes
    ----------
    names : tuple of str
        'r', 'g', 'b' of a sensor with Bayer's filters; elsewhere empty texts.
    wavelengths_nm : (channels,)
        Mean wavelength of the light of a flat spectrum that a channel sees.
    weights : (channels, bands)
        Share of each band in a channel; rows add up to 1.
    responses : (channels,)
        Sensitivity to a flat spectrum, over that of the most sensitive channel.
    """

    names: tuple[Literal["r", "g", "b", ""], ...] = Field(min_length=1, max_length=512)
    wavelengths_nm: tuple[float, ...]
    weights: tuple[tuple[float, ...], ...]
    responses: tuple[Annotated[float, Field(gt=0, le=1)], ...]

    @model_validator(mode="after")
    def _one_entry_a_channel(self) -> Self:
        counts = {len(part) for part in (self.names, self.wavelengths_nm, self.weights)}
        if counts != {len(self.responses)} or len({len(row) for row in self.weights}) != 1:
            raise ValueError("one entry a channel in every list")
        return self


class Sensor(Model):
    """A polarisation camera's image sensor, as it stands in a suite under `[sensor]`.

    Attributes
    ----------
    preset : 'imx250mzr' or 'imx250myr', optional
        A sensor whose published values are taken for all that is not given.
    sensitivities : 'bands', 'flat', 'nikon-5100', 'sigma-sd-merrill' or a file
        'bands' takes one frame behind a narrow filter for every band; 'flat' is one channel equally
        sensitive to all bands; the others are measured curves of red, green and blue. A file,
        `{ path = "curves.csv" }`, has one or three channels.
    bayer : 'rggb', 'bggr', 'grbg' or 'gbrg', optional
        Colours of the squares of 2 x 2 pixels; for sensitivities of three channels.
    mosaic : four angles
        Transmission axes of the polarisers of a square, row by row, in degrees anticlockwise from
        the *horizontal*, as camera makers count.
    exposure : float, optional
        Electrons in a pixel for every W m⁻² sr⁻¹ nm⁻¹ that its polariser lets pass, in the most
        sensitive channel. By default it is chosen for each scene: the brightest thousandth of the
        pixels reaches `fill` of the full well.
    fill : float
        That share of the full well.
    full_well, read_noise : float
        Most electrons of a pixel; standard deviation of the read noise in electrons.
    dark_level : float
        Digital number of a dark pixel.
    gain : float, optional
        Digital numbers an electron; by default the full well reaches the largest number.
    bit_depth : int
        Bits of a digital number.
    extinction_ratio : float, optional
        Of the polarisers, transmission along over across the axis; by default they are ideal.
    angle_errors_deg : four angles
        Added to those of `mosaic`.
    angle_spread_deg : float
        Standard deviation of a further error of every single polariser: a fixed pattern.
    blur_px : float
        Standard deviation of the optics' Gaussian blur in pixels.
    calibrated : bool
        Whether the Stokes image is computed with the real extinction ratio and `angle_errors_deg`;
        otherwise with ideal polarisers at the angles of `mosaic`. The spread stays unknown.

    Examples
    --------
    >>> Sensor(preset="imx250mzr", extinction_ratio=300.0).full_well
    10700.0
    >>> Sensor(full_well=1000.0, bit_depth=10).digital_gain
    1.023
    """

    preset: str | None = Field(default=None, exclude_if=lambda value: value is None)
    sensitivities: SensitivitySet | SensitivityFile = "bands"
    bayer: Literal["rggb", "bggr", "grbg", "gbrg"] | None = None
    mosaic: FourAngles = (90.0, 45.0, 135.0, 0.0)
    exposure: float | None = Field(default=None, gt=0, le=1e12)
    fill: float = Field(default=0.9, gt=0, le=10)
    full_well: float = Field(default=10_000.0, ge=1, le=1e9)
    read_noise: float = Field(default=0.0, ge=0, le=1e6)
    dark_level: float = Field(default=0.0, ge=0, le=65_535)
    gain: float | None = Field(default=None, gt=0, le=1e6)
    bit_depth: int = Field(default=12, ge=1, le=16)
    extinction_ratio: float | None = Field(default=None, gt=1, le=1e9)
    angle_errors_deg: FourAngles = (0.0, 0.0, 0.0, 0.0)
    angle_spread_deg: float = Field(default=0.0, ge=0, le=45)
    blur_px: float = Field(default=0.0, ge=0, le=100)
    calibrated: bool = False

    @model_validator(mode="before")
    @classmethod
    def _with_preset(cls, data: Any) -> Any:
        if not isinstance(data, dict) or not isinstance(data.get("preset"), str):
            return data
        values = lookup(data["preset"], presets(), "sensor preset")
        missing = [name for name in values["needs"] if name not in data]
        if missing:
            expected = f"{' and '.join(missing)} beside this preset"
            raise InputError("preset", expected, data["preset"], "no document of it states them")
        given = {name: value for name, value in values.items() if name in cls.model_fields}
        return given | data

    @model_validator(mode="after")
    def _one_sensor(self) -> Self:
        if self.largest_number <= self.dark_level:
            raise ValueError(f"a dark_level below the largest number, {self.largest_number}")
        if 0 < max(map(abs, self.mosaic)) <= 2 * math.pi:
            raise ValueError("mosaic in degrees; are these radians?")
        if not tell_stokes(self.assumed_angles_deg):
            raise ValueError("three different directions in mosaic")
        # A file is not opened here: a dataset from elsewhere may name any.
        if self.sensitivities in SETS and self.bayer is None:
            raise ValueError("bayer, the order of the three channels' colours")
        if self.sensitivities in ("bands", "flat") and self.bayer is not None:
            names = ", ".join(SETS)
            raise ValueError(f"sensitivities of red, green and blue with bayer: {names} or a file")
        return self

    def check_fits(self, wavelengths_nm: tuple[float, ...], resolution: int) -> None:
        """Check that the sensor can take scenes of these bands and pixels a side.

        Raises
        ------
        InputError
            If the bands do not fit the channels, or the mosaic does not fit the frame.
        """
        least = LEAST_SIDE if self.bayer is None else LEAST_SIDE_WITH_BAYER
        if resolution < least:
            expected = f"a resolution of {least} or more for its mosaic"
            raise InputError("sensor", expected, str(resolution), "use more resolution")
        if not isinstance(self.sensitivities, SensitivityFile) or self.sensitivities.was_found:
            self.channels(wavelengths_nm)

    @property
    def largest_number(self) -> int:
        """The digital number of saturated pixels."""
        return int(2**self.bit_depth - 1)

    @property
    def digital_gain(self) -> float:
        """Digital numbers an electron."""
        default = (self.largest_number - self.dark_level) / self.full_well
        return default if self.gain is None else self.gain

    @property
    def angles_deg(self) -> FourAngles:
        """True transmission axes of a square, anticlockwise from the *vertical*."""
        a, b, c, d = (
            angle + error + FROM_VERTICAL_DEG
            for angle, error in zip(self.mosaic, self.angle_errors_deg, strict=True)
        )
        return a, b, c, d

    @property
    def assumed_angles_deg(self) -> FourAngles:
        """Transmission axes that the Stokes image is computed with, from the *vertical*."""
        if self.calibrated:
            return self.angles_deg
        a, b, c, d = (angle + FROM_VERTICAL_DEG for angle in self.mosaic)
        return a, b, c, d

    @property
    def assumed_extinction_ratio(self) -> float | None:
        """Extinction ratio that the Stokes image is computed with; None is infinite."""
        return self.extinction_ratio if self.calibrated else None

    def channels(self, wavelengths_nm: tuple[float, ...]) -> Channels:
        """Channels for a scene's bands.

        Raises
        ------
        InputError
            If a channel sees none of the bands, two see the same, a band is off the table, or a
            file of sensitivities has other channels than the sensor.

        Examples
        --------
        >>> Sensor().channels((450.0, 650.0)).weights
        ((1.0, 0.0), (0.0, 1.0))
        """
        seen = self._sensitivity(wavelengths_nm) * (
            1.0 if self.sensitivities == "bands" else cell_widths(wavelengths_nm)
        )
        sums = seen.sum(axis=1)
        expected, hint = "bands that every channel sees", "choose other wavelengths_nm"
        if (sums <= 0).any():
            raise InputError("sensor, key sensitivities", expected, f"{wavelengths_nm}", hint)
        weights = seen / sums[:, None]
        means = weights @ np.array(wavelengths_nm)
        order = np.argsort(means)
        mixed = self.sensitivities != "bands"
        if mixed and (np.diff(means[order]) < _DISTINCT_NM).any():
            expected = "bands that tell the channels apart"
            raise InputError("sensor, key sensitivities", expected, f"{wavelengths_nm}", hint)
        names = ("r", "g", "b") if self.bayer else ("",) * len(seen)
        return Channels(
            names=tuple(names[index] for index in order),
            wavelengths_nm=tuple(means[order].tolist()),
            weights=tuple(tuple(row) for row in weights[order].tolist()),
            responses=tuple((sums[order] / sums.max()).tolist()),
        )

    def _sensitivity(self, wavelengths_nm: tuple[float, ...]) -> Float64Array:
        """Sensitivities (channels, bands) at the bands' centres."""
        if self.sensitivities == "bands":
            return np.eye(len(wavelengths_nm))
        if self.sensitivities == "flat":
            return np.ones((1, len(wavelengths_nm)))
        if isinstance(self.sensitivities, SensitivityFile):
            table_ = self._file_curves("sensor, key sensitivities")
        else:
            curves = colour_science().MSDS_CAMERA_SENSITIVITIES[SETS[self.sensitivities]]
            table_ = np.column_stack([curves.wavelengths, curves.values])
        low, high = table_[0, 0], table_[-1, 0]
        if outside := [band for band in wavelengths_nm if not low <= band <= high]:
            expected = f"bands in its table, {low:g} to {high:g} nm"
            hint = "choose other wavelengths_nm, or a table that has them, with zeros say"
            raise InputError("sensor, key sensitivities", expected, f"{outside[0]:g} nm", hint)
        sampled = [np.interp(wavelengths_nm, table_[:, 0], curve) for curve in table_.T[1:]]
        return np.maximum(np.array(sampled), 0.0)

    def _file_curves(self, where: str) -> Float64Array:
        """The table of the file of sensitivities, of as many channels as the sensor has.

        Raises
        ------
        InputError
            If it is no such table; `where` names the sensor.
        """
        assert isinstance(self.sensitivities, SensitivityFile)
        curves = self.sensitivities.curves()
        needed, columns = 1 if self.bayer is None else 3, curves.shape[1] - 1
        if columns != needed:
            of_one, of_three = "bayer is for three channels", "give bayer, the order of colours"
            expected = f"{needed} column(s) of sensitivities in {self.sensitivities.file}"
            raise InputError(where, expected, str(columns), of_one if columns == 1 else of_three)
        return curves


def presets() -> dict[str, dict[str, Any]]:
    """Published values of sensors by their id; `needs` are keys that no document states.

    Examples
    --------
    >>> sorted(presets())
    ['imx250myr', 'imx250mzr']
    """
    return {entry["id"]: _tuples(entry) for entry in table("sensors.toml")["sensor"]}


def _tuples(entry: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(v) if isinstance(v, list) else v for key, v in entry.items()}


def located(sensor: Sensor, folder: Path, where: str) -> Sensor:
    """The sensor with its sensitivities' file, if any, found from a folder, and its digest.

    Raises
    ------
    InputError
        If that file is no table of sensitivities, not of as many channels as the sensor has, or has
        another digest than the sensor names.
    """
    named = sensor.sensitivities
    if not isinstance(named, SensitivityFile):
        return sensor
    result = sensor.model_copy(update={"sensitivities": named.located(folder)})
    result._file_curves(f"{where}, key sensor")
    return result
