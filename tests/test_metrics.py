"""Scores against brute force, and their laws."""

from __future__ import annotations

import math

import numpy as np
import pytest

from malus.bench.judge import Judge, score
from malus.bench.metrics import Error, Residuals, Target, peak, skill, violations
from malus.bench.view import observe
from malus.reconstruct import Components, Method, Observation, get_method
from malus.renderers.truth import Truth
from malus.scenes import Camera, Dielectric, Scene, Sphere, Uniform
from malus.scenes.polarisation import PAPER_ANGLES_DEG, polarised

SIDE, BANDS = 12, 3
SCENE = Scene(
    shape=Sphere(),
    surface=Dielectric(eta=1.5, alpha=0.3),
    light=Uniform(),
    camera=Camera(resolution=SIDE),
    wavelengths_nm=(450.0, 550.0, 650.0),
)


def made_up_truth(seed: int = 0, noise: float = 0.0) -> Truth:
    """A truth with a known signal (DoLP about 0.1) and noise of a known size."""
    rng = np.random.default_rng(seed)
    shape = (SIDE, SIDE, BANDS, 3)
    specular = np.abs(rng.normal(size=shape)) * [1.0, 0.1, 0.1] + [1.0, 0, 0]
    diffuse = np.zeros(shape) + [0.5, 0, 0]
    return Truth(
        scene=SCENE,
        specular=specular,
        diffuse=diffuse,
        normals=np.zeros((SIDE, SIDE, 3)) + [0, 0, 1],
        mask=rng.random((SIDE, SIDE)) < 0.7,
        standard_error=np.full(shape, noise),
        specular_noise=noise * rng.normal(size=shape),
        diffuse_noise=np.zeros(shape),
    )


def constant_guess(observation: Observation) -> Components:
    image = observation.image
    return Components(0.9 * image, 0.02 * image, -0.05 * image)


GUESS = Method("guess", frozenset(), constant_guess, "a made-up method")


def brute_force_nmse(estimate: Components, truth: Truth, angles: tuple[float, ...]) -> float:
    """The definition of physics.md, in loops over pixels, bands and angles."""
    largest = max(
        truth.image[y, x, b]
        for y in range(SIDE)
        for x in range(SIDE)
        for b in range(BANDS)
        if truth.mask[y, x]
    )
    squares = []
    for y in range(SIDE):
        for x in range(SIDE):
            if not truth.mask[y, x]:
                continue
            for b in range(BANDS):
                for angle in angles:
                    true = polarised(truth.stokes[y, x, b], angle)
                    estimated = polarised(estimate.stokes[y, x, b], angle)
                    squares.append(((estimated - true) / largest) ** 2)
    return float(np.mean(squares))


@pytest.mark.parametrize("angles", [PAPER_ANGLES_DEG, (30.0,), (0.0, 45.0)])
def test_nmse_equals_brute_force(angles: tuple[float, ...]) -> None:
    truth = made_up_truth()
    estimate = constant_guess(observe(truth, frozenset()))
    residuals = Residuals.of(Target.of(truth).missed_by(estimate), peak(truth))
    assert residuals.nmse(angles) == pytest.approx(
        brute_force_nmse(estimate, truth, angles), rel=1e-10
    )


def test_shards_add_up_to_the_whole() -> None:
    difference = np.random.default_rng(1).normal(size=(60, BANDS, 3))
    whole = Residuals.of(difference, 2.0)
    shards = Residuals.of(difference[:17], 2.0) + Residuals.of(difference[17:], 2.0)
    assert shards.nmse() == pytest.approx(whole.nmse(), rel=1e-12)
    assert shards.pixels == whole.pixels


def test_trivial_guess_has_no_skill_and_truth_has_all() -> None:
    truth = made_up_truth()
    assert score(truth, "unpolarised").skill == 0.0
    perfect = Method(
        "perfect",
        frozenset(),
        lambda o: Components(truth.stokes[..., 0], truth.stokes[..., 1], truth.stokes[..., 2]),
        "knows everything",
    )
    assert score(truth, perfect).skill == pytest.approx(1.0, abs=1e-12)


def test_skill_is_corrected_for_noise() -> None:
    """The same bias with and without noise has the same skill within its statistical error."""
    clean = score(made_up_truth(), GUESS)
    rng = np.random.default_rng(5)
    skills = []
    for seed in range(20):
        truth = made_up_truth()
        noise = 0.02 * rng.normal(size=truth.specular.shape)
        # Half the difference of two halves has the variance of the mean, by construction.
        draw = 0.02 * np.random.default_rng(seed + 100).normal(size=truth.specular.shape)
        noisy = Truth(
            truth.scene,
            truth.specular + noise,
            truth.diffuse,
            truth.normals,
            truth.mask,
            truth.standard_error,
            draw,
            truth.diffuse_noise,
        )
        skills.append(score(noisy, GUESS).skill)
    uncertainty = np.std(skills) / math.sqrt(len(skills))
    assert np.mean(skills) == pytest.approx(clean.skill, abs=4 * uncertainty)
    assert uncertainty < 0.01


def test_pure_noise_has_no_skill_to_report() -> None:
    rng = np.random.default_rng(2)
    shape = (SIDE, SIDE, BANDS, 3)
    flat = np.zeros(shape) + [1.0, 0, 0]
    truth = Truth(
        SCENE,
        flat + 0.01 * rng.normal(size=shape),
        np.zeros(shape),
        np.zeros((SIDE, SIDE, 3)),
        np.ones((SIDE, SIDE), bool),
        np.full(shape, 0.01),
        0.01 * rng.normal(size=shape),
        np.zeros(shape),
    )
    assert math.isnan(score(truth, GUESS).skill)
    assert math.isnan(skill(Error(1.0, 0.0), Error(0.0, 0.0), 10))


def test_violations_are_counted() -> None:
    image = np.ones((2, 3, 1))
    s1 = np.array([[[0.0], [1.1], [np.nan]], [[0.5], [0.0], [-1.0]]])
    total = image.copy()
    total[1, 1] = 1.0001
    mask = np.ones((2, 3), bool)
    assert violations(Components(total, s1, 0 * image), image, mask) == 3
    mask[0, 1] = False
    assert violations(Components(total, s1, 0 * image), image, mask) == 2


def test_table_values_belong_together() -> None:
    """The mean over single angles, and over bands, is the value over all of them."""
    values = list(Judge(made_up_truth()).score(GUESS).values())
    nmse = [v for v in values if v.metric == "nmse"]
    whole = next(v for v in nmse if v.band_nm is None and v.angle_deg is None)
    angles = [v.value for v in nmse if v.angle_deg is not None]
    bands = [v.value for v in nmse if v.band_nm is not None]
    assert len(angles) == 5
    assert len(bands) == BANDS
    assert np.mean(angles) == pytest.approx(whole.value, rel=1e-12)
    assert np.mean(bands) == pytest.approx(whole.value, rel=1e-12)


def test_methods_see_only_what_they_need() -> None:
    truth = made_up_truth()
    seen = observe(truth, get_method("eq8").needs)
    assert seen.light is None
    blind = observe(truth, frozenset())
    known = ("specular", "diffuse", "normals", "eta", "alpha", "light")
    assert all(getattr(blind, name) is None for name in known)
    with pytest.raises(ValueError, match="needs"):
        observe(truth, frozenset({"stokes"}))
