"""Metrics of published projects against literal versions of their definitions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from made_up import truth_with
from reference import field_metrics

from malus.bench.scoring.extra_metrics import get_metrics
from malus.bench.scoring.metrics import peak
from malus.bench.scoring.profiles import PROFILES, _Pixels
from malus.scenes.core.arrays import FloatArray
from malus.scenes.core.errors import InputError

SIDE, BANDS = 16, 3
Frames = tuple[FloatArray, FloatArray, FloatArray]


def values_of(name: str, frames: Frames) -> dict[str, float]:
    """Values of a profile; the estimate is given to it as the mask's pixels."""
    estimate, truth, mask = frames
    (metric,) = get_metrics((f"profile:{name}",))
    return {row.metric: row.value for row in metric(truth_with(truth, mask))(estimate[mask])}


def random_frames(seed: int = 3) -> Frames:
    """Every angle, degrees up to 1, a mask with holes; black outside it."""
    rng = np.random.default_rng(seed)
    truth = rng.uniform(-0.6, 0.6, (SIDE, SIDE, BANDS, 3)) + np.array([0.9, 0, 0])
    estimate = truth + rng.uniform(-0.4, 0.4, truth.shape)
    mask = rng.random((SIDE, SIDE)) < 0.8
    return estimate * mask[..., None, None], truth * mask[..., None, None], mask


def constant(estimate: tuple[float, ...], truth: tuple[float, ...]) -> Frames:
    """Two uniform fields on a whole frame."""
    shape = (SIDE, SIDE, BANDS, 3)
    return np.full(shape, estimate), np.full(shape, truth), np.ones((SIDE, SIDE), bool)


def one_pixel() -> Frames:
    """A single pixel on black."""
    mask = np.zeros((SIDE, SIDE), bool)
    mask[7, 8] = True
    estimate, truth, _ = constant((1.0, 0.3, -0.1), (1.0, 0.2, 0.4))
    return estimate * mask[..., None, None], truth * mask[..., None, None], mask


def saturated() -> Frames:
    """Estimates far beyond the truth's range, of which half are impossible."""
    estimate, truth, mask = random_frames(5)
    estimate = np.array(estimate)
    estimate[::2, :, :, 1:] *= 30.0
    return estimate, truth, mask


def black() -> Frames:
    """A black body: no light, no polarisation."""
    return constant((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


CASES: dict[str, Callable[[], Frames]] = {
    "random": random_frames,
    "constant": lambda: constant((1.0, 0.1, 0.2), (1.0, 0.3, -0.1)),
    "one pixel": one_pixel,
    "black": black,
    "saturated": saturated,
    "no polarisation": lambda: constant((1.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    "across 180 degrees": lambda: turned(179.0, 1.0),
}


def turned(estimate_deg: float, truth_deg: float) -> Frames:
    """Half polarised fields at two angles."""
    fields = [
        (1.0, 0.5 * math.cos(math.radians(2 * a)), 0.5 * math.sin(math.radians(2 * a)))
        for a in (estimate_deg, truth_deg)
    ]
    return constant(*fields)


@pytest.mark.parametrize("case", CASES)
def test_polaranything_is_its_definition(case: str) -> None:
    """Every value but SSIM equals the literal one; float64 on both sides, so to rounding."""
    frames = CASES[case]()
    values = values_of("polaranything", frames)
    expected = field_metrics.polaranything(*frames)
    # An angle of 1e-15 instead of 0 is a squared error of 1e-30: beyond 250 dB is equal.
    assert {name: min(values[name], 250.0) for name in expected} == pytest.approx(
        {name: min(value, 250.0) for name, value in expected.items()}, rel=1e-9, abs=1e-9
    )


@pytest.mark.parametrize("case", CASES)
def test_rgb2pol_is_its_definition(case: str) -> None:
    """All values, and which of them exist."""
    estimate, truth, mask = CASES[case]()
    values = values_of("rgb2pol", (estimate, truth, mask))
    expected = field_metrics.rgb2pol(estimate, truth)
    # skimage computes variances in another order: 1e-7 where windows are nearly constant.
    assert values == pytest.approx(expected, rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("case", CASES)
def test_polarscale_is_its_definition(case: str) -> None:
    """All values, and that the angle has none where nothing is polarised."""
    estimate, truth, mask = CASES[case]()
    if case == "black":  # nothing to divide by: the definition has no value, ours no error
        assert values_of("polarscale", (estimate, truth, mask))["polarscale_psnr"] == math.inf
        return
    values = values_of("polarscale", (estimate, truth, mask))
    assert values == pytest.approx(field_metrics.polarscale(estimate, truth), rel=1e-9, abs=1e-9)


def test_ssim_of_the_encoding_is_that_of_its_map() -> None:
    """PolarAnything's SSIM: mean of the literal map over the channels, a mask of inner pixels."""
    rng = np.random.default_rng(1)
    mask = np.zeros((SIDE, SIDE), bool)
    mask[5:-5, 5:-5] = True  # where a window never leaves the picture
    truth, estimate = (
        (rng.uniform(-0.5, 0.5, (SIDE, SIDE, BANDS, 3)) + np.array([1.0, 0, 0]))
        * mask[..., None, None]
        for _ in range(2)
    )
    pictures = []
    for frame in (estimate, truth):
        s0, s1, s2 = np.moveaxis(frame.mean(axis=2), -1, 0)
        angle = np.arctan2(s2, s1)
        degree = np.clip(np.hypot(s1, s2) / np.where(s0 > 0, s0, 1.0), 0, 1)
        codes = np.stack([(np.sin(angle) + 1) / 2, (np.cos(angle) + 1) / 2, degree], axis=-1)
        pictures.append(codes * mask[..., None])
    expected = np.mean(
        [field_metrics.ssim_map(*(p[..., c] for p in pictures), 1.0) for c in range(3)]
    )
    values = values_of("polaranything", (estimate, truth, mask))
    assert values["polaranything_ssim"] == pytest.approx(expected, rel=1e-9)


def test_angles_of_179_and_1_degree_differ_by_two() -> None:
    """An orientation, not a direction."""
    for name in ("polaranything", "polarscale"):
        assert values_of(name, turned(179.0, 1.0))[f"{name}_aolp_deg"] == pytest.approx(2.0)


def test_a_perfect_prediction_has_an_infinite_psnr() -> None:
    """Not a large number."""
    _, truth, mask = random_frames()
    for name in ("polaranything", "rgb2pol", "polarscale"):
        values = values_of(name, (truth, truth, mask))
        ratios = [value for key, value in values.items() if "psnr" in key]
        assert ratios
        assert set(ratios) == {math.inf}


def test_the_noise_is_what_a_perfect_method_scores() -> None:
    """The truth plus one draw of its noise, scored like an estimate."""
    _, truth, mask = random_frames()
    draw = 0.01 * np.random.default_rng(0).normal(size=truth.shape)
    noisy = truth_with(truth, mask, noise=draw)
    for name, metric in PROFILES.items():
        rows = {row.metric: row for row in metric(noisy)((truth + draw)[mask])}
        assert rows
        for row in rows.values():
            assert row.noise == pytest.approx(row.value, rel=1e-6, abs=1e-12), name


@pytest.mark.parametrize("name", ["rgb2pol", "polarscale"])
def test_a_truth_with_s3_counts_it(name: str) -> None:
    """Methods say nothing of it, which is zero: the same as a literal estimate without it."""
    estimate, truth, mask = random_frames(7)
    s3 = 0.2 * np.random.default_rng(1).normal(size=mask.shape + (BANDS,)) * mask[..., None]
    described = replace(truth_with(truth, mask), s3=s3, s3_noise=np.zeros_like(s3))
    (metric,) = get_metrics((f"profile:{name}",))
    values = {row.metric: row.value for row in metric(described)(estimate[mask])}
    four = np.concatenate([truth, s3[..., None]], axis=-1)
    zero = np.concatenate([estimate, np.zeros_like(s3)[..., None]], axis=-1)
    assert values == pytest.approx(getattr(field_metrics, name)(zero, four), rel=1e-7, abs=1e-7)


def test_the_peak_of_a_dark_picture_is_one_as_for_every_other_metric() -> None:
    """Noise alone may be below zero everywhere: over such a peak light would change its sign."""
    dark = truth_with(*constant((-0.5, 0.1, 0.0), (-0.5, 0.0, 0.0))[1:])
    assert peak(dark) == 1.0
    assert _Pixels.of(dark).peak == 1.0


def test_small_pictures_are_refused() -> None:
    """A window of 11 pixels does not fit into 8."""
    frame = np.ones((8, 8, BANDS, 3))
    with pytest.raises(InputError, match="at least 11 pixels a side"):
        PROFILES["profile:rgb2pol"](
            truth_with(frame * np.linspace(0, 1, 8)[:, None, None, None], np.ones((8, 8), bool))
        )


def test_an_estimate_that_is_not_finite_has_no_value() -> None:
    """Not that of an unpolarised one; and it is impossible."""
    estimate, truth, mask = random_frames()
    broken = estimate.copy()
    broken[tuple(np.argwhere(mask)[0])] = np.nan
    for profile in PROFILES:
        name = profile.removeprefix("profile:")
        found = values_of(name, (broken, truth, mask))
        told = {"polarscale_impossible", "polarscale_aolp_pixels"}
        assert all(math.isnan(value) for key, value in found.items() if key not in told), found
    whole = values_of("polarscale", (estimate, truth, mask))["polarscale_impossible"]
    more = values_of("polarscale", (broken, truth, mask))["polarscale_impossible"]
    length = np.linalg.norm(estimate[tuple(np.argwhere(mask)[0])][:, 1:], axis=-1)
    were = int((length > estimate[tuple(np.argwhere(mask)[0])][:, 0]).sum())
    assert more - whole == pytest.approx((BANDS - were) / (SIDE * SIDE * BANDS))
