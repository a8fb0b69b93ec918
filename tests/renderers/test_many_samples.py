"""Many samples a pixel: rounding of their sums must stay below what is left of the noise."""

from __future__ import annotations

import numpy as np
import pytest
from rooms import needs_arrays

from malus.renderers import Truth
from malus.renderers.families.family import render_family
from malus.scenes import (
    Camera,
    Dielectric,
    Distant,
    Placed,
    Plane,
    Sampling,
    Scene,
    Sphere,
    Surroundings,
)

# So smooth that nothing is reflected towards the camera: all light is the body's.
SURFACE = Dielectric(eta=1.5, alpha=0.01, albedo=0.31, body="unpolarised")
INCIDENCE_DEG = 50.0
BEHIND = Surroundings(
    name="behind", objects=(Placed(shape=Plane(), surface=SURFACE, position=(0, 0, -3)),)
)
MANY = 1 << 16


def middle_of_a_ball(
    half_width: float, samples: int, surroundings: Surroundings | None = None
) -> Truth:
    """The middle of a ball under a distant light, almost flat; what is behind it is not seen."""
    scene = Scene(
        shape=Sphere(),
        surface=SURFACE,
        light=Distant(incidence_deg=INCIDENCE_DEG, azimuth_deg=0),
        camera=Camera(resolution=4, half_width=half_width),
        surroundings=surroundings,
    )
    sampling = Sampling(samples=samples, max_depth=2)
    return render_family([scene], sampling).truth(scene)


@needs_arrays
@pytest.mark.parametrize("surroundings", [None, BEHIND], ids=["alone", "room"])
def test_a_matt_surface_is_as_bright_as_lambert_says(surroundings: Surroundings | None) -> None:
    """A body of albedo ρ under a light from the angle i: ρ cos i, less h²/3 over a curved window.

    The law of Lambert; the lamp's irradiance is π.
    """
    half_width = 1e-3
    truth = middle_of_a_ball(half_width, MANY, surroundings)
    assert truth.mask.all()
    assert not truth.specular.any()
    lambert = 0.31 * np.cos(np.radians(INCIDENCE_DEG)) * (1 - half_width**2 / 3)
    # A pixel's samples differ by 1.7e-4 (standard deviation over mean), the mean of 2^20 by 1.7e-7.
    # The rest is float32 of single samples. Sums in float32 are wrong by 2e-4.
    assert float(truth.image.mean(dtype=np.float64)) == pytest.approx(lambert, rel=1.5e-6)
    halves = truth.diffuse_noise[..., 0]
    # Half the difference of two halves: one deviation is 7e-7 of the mean; five, of 16 pixels.
    assert np.abs(halves).max() < 3.5e-6 * lambert


@needs_arrays
@pytest.mark.parametrize("surroundings", [None, BEHIND], ids=["alone", "room"])
@pytest.mark.parametrize("samples", [4096, MANY])
def test_standard_errors_fall_as_one_over_the_root(
    samples: int, surroundings: Surroundings | None
) -> None:
    """In a pixel of width w light rises evenly by ρ sin i w: its deviation is that over √12."""
    half_width = 0.1 if samples == 4096 else 0.01
    truth = middle_of_a_ball(half_width, samples, surroundings)
    rise = 0.31 * np.sin(np.radians(INCIDENCE_DEG)) * half_width / 2
    expected = rise / np.sqrt(12 * samples)
    # The curvature changes the slope by up to h / tan i: 8 % at the edges of the wider window and
    # 0.8 % of the narrow one. An error from 2^16 samples is wrong by 0.35 % (two deviations).
    found = truth.standard_error[..., 0]
    assert found == pytest.approx(expected, rel=0.1 if samples == 4096 else 0.015)
    # The residuals are those that the errors say: 16 squares of mean 1, one deviation is 0.35.
    x = (np.arange(4) - 1.5) * half_width / 2
    column, row = np.meshgrid(x, -x)
    square = half_width**2 / 12
    height = 1 - (column**2 + row**2) / 2 - square / 4
    angle = np.radians(INCIDENCE_DEG)
    exact = 0.31 * (np.sin(angle) * column + np.cos(angle) * height)
    squares = ((truth.image[..., 0] - exact) / found[..., 0]) ** 2
    assert 0.2 < squares.mean() < 2.5
