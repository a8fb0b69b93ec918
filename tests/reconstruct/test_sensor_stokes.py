"""Raw frames of polarisation cameras demosaic to the light that fell on them, as theory says."""

from __future__ import annotations

import numpy as np
import pytest

from malus.reconstruct.photos.sensor_stokes import demosaiced_stokes
from malus.scenes.polarisation import aolp, dolp
from malus.scenes.sensor import Sensor
from malus.scenes.sensor_frame import expose, seen

FINE = {"exposure": 5e8, "full_well": 1e9, "bit_depth": 16}
"""Photon noise of 3e-5 and numbers of 1.5e-5 of the full scale."""


def field(degree: float, angle_deg: float, side: int = 16, bands: int = 1) -> np.ndarray:
    turns = 2 * np.radians(angle_deg)
    return np.tile([1.0, degree * np.cos(turns), degree * np.sin(turns)], (side, side, bands, 1))


def mean_stokes(sensor: Sensor, light: np.ndarray) -> np.ndarray:
    return demosaiced_stokes(expose(light, sensor)).mean(axis=(0, 1))[0].astype(float)


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 90.0, 137.0])
def test_an_extinction_ratio_lowers_a_degree_of_one(angle_deg: float) -> None:
    """By (ratio - 1) / (ratio + 1), unless the user has calibrated it."""
    sensor, light = Sensor(extinction_ratio=100.0, **FINE), field(1.0, angle_deg)
    # The noise of a mean of 256 pixels is below 1e-5.
    assert dolp(mean_stokes(sensor, light)) == pytest.approx(99 / 101, abs=5e-5)
    calibrated = sensor.model_copy(update={"calibrated": True})
    assert dolp(mean_stokes(calibrated, light)) == pytest.approx(1.0, abs=5e-5)


def test_turned_polarisers_turn_what_is_not_calibrated() -> None:
    sensor, light = Sensor(angle_errors_deg=(3.0,) * 4, **FINE), field(0.6, 70.0)
    assert np.degrees(aolp(mean_stokes(sensor, light))) == pytest.approx(67.0, abs=0.01)
    calibrated = sensor.model_copy(update={"calibrated": True})
    assert np.degrees(aolp(mean_stokes(calibrated, light))) == pytest.approx(70.0, abs=0.01)
    crooked = Sensor(angle_errors_deg=(1.0, -2.0, 3.0, 0.5), calibrated=True, **FINE)
    assert mean_stokes(crooked, light) == pytest.approx(light[0, 0, 0], abs=5e-5)


def test_a_uniform_field_demosaics_to_itself_within_its_noise() -> None:
    electrons, side = 4000.0, 64
    sensor = Sensor(exposure=electrons, full_well=1e4, read_noise=2.0, bit_depth=14)
    light = field(0.4, 25.0, side)
    stokes = demosaiced_stokes(expose(light, sensor))[:, :, 0].astype(float)
    # s1 is the difference of two pixels, which hold all electrons together.
    noise = np.sqrt(electrons + 2 * 2.0**2) / electrons
    # A quarter of the pixels look along each axis.
    error_of_mean = noise / np.sqrt(side**2 / 4)
    assert np.abs(stokes.mean(axis=(0, 1)) - light[0, 0, 0]).max() < 4 * error_of_mean
    # Interpolation averages; it must not add noise.
    assert stokes[..., 1:].std(axis=(0, 1)).max() < 1.1 * noise


def test_bands_and_colours_come_back_in_their_channels() -> None:
    bands = (450.0, 550.0, 650.0)
    light = field(0.5, 110.0, 24, 3) * np.array([0.3, 1.0, 0.6])[:, None]
    colour = Sensor(bayer="rggb", sensitivities="sigma-sd-merrill", **FINE)
    for sensor in (Sensor(**FINE), Sensor(sensitivities="flat", **FINE), colour):
        frame = expose(light, sensor, bands)
        stokes = demosaiced_stokes(frame)
        ideal = seen(light, frame.channels)
        assert stokes.shape == ideal.shape
        # The least sensitive channel has a twentieth of the electrons: noise of 2e-4.
        assert np.abs(stokes - ideal).max() < 2e-3


@pytest.mark.parametrize("bands", [(550.0,), (450.0, 550.0, 650.0)])
def test_a_dark_band_has_no_light_and_is_a_number(bands: tuple[float, ...]) -> None:
    """Beside lit ones, and alone: without read noise every electron is missing."""
    light = np.zeros((16, 16, len(bands), 3))
    light[:, :, 1:, 0] = 1.0
    with np.errstate(invalid="raise", divide="raise"):
        stokes = demosaiced_stokes(expose(light, Sensor(exposure=5000.0), bands))
    assert not stokes[:, :, 0].any()
    # Of 256 pixels with 1250 electrons each, 0.2 %, and their neighbours see the same ones.
    np.testing.assert_allclose(stokes[:, :, 1:, 0].mean(axis=(0, 1)), 1.0, rtol=0.02)
