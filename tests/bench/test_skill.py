"""Where there is no skill to report: rounding in place of polarisation, more noise than error."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from malus.bench import score
from malus.bench.scoring.metrics import SIGNIFICANCE, Error, skill
from malus.renderers import render
from malus.renderers.truth import Truth
from malus.scenes import Camera, Dielectric, Distant, Sampling, Scene, Sphere

SCENE = Scene(
    shape=Sphere(),
    surface=Dielectric(eta=1.5, alpha=0.3),
    light=Distant(incidence_deg=60),
    camera=Camera(resolution=12),
)


def of_degree(truth: Truth, factor: float) -> Truth:
    """The mirrored light alone, its polarisation and that of its noise times a factor."""
    weights = np.array([1.0, factor, factor], np.float32)
    specular, noise = truth.specular * weights, truth.specular_noise * weights
    dark = np.zeros_like(specular)
    return replace(truth, specular=specular, specular_noise=noise, diffuse=dark, diffuse_noise=dark)


def test_rounding_is_no_polarisation() -> None:
    """Gold under a lamp at the camera: s1 of 5e-9 of the peak, the same in both halves."""
    truth = render(SCENE, Sampling(samples=64))
    result = score(of_degree(truth, 5e-9), "eq8")
    of_noise = result.agreement.gain, result.agreement.rotation, result.agreement.facing_skill
    assert all(map(math.isnan, (result.skill, *(value for value, _ in of_noise))))
    assert math.isfinite(score(of_degree(truth, 1e-4), "eq8").skill)


def test_more_noise_than_error_is_no_skill() -> None:
    """The guess's own error beside a response of 50 times it: a search that a draw turned over."""
    guess = Error(1.6e-5, 8.1e-6)
    assert math.isnan(skill(Error(guess.nmse, 7.8e-4), guess, pixels=800))
    # A perfect method's skill scatters around 1 by a tenth at most, where the guess has any.
    barely = Error(1.0 + SIGNIFICANCE * math.sqrt(2 / 800), 1.0)
    lucky = 1.0 - 4 * math.sqrt(2 / 800)
    assert skill(Error(lucky, 1.0), barely, pixels=801) == pytest.approx(1.4, abs=0.01)


def test_a_guess_is_significant_by_how_far_drawn_noise_strays() -> None:
    """Noise is known as well as a mean of squares of normal deviates, one a pixel."""
    pixels = 50
    means = np.square(np.random.default_rng(3).normal(size=(20000, pixels))).mean(axis=1)
    threshold = SIGNIFICANCE * means.std()  # which 20000 draws know to 0.6 %
    hidden, clear = (Error(1.0 + factor * threshold, 1.0) for factor in (0.95, 1.05))
    perfect = Error(1.0, 1.0)
    assert math.isnan(skill(perfect, hidden, pixels))
    assert skill(perfect, clear, pixels) == 1.0


@pytest.mark.parametrize(("beyond", "is_told"), [(0.49, True), (0.51, False)])
def test_a_skill_above_the_limit_that_is_documented_is_none(beyond: float, is_told: bool) -> None:
    """Files.md: above 1.5 a method answers to the noise by more than its whole error."""
    expected_noise = 1.0 + beyond
    told = skill(Error(1.0, expected_noise), Error(1.0, 0.0), pixels=1000)
    assert math.isfinite(told) == is_told
    if is_told:
        assert told == pytest.approx(1.0 + beyond, rel=1e-12)
