"""The ways to render without malus, which `malus bench render` times, make malus' pictures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from malus.renderers import render
from malus.renderers.comparison.plain_mitsuba import StokesByHand, plate_image
from malus.renderers.variant import choose
from malus.scenes import Camera, Dielectric, Distant, Sampling, Scene, Sphere
from malus.scenes.polarisation import polarised

BANDS = (450.0, 650.0)
SAMPLING = Sampling(samples=512)


def scene(eta: float, alpha: float, albedo: tuple[float, float]) -> Scene:
    surface = Dielectric(eta=eta, alpha=alpha, albedo=albedo, body="polarised")
    light, camera = Distant(incidence_deg=60), Camera(resolution=12)
    return Scene(shape=Sphere(), surface=surface, light=light, camera=camera, wavelengths_nm=BANDS)


LOADED, OTHER = scene(1.4, 0.2, (0.9, 0.6)), scene(1.7, 0.4, (0.5, 0.1))


def by_plate(angle_deg: float) -> np.ndarray:
    return plate_image(choose(), OTHER, 1, angle_deg, SAMPLING)


def by_hand(angle_deg: float) -> np.ndarray:
    """From a scene that was loaded with another index, roughness and albedo."""
    return StokesByHand(choose(), LOADED).images(OTHER, 1, (angle_deg,), SAMPLING)[0]


@pytest.mark.parametrize("way", [by_plate, by_hand])
@pytest.mark.parametrize("angle_deg", [0.0, 30.0])  # off the axes, where signs of s2 show
def test_other_ways_make_the_same_picture(
    way: Callable[[float], np.ndarray], angle_deg: float
) -> None:
    truth = render(OTHER, SAMPLING)
    true, theirs = polarised(truth.stokes[:, :, 1], angle_deg), way(angle_deg)
    # At most half of the components' errors together; √2, as theirs is as noisy.
    error = truth.standard_error[:, :, 1].sum(axis=-1) / np.sqrt(2)
    for half in (np.s_[:6], np.s_[6:]):
        for part in (np.s_[:, :6], np.s_[:, 6:]):
            inside = truth.mask[half][part]
            off = (theirs - true)[half][part][inside].sum()
            bound = 5 * np.sqrt((error[half][part][inside] ** 2).sum())
            assert abs(off) < bound + 1e-5 * inside.sum()  # sums of float32
            # Sharp enough: a tenth of the light would show even in the darkest quarter.
            assert bound < 0.1 * true[half][part][inside].sum()
