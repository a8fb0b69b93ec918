"""The raw frame that a polarisation camera takes of a Stokes image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from malus.scenes.core.arrays import Float64Array, FloatArray, IntArray
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import analyser
from malus.scenes.sensor import Channels, Sensor

BRIGHTEST = 0.999
"""Quantile of the pixels that an automatic exposure takes for the brightest."""


@dataclass(frozen=True)
class SensorFrame:
    """What a sensor delivers of a scene, and what its user knows of it.

    Attributes
    ----------
    sensor : Sensor
        The camera that took the frame.
    raw : (frames, height, width) uint16
        Digital numbers: a frame a band where `sensor.sensitivities` are the bands, else one.
    exposure : float
        Electrons for every W m⁻² sr⁻¹ nm⁻¹ that a polariser lets pass, in the most sensitive
        channel.
    channels : Channels
        Names of the channels, and what each sees.
    stokes : (height, width, channels, 3) or None
        The Stokes image that was computed from `raw`, in the units of the scene's radiance.

    Examples
    --------
    >>> horizontal = np.tile([1.0, 1.0, 0.0], (4, 4, 1, 1))
    >>> frame = expose(horizontal, Sensor(exposure=4000.0, full_well=4095.0))
    >>> frame.raw.shape, frame.raw[0, 0, 0].item()  # behind a polariser at 90 degrees
    ((1, 4, 4), 0)
    """

    __repr__ = brief_repr

    sensor: Sensor
    raw: NDArray[np.uint16]
    exposure: float
    channels: Channels
    stokes: FloatArray | None = None

    @property
    def electrons(self) -> Float64Array:
        """Estimated electrons (frames, height, width): dark level and gain taken back."""
        sensor = self.sensor
        return (self.raw.astype(np.float64) - sensor.dark_level) / sensor.digital_gain


def expose(
    stokes: FloatArray,
    sensor: Sensor,
    wavelengths_nm: tuple[float, ...] = (550.0,),
    seed: int | Sequence[int] = 1,
) -> SensorFrame:
    """Take a raw frame of a Stokes image with a polarisation camera.

    Parameters
    ----------
    stokes : (height, width, bands, 3)
        Linear Stokes vectors in W m⁻² sr⁻¹ nm⁻¹, as `Truth.stokes`.
    sensor : Sensor
        The camera.
    wavelengths_nm : (bands,)
        Of the bands of `stokes`.
    seed : integer, or several
        The noise follows from these and the number of the frame alone.

    Returns
    -------
    SensorFrame
        Digital numbers, and the exposure that made them.

    Raises
    ------
    InputError
        Another shape, values that no light has, or bands that a channel of the sensor does not see.

    Examples
    --------
    >>> unpolarised = np.zeros((4, 4, 1, 3))
    >>> unpolarised[..., 0] = 1.0
    >>> expose(unpolarised, Sensor(exposure=2000.0)).electrons.mean().round(-2).item()
    1000.0
    """
    stokes = np.asarray(stokes)
    _check_light(stokes, len(wavelengths_nm))
    channels = sensor.channels(wavelengths_nm)
    light = _blurred(seen(stokes, channels).astype(np.float64), sensor.blur_px)
    passing = np.einsum("yxcs,yxs->cyx", light, _analysers(sensor, light.shape[:2]))
    passing *= np.array(channels.responses)[:, None, None]
    # A polariser passes no negative light; a noisy Stokes vector may claim some.
    signal = np.maximum(_behind_colours(passing, sensor, channels), 0.0)
    exposure = _exposure(signal, sensor)
    seeds = [seed] if isinstance(seed, int | np.integer) else seed
    raw = [
        _digital(exposure * frame, sensor, np.random.default_rng([*seeds, number]))
        for number, frame in enumerate(signal)
    ]
    return SensorFrame(sensor, np.stack(raw), exposure, channels)


_OVER = 0.05
"""Polarised light may exceed all light by this share of the largest: interpolation and noise do."""


def _check_light(stokes: FloatArray, bands: int) -> None:
    """Refuse arrays that are no Stokes image of so many bands, and those of no light."""
    if stokes.ndim != 4 or stokes.shape[2:] != (bands, 3):
        expected = f"(height, width, {bands}, 3)"
        raise InputError("stokes", expected, f"{stokes.shape}", "give one Stokes image a band")
    if stokes.dtype.kind not in "fiu" or not np.isfinite(stokes).all():
        raise InputError("stokes", "finite real numbers", "others among them", "correct them")
    excess = np.hypot(stokes[..., 1], stokes[..., 2]) - stokes[..., 0]
    impossible = int(np.count_nonzero(excess > _OVER * stokes[..., 0].max(initial=0.0)))
    if impossible:
        raise InputError(
            "stokes",
            "light: s0 at least the length of (s1, s2)",
            f"{impossible} values of less",
            "check the order of s0, s1, s2",
        )


def seen(stokes: FloatArray, channels: Channels) -> FloatArray:
    """Stokes image (height, width, channels, 3) of the light in each channel, from that of bands.

    The mean over a channel's sensitivity: what a perfect camera of the same colours would measure.
    """
    weights = np.array(channels.weights, dtype=stokes.dtype)
    if np.array_equal(weights, np.eye(stokes.shape[2])):
        return stokes
    return np.einsum("yxbs,cb->yxcs", stokes, weights)


def _blurred(light: Float64Array, sigma: float) -> Float64Array:
    """Light (height, width, channels, 3) behind blurring optics."""
    if sigma == 0:
        return light
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(light, (sigma, sigma, 0, 0), mode="nearest"))


def _analysers(sensor: Sensor, shape: tuple[int, int]) -> Float64Array:
    """Weights (height, width, 3) of the polariser before each pixel."""
    angles = np.array(sensor.angles_deg).reshape(2, 2)
    repeats = (-(-shape[0] // 2), -(-shape[1] // 2))
    of_pixels = np.tile(angles, repeats)[: shape[0], : shape[1]]
    if sensor.angle_spread_deg > 0:
        # Always the same draw: the sensor is the same one in every scene.
        pattern = np.random.default_rng(0).standard_normal(shape)
        of_pixels = of_pixels + sensor.angle_spread_deg * pattern
    return analyser(of_pixels, sensor.extinction_ratio)


def _behind_colours(passing: Float64Array, sensor: Sensor, channels: Channels) -> Float64Array:
    """Light of the frames (frames, height, width) from that in every channel."""
    if sensor.bayer is None:
        return passing
    colour = colour_of_pixels(sensor.bayer, channels, passing.shape[1:])
    return np.take_along_axis(passing, colour[None], axis=0)


def colour_of_pixels(bayer: str, channels: Channels, shape: tuple[int, ...]) -> IntArray:
    """Index of each pixel's channel (height, width): squares of 2 x 2 pixels have one colour.

    Examples
    --------
    >>> channels = Sensor(bayer="rggb", sensitivities="nikon-5100").channels((450.0, 550.0, 650.0))
    >>> channels.names, colour_of_pixels("rggb", channels, (4, 4)).tolist()[0]
    (('b', 'g', 'r'), [2, 2, 1, 1])
    """
    squares = np.array([channels.names.index(letter) for letter in bayer]).reshape(2, 2)
    row, column = (np.arange(size) // 2 % 2 for size in shape)
    return squares[row[:, None], column[None, :]]


def _exposure(signal: Float64Array, sensor: Sensor) -> float:
    """Electrons a unit of signal."""
    if sensor.exposure is not None:
        return sensor.exposure
    brightest = float(np.quantile(signal, BRIGHTEST, method="higher"))
    return sensor.fill * sensor.full_well / (brightest if brightest > 0 else 1.0)


def _digital(
    electrons: Float64Array, sensor: Sensor, random: np.random.Generator
) -> NDArray[np.uint16]:
    """Digital numbers of expected electrons (height, width), with noise."""
    # Beyond twice the full well every pixel is saturated, and Poisson's numbers stay small.
    collected = random.poisson(np.minimum(electrons, 2.0 * sensor.full_well + 100.0))
    read = np.minimum(collected, sensor.full_well) + sensor.read_noise * random.standard_normal(
        electrons.shape
    )
    numbers = np.rint(sensor.dark_level + sensor.digital_gain * read)
    return np.clip(numbers, 0, sensor.largest_number).astype(np.uint16)
