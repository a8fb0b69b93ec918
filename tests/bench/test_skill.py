"""Where there is no skill to report: rounding in place of polarisation, more noise than error."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from malus.bench import score
from malus.bench.scoring.metrics import SIGNIFICANCE, Error, skill
from malus.renderers import render
from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere

SCENE = Scene(
    shape=Sphere(),
    surface=Dielectric(eta=1.5, alpha=0.3),
    light=Distant(incidence_deg=60),
    camera=Camera(resolution=12),
)


def weights(polarised: float) -> np.ndarray:
    return np.array([1.0, polarised, polarised], np.float32)


def test_rounding_is_no_polarisation() -> None:
    """Gold under a lamp at the camera: s1 of 5e-9 of the peak, the same in both halves."""
    truth = render(SCENE, renderer="torrance-sparrow")
    dark = replace(truth, specular=truth.specular * weights(5e-9), diffuse=0.0 * truth.diffuse)
    result = score(dark, "eq8")
    of_noise = result.agreement.gain, result.agreement.rotation, result.agreement.facing_skill
    assert all(map(math.isnan, (result.skill, *(value for value, _ in of_noise))))
    told = replace(dark, specular=truth.specular * weights(1e-4))
    assert math.isfinite(score(told, "eq8").skill)


def test_more_noise_than_error_is_no_skill() -> None:
    """The guess's own error beside a response of 50 times it: a search that a draw turned over."""
    guess = Error(1.6e-5, 8.1e-6)
    assert math.isnan(skill(Error(guess.nmse, 7.8e-4), guess, pixels=800))
    # A perfect method's skill scatters around 1 by a tenth at most, where the guess has any.
    barely = Error(1.0 + SIGNIFICANCE * math.sqrt(2 / 800), 1.0)
    lucky = 1.0 - 4 * math.sqrt(2 / 800)
    assert skill(Error(lucky, 1.0), barely, pixels=801) == pytest.approx(1.4, abs=0.01)
