"""Scores against brute force, and their laws."""

from __future__ import annotations

import math
from dataclasses import replace

import made_up as single
import numpy as np
import pytest

from malus.bench.scoring.extra_metrics import METRICS
from malus.bench.scoring.judge import Judge
from malus.bench.scoring.masked_pixels import MaskedPixels
from malus.bench.scoring.metrics import Error, Residuals, cos_zenith, nmse_by, skill
from malus.bench.scoring.observe import observe
from malus.bench.scoring.pixel_kernels import MOST_BANDS, difference_sums
from malus.bench.scoring.score import score
from malus.reconstruct import Components, Method, Observation, get_method, methods
from malus.renderers import render
from malus.renderers.truth import Truth
from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere, Uniform
from malus.scenes.polarisation import PAPER_ANGLES_DEG, polarised

SIDE, BANDS = 20, 3  # more pixels than are summed at once
NOISES = ("standard_error", "specular_noise", "diffuse_noise")
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
        diffuse_noise=0.5 * noise * rng.normal(size=shape),
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
    residuals = Judge(truth).score(GUESS).residuals
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


def test_what_faces_a_camera_nearby_is_what_is_turned_towards_it() -> None:
    """A ball's rim is where rays touch it, not where its normal lies in the image plane."""
    camera = Camera(resolution=SIDE, projection="perspective", fov_deg=60, distance=2.2)
    truth = replace(made_up_truth(), scene=SCENE.model_copy(update={"camera": camera}))
    truth.normals[:] = [0.6, 0.0, 0.8]
    y, x = np.nonzero(truth.mask)
    across = np.tan(np.radians(30)) * ((2 * np.arange(SIDE) + 1) / SIDE - 1)
    rays = np.stack([across[x], -across[y], -np.ones(len(x))], axis=-1)
    expected = -rays @ [0.6, 0.0, 0.8] / np.linalg.norm(rays, axis=-1)
    np.testing.assert_allclose(cos_zenith(truth), expected, atol=1e-12)
    assert Judge(truth).facing == pytest.approx(expected**4, abs=1e-12)


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


def test_a_black_picture_has_no_error_and_no_skill() -> None:
    shape = (SIDE, SIDE, BANDS, 3)
    black = replace(
        made_up_truth(),
        **{name: np.zeros(shape) for name in ("specular", "diffuse", *NOISES)},
    )
    scored = Judge(black).score(GUESS, [METRICS["polarisation"]])
    values = {v.metric: v.value for v in scored.values() if v.angle_deg is None}
    assert [values[name] for name in ("nmse", "s1_rmse", "s2_rmse", "nmse_i_max")] == [0.0] * 4
    assert math.isnan(values["skill"])


def test_violations_are_counted() -> None:
    truth = made_up_truth()
    truth.mask[:] = False
    truth.mask[0, :6] = True
    total, s1 = truth.image.copy(), np.zeros_like(truth.image)
    s1[0, 1, 0] = -1.1 * total[0, 1, 0]  # DoLP > 1 in one band
    s1[0, 2] = np.nan
    s1[0, 3] = 0.5 * total[0, 3]
    s1[0, 4] = total[0, 4]  # exactly one
    total[0, 5, 1] *= 1.0001
    s1[5, 5] = np.inf  # off the mask
    method = Method(
        "bad", frozenset(), lambda observation: Components(total, s1, np.zeros_like(s1)), ""
    )
    assert Judge(truth).score(method).violations == 3
    truth.mask[0, 1] = False
    assert Judge(truth).score(method).violations == 2
    total[0, 0] = -1.0
    assert Judge(truth).score(method).violations == 3


@pytest.mark.parametrize(("excess", "found"), [(1e-3, 1), (1e-5, 1), (2e-7, 0)])
def test_single_precision_hides_no_violation(excess: float, found: int) -> None:
    """A few roundings of 1.2e-7 lead to a degree of one and no more."""
    truth = single.made_up_truth()
    image = truth.image
    s1 = np.zeros_like(image)
    s1[truth.mask] = image[truth.mask] * [np.float32(1.0 + excess), 0, 0]
    method = Method("over", frozenset(), lambda _: Components(image, s1, 0 * s1), "")
    assert Judge(truth).score(method).violations == found * truth.mask.sum()


def test_pixels_are_invalid_as_rendered_and_not_by_their_noise() -> None:
    truth = made_up_truth()
    (dark, noisy), at = np.argwhere(truth.mask)[:2], (0, 0)
    truth.specular[*dark, *at] = -1.0  # with a body of 0.5
    truth.specular_noise[*noisy, *at] = -100.0

    def lit(observation: Observation) -> Components:
        image = observation.image
        return Components(image, 0 * image, 0 * image, valid=(image > 0).all(axis=-1))

    for per_pixel in (True, False):
        method = Method("lit", frozenset(), lit, "of what is lit", per_pixel=per_pixel)
        assert Judge(truth).score(method).invalid == 1


def test_what_a_method_tells_of_the_noisy_picture_alone_is_not_scored() -> None:
    """One of its own may tell invalid pixels, and its error, only where it finds any."""
    truth = made_up_truth()
    truth.specular_noise[truth.mask] = 0.01

    def seldom(observation: Observation) -> Components:
        image, mask = observation.image, observation.mask
        if np.array_equal(image, truth.image):
            return Components(image, 0 * image, 0 * image)
        return Components(image, 0 * image, 0 * image, ~mask, deviation=np.ones_like(image))

    score = Judge(truth).score(Method("seldom", frozenset(), seldom, "", per_pixel=False))
    assert score.invalid == 0
    assert score.extra == ()


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


def brute_force_agreement(truth: Truth, method: Method) -> tuple[np.ndarray, np.ndarray]:
    """Totals and covariance from both halves of the samples, as matrix products in NumPy."""
    halves = truth.halves()
    weight = np.clip(truth.normals[truth.mask][:, 2], 0, 1) ** 4
    true = [half.stokes[truth.mask] for half in halves]
    estimates = [
        method.reconstruct(observe(half, method.needs)).stokes[truth.mask] for half in halves
    ]
    missed = [f - t for f, t in zip(estimates, true, strict=True)]
    polarised = [t * [0, 1, 1] for t in true]
    across = [t[..., [0, 2, 1]] * [0, -1, 1] for t in true]
    angles = np.radians(PAPER_ANGLES_DEG)
    rows = 0.5 * np.stack([np.ones(5), -np.cos(2 * angles), -np.sin(2 * angles)], axis=-1)

    def through_polarisers(stokes: np.ndarray) -> np.ndarray:
        return stokes @ rows.T / np.sqrt(5) * np.sqrt(weight)[:, None, None]

    pairs = [
        (missed, polarised),
        (missed, across),
        ([through_polarisers(m) for m in missed], [through_polarisers(m) for m in missed]),
        (polarised, polarised),
        ([through_polarisers(p) for p in polarised], [through_polarisers(p) for p in polarised]),
    ]
    largest = truth.image[truth.mask].max()
    totals, draws = [], []
    for a, b in pairs:
        # Products of independent halves; and what is odd in the noise, which one draw of it adds.
        totals.append(0.5 * np.sum(a[0] * b[1] + a[1] * b[0]) / largest**2)
        draws.append(0.5 * np.sum(a[0] * b[0] - a[1] * b[1], axis=(1, 2)) / largest**2)
    return np.array(totals), np.array(draws) @ np.array(draws).T


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_agreement_equals_brute_force(noise: float) -> None:
    truth = made_up_truth(3, noise)
    normals = np.random.default_rng(4).normal(size=truth.normals.shape)
    truth.normals[:] = normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    agreement = Judge(truth).score(GUESS).agreement
    totals, covariance = brute_force_agreement(truth, GUESS)
    # Sums of a few hundred float64 products in another order.
    np.testing.assert_allclose(agreement.totals, totals, rtol=1e-10)
    np.testing.assert_allclose(agreement.covariance, covariance, rtol=1e-9, atol=1e-14)
    assert agreement.count == truth.mask.sum() * BANDS


def test_a_turned_field_of_equal_strength_has_sine_and_cosine_of_twice_the_angle() -> None:
    """What `rotation` and `gain` are said to be; positive is anticlockwise."""
    truth, delta = made_up_truth(), math.radians(10)
    turn = np.exp(2j * delta) * (truth.stokes[..., 1] + 1j * truth.stokes[..., 2])
    method = Method(
        "turned", frozenset(), lambda seen: Components(seen.image, turn.real, turn.imag), ""
    )
    agreement = score(truth, method).agreement
    assert agreement.rotation[0] == pytest.approx(math.sin(2 * delta), abs=1e-6)  # float32
    assert agreement.gain[0] == pytest.approx(math.cos(2 * delta), abs=1e-6)


@pytest.mark.parametrize(("pixels", "bands"), [(0, 2), (1, 1), (700, 1), (100, 8), (3, MOST_BANDS)])
def test_sums_equal_brute_force(pixels: int, bands: int) -> None:
    """For all sizes against what is summed at once, also where the picture is not kept."""
    rng = np.random.default_rng(8)
    estimate, truth = rng.normal(size=(2, 3, 2, pixels, bands))
    facing, root = rng.random(pixels), rng.normal(size=(3, 3))
    form = root @ root.T
    (first, second), field, noise = truth
    true, draw = np.stack([first, *field]), np.stack([second - first, *noise])
    missed = estimate[:, 0] - true
    change = estimate[:, 1] - (true + draw) - missed
    draws = np.empty((1, 3, pixels))
    moments, (totals,) = difference_sums(
        tuple(estimate), tuple(truth), facing, tuple(form[np.triu_indices(3)]), draws
    )
    i, j = np.triu_indices(3)
    for products, each in zip(moments, (missed, change), strict=True):
        np.testing.assert_allclose(
            products, (each[i] * each[j]).sum(axis=1), rtol=1e-10, atol=1e-11
        )
    along = np.diag([0.0, 1.0, 1.0])
    across = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    terms = [
        (along, missed, true, change, draw, np.ones(pixels)),
        (across, missed, true, change, draw, np.ones(pixels)),
        (form, missed, missed, change, change, facing),
    ]
    for k, (matrix, d, t, c, n, weight) in enumerate(terms):
        each = np.einsum("ij,ipb,jpb->p", matrix, d, t) - np.einsum("ij,ipb,jpb->p", matrix, c, n)
        odd = np.einsum("ij,ipb,jpb->p", matrix, d, n) + np.einsum("ij,ipb,jpb->p", matrix, c, t)
        # A thousand float64 products in another order.
        np.testing.assert_allclose(totals[k], each @ weight, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(draws[0, k], odd * weight, rtol=1e-10, atol=1e-10)


def test_noise_is_what_one_draw_changes() -> None:
    truth = made_up_truth(6, noise=0.05)
    score = Judge(truth).score(GUESS)
    half = truth.halves()[0]
    first, second = (
        constant_guess(observe(t, frozenset())).stokes - t.stokes for t in (truth, half)
    )
    change = (second - first)[truth.mask] / truth.image[truth.mask].max()
    expected = np.mean([polarised(change, a) ** 2 for a in PAPER_ANGLES_DEG])
    assert score.noise.nmse() == pytest.approx(expected, rel=1e-10)
    bands = nmse_by([score.residuals, score.noise], ((30.0,), PAPER_ANGLES_DEG))
    assert bands.shape == (2, 2, BANDS)
    assert bands[1, 1].mean() == pytest.approx(expected, rel=1e-10)


def per_pixel_methods() -> list[str]:
    return [name for name, method in methods().items() if method.per_pixel]


@pytest.mark.parametrize("name", per_pixel_methods())
def test_methods_a_pixel_need_no_picture(name: str) -> None:
    """What they make of the mask's pixels in a row is what they make of the picture."""
    surface = Dielectric(eta=1.5, alpha=0.3, body="unpolarised")
    scene = SCENE.model_copy(update={"light": Distant(incidence_deg=50), "surface": surface})
    truth = render(scene, renderer="torrance-sparrow")
    truth.specular_noise[...] = 0.01 * truth.specular[..., ::-1, :, :]
    pixels, method = MaskedPixels.of(truth), get_method(name)
    rows, pictures = (
        pixels.estimate(replace(method, per_pixel=flag)).stokes for flag in (True, False)
    )
    assert rows.shape == pictures.shape == (2, truth.mask.sum(), BANDS, 3)
    # The same operations on the same numbers, vectorised over other lengths.
    np.testing.assert_allclose(rows, pictures, rtol=0, atol=1e-6 * truth.image.max())


def test_methods_see_only_what_they_need() -> None:
    truth = made_up_truth()
    observation = observe(truth, get_method("eq8").needs)
    assert observation.light is None
    blind = observe(truth, frozenset())
    names = ("specular", "diffuse", "normals", "eta", "alpha", "light")
    assert all(getattr(blind, name) is None for name in names)
    with pytest.raises(ValueError, match="needs"):
        observe(truth, frozenset({"stokes"}))
