"""Errors of degree, angle, Stokes components and images against loops written apart."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import truth_with
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from malus.bench.scoring.extra_metrics import METRICS, ZENITHS_DEG, get_metrics
from malus.bench.scoring.judge import Judge
from malus.bench.scoring.metric_value import MetricValue
from malus.bench.scoring.metrics import PixelSums, Residuals
from malus.bench.scoring.polarisation_error import (
    PolarisationError,
    psnr,
    scaled,
    squared_error,
    ssim,
)
from malus.reconstruct import Components, get_method
from malus.renderers import render
from malus.renderers.truth import Truth
from malus.scenes import Camera, Dielectric, Sampling, Scene, Sphere, Uniform
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import PAPER_ANGLES_DEG

SIDE, BANDS = 14, 3


def made_up(seed: int = 0) -> tuple[Truth, Components]:
    """A truth and an estimate with every angle and degrees of polarisation up to 0.6."""
    rng = np.random.default_rng(seed)
    shape = (SIDE, SIDE, BANDS, 3)
    stokes = rng.uniform(-0.3, 0.3, shape) + np.array([1.0, 0, 0])
    mask = rng.random((SIDE, SIDE)) < 0.7
    truth = truth_with(stokes, mask, noise=0.01 * rng.normal(size=shape))
    guess = stokes + rng.uniform(-0.1, 0.1, shape)
    return truth, Components(guess[..., 0], guess[..., 1], guess[..., 2])


def brute_force(truth: Truth, estimate: Components) -> dict[str, float]:
    """The definitions of physics.md in loops, with angles from complex numbers."""
    largest = truth.image[truth.mask].max()
    dolp, aolp, weights, s1, s2 = [], [], [], [], []
    i_max, i_min = [], []
    for y, x in zip(*np.nonzero(truth.mask), strict=True):
        for b in range(BANDS):
            t, e = truth.stokes[y, x, b], estimate.stokes[y, x, b]
            t_field, e_field = complex(t[1], t[2]), complex(e[1], e[2])
            dolp.append(abs(abs(e_field) / e[0] - abs(t_field) / t[0]))
            # Twice the angle between them is the phase of their quotient, in (−π, π].
            quotient = e_field / t_field
            aolp.append(abs(math.atan2(quotient.imag, quotient.real)) / 2)
            weights.append(abs(t_field))
            s1.append(((e[1] - t[1]) / largest) ** 2)
            s2.append(((e[2] - t[2]) / largest) ** 2)
            i_max.append(((e[0] + abs(e_field) - t[0] - abs(t_field)) / (2 * largest)) ** 2)
            i_min.append(((e[0] - abs(e_field) - t[0] + abs(t_field)) / (2 * largest)) ** 2)
    return {
        "dolp_mae": float(np.mean(dolp)),
        "aolp_mae_deg": math.degrees(np.dot(aolp, weights) / np.sum(weights)),
        "s1_rmse": math.sqrt(np.mean(s1)),
        "s2_rmse": math.sqrt(np.mean(s2)),
        "nmse_i_max": float(np.mean(i_max)),
        "nmse_i_min": float(np.mean(i_min)),
    }


def test_polarisation_errors_equal_brute_force() -> None:
    truth, estimate = made_up()
    values = {
        v.metric: v.value for v in METRICS["polarisation"](truth)(estimate.stokes[truth.mask])
    }
    assert values == pytest.approx(brute_force(truth, estimate), rel=1e-10)


def test_s3_and_its_noise_are_rms_over_the_peak() -> None:
    """Of the draw: the standard error is another estimate of the noise."""
    truth, estimate = made_up()
    s3, noise = np.random.default_rng(7).normal(size=(2, SIDE, SIDE, BANDS))
    truth = replace(truth, s3=s3, s3_noise=0.1 * noise, s3_standard_error=np.full(s3.shape, 0.3))
    values = {v.metric: v for v in METRICS["polarisation"](truth)(estimate.stokes[truth.mask])}
    largest = truth.image[truth.mask].max()
    for found, each in ((values["s3_rmse"].value, s3), (values["s3_rmse"].noise, 0.1 * noise)):
        expected = math.sqrt(np.mean((each[truth.mask] / largest) ** 2))
        assert found == pytest.approx(expected, rel=1e-12)


def test_shards_add_up_to_the_whole() -> None:
    """Two halves of the mask, scored apart, are the whole, with a peak that both share."""
    truth, estimate = made_up()
    upper = np.zeros_like(truth.mask)
    upper[: SIDE // 2] = True
    y, x = np.argwhere(truth.mask)[0]
    brightest = truth.specular.copy()
    brightest[truth.mask & ~upper, 0] = [1.4, 0.1, 0.1]
    brightest[y, x, 0] = [1.4, 0.1, 0.1]
    truth = replace(truth, specular=brightest)
    parts = [replace(truth, mask=truth.mask & half) for half in (upper, ~upper)]
    fields = [(scaled(estimate.stokes, t), scaled(t.stokes, t)) for t in (truth, *parts)]
    whole, first, second = (PolarisationError.of(*pair) for pair in fields)
    both = first + second
    assert both.dolp.count == whole.dolp.count
    for name in ("dolp", "s1", "s2", "i_max", "i_min"):
        added, one = getattr(both, name), getattr(whole, name)
        assert (added.mean, added.std) == pytest.approx((one.mean, one.std), rel=1e-12)
    assert both.aolp.mean == pytest.approx(whole.aolp.mean, rel=1e-12)
    single, *apart = (squared_error(*pair, angle=30.0) for pair in fields)
    assert psnr(apart[0] + apart[1]) == pytest.approx(psnr(single), rel=1e-12)


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_psnr_and_ssim_equal_scikit_image(angle: float) -> None:
    truth, estimate = made_up()
    largest = truth.image[truth.mask].max()
    everywhere = replace(truth, mask=np.ones_like(truth.mask))
    expected = peak_signal_noise_ratio(
        truth.polarised(angle)[truth.mask],
        estimate.polarised(angle)[truth.mask],
        data_range=largest,
    )
    fields = scaled(estimate.stokes, truth), scaled(truth.stokes, truth)
    assert psnr(squared_error(*fields, angle)) == pytest.approx(expected, rel=1e-10)
    _, maps = structural_similarity(
        everywhere.polarised(angle),
        estimate.polarised(angle),
        data_range=everywhere.image.max(),
        channel_axis=-1,
        full=True,
    )
    similarity = ssim(estimate.stokes[everywhere.mask], everywhere, angle)
    assert similarity.mean == pytest.approx(maps.mean(), rel=1e-10)


def test_ssim_is_the_mean_over_the_mask_and_the_bands() -> None:
    truth, estimate = made_up()
    largest = truth.image[truth.mask].max()
    means = []
    for b in range(BANDS):
        pair = [np.where(truth.mask, p.polarised(30.0)[..., b], 0) for p in (truth, estimate)]
        _, one = structural_similarity(*pair, data_range=largest, full=True)
        means.append(one[truth.mask].mean())
    similarity = ssim(estimate.stokes[truth.mask], truth, 30.0)
    assert similarity.mean == pytest.approx(np.mean(means), rel=1e-10)
    assert (similarity + similarity).count == 2


def test_what_lies_outside_the_mask_has_no_part() -> None:
    truth, estimate = made_up()
    outside = ~truth.mask
    lobes = {name: getattr(truth, name).copy() for name in ("specular", "diffuse")}
    for image in lobes.values():
        image[outside] = np.nan
    dirty = replace(truth, **lobes)
    for name, metric in METRICS.items():
        noisy, clean = (
            [v.value for v in metric(t)(estimate.stokes[t.mask])] for t in (dirty, truth)
        )
        assert noisy == pytest.approx(clean), name


def test_pixel_sums_are_numpy_statistics() -> None:
    values = np.random.default_rng(3).normal(5.0, 2.0, (40, 3))
    sums = PixelSums.of(values[:7]) + PixelSums.of(values[7:])
    assert sums.mean == pytest.approx(values.mean(), rel=1e-12)
    assert sums.std == pytest.approx(values.std(), rel=1e-12)
    assert math.isnan(PixelSums().mean)
    assert math.isnan(PixelSums().std)


def test_further_metrics_come_only_when_asked_for() -> None:
    truth, _ = made_up()
    judge, method = Judge(truth), get_method("unpolarised")
    plain = [v.metric for v in judge.score(method).values()]
    more = list(judge.score(method, get_metrics(("psnr", "polarisation"))).values())
    assert not {"psnr", "dolp_mae"} & set(plain)
    assert {"psnr", "dolp_mae"} <= {v.metric for v in more}
    angles = [v.value for v in more if v.metric == "psnr" and v.angle_deg is not None]
    assert len(angles) == len(PAPER_ANGLES_DEG)
    with pytest.raises(InputError, match="delta_e76"):
        get_metrics(("delta_e",))


def test_images_smaller_than_the_window_are_refused() -> None:
    truth, estimate = made_up()
    crop = np.s_[:6, :6]
    small = replace(
        truth, specular=truth.specular[crop], diffuse=truth.diffuse[crop], mask=truth.mask[crop]
    )
    with pytest.raises(InputError, match="7 pixels"):
        ssim(estimate.stokes[crop][small.mask], small, 0.0)


@pytest.mark.parametrize("method", ["eq8", "shadowed+body"])
def test_zenith_bins_add_up_to_the_whole(method: str) -> None:
    """Errors of the bins, and the noise in them, weighted by pixels are those of all pixels.

    With the noise of the guess for a method's own, skills by zenith were up to 0.1 too high (16
    samples, uniform light, mean of 24 seeds).
    """
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.3, body="polarised"),
        light=Uniform(),
        camera=Camera(resolution=48),
    )
    truth = render(scene, Sampling(samples=16, seed=1))
    score = Judge(truth).score(get_method(method), get_metrics(("zenith",)))
    angles = np.degrees(np.arccos(np.clip(truth.normals[truth.mask][:, 2], 0, 1)))
    counts, _ = np.histogram(angles, ZENITHS_DEG)
    values = {value.metric: value for value in score.values()}
    bins = [f"zenith_{a}_{b}" for a, b in itertools.pairwise(ZENITHS_DEG)]
    parts = [values[f"nmse_{name}"] for name in bins]
    # Sums of float64 of single-precision images, in another order.
    assert np.average([p.value for p in parts], weights=counts) == pytest.approx(
        score.nmse, rel=1e-6
    )
    whole = score.noise.nmse()
    assert np.average([p.noise for p in parts], weights=counts) == pytest.approx(whole, rel=1e-6)
    assert whole < 0.95 * score.trivial_noise.nmse()  # which is another
    told = values["skill_zenith_45_60"].value
    guess = values_of_guess(truth)["nmse_zenith_45_60"]
    rest = parts[3].value - parts[3].noise, guess.value - guess.noise
    assert told == pytest.approx(1.0 - rest[0] / rest[1], rel=1e-6)  # single precision


def values_of_guess(truth: Truth) -> dict[str, MetricValue]:
    """Values by zenith angle of the guess I(ϑ) = I/2."""
    score = Judge(truth).score(get_method("unpolarised"), get_metrics(("zenith",)))
    return {value.metric: value for value in score.values()}


def test_zenith_bins_are_scores_of_their_pixels() -> None:
    """A bin has the NMSE of its pixels over the peak of all."""
    truth, estimate = made_up()
    zenith = np.random.default_rng(9).uniform(0.0, 1.3, truth.mask.shape)
    truth = replace(truth, normals=np.stack([np.sin(zenith), 0 * zenith, np.cos(zenith)], axis=-1))
    by_name = {
        value.metric: value for value in METRICS["zenith"](truth)(estimate.stokes[truth.mask])
    }
    cosine = np.clip(truth.normals[truth.mask][:, 2], 0, 1)
    counts, _ = np.histogram(np.degrees(np.arccos(cosine)), ZENITHS_DEG)
    bins = [f"{a}_{b}" for a, b in itertools.pairwise(ZENITHS_DEG)]
    assert {name for name in by_name if name.startswith("nmse")} == {
        f"nmse_zenith_{name}" for name, count in zip(bins, counts, strict=True) if count
    }
    difference = (estimate.stokes - truth.stokes)[truth.mask]
    largest = truth.image[truth.mask].max()
    angles = np.degrees(np.arccos(cosine))
    for name, (low, high) in zip(bins, itertools.pairwise(ZENITHS_DEG), strict=True):
        inside = (angles >= low) & (angles < high)
        if inside.any():
            part = Residuals.of(difference[inside], largest).nmse()
            assert by_name[f"nmse_zenith_{name}"].value == pytest.approx(part, rel=1e-10)
            # A method that keeps the image has the noise of s1 and s2, and none of s0.
            noise = truth.specular_noise[truth.mask][inside] * np.array([0.0, 1.0, 1.0])
            expected = Residuals.of(noise, largest).nmse()
            assert by_name[f"nmse_zenith_{name}"].noise == pytest.approx(expected, rel=1e-10)
    perfect = METRICS["zenith"](truth)(truth.stokes[truth.mask])
    skills = [v.value for v in perfect if v.metric.startswith("skill")]
    # What noise is subtracted from a perfect estimate lifts its skill above one, by the noise.
    defined = [value for value in skills if not math.isnan(value)]
    assert min(defined) > 1.0  # of none it raises
