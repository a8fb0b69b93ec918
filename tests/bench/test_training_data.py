"""What networks learn from, and the skill that decides between them: read, averaged, corrected."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_up import made_up_truth

jax = pytest.importorskip("jax", reason="no jax; pip install jax optax onnx onnxruntime")

from trainings import CONTENT, QUICK, random_weights  # noqa: E402

import malus  # noqa: E402
from malus.bench.datasets.render import render_dataset  # noqa: E402
from malus.bench.learning import examples as reading  # noqa: E402
from malus.bench.learning.examples import (  # noqa: E402
    averaged,
    averaged_errors,
    noise_power,
    normalised,
    read_examples,
)
from malus.bench.learning.model_file import read_model  # noqa: E402
from malus.bench.learning.network import Architecture  # noqa: E402
from malus.bench.learning.objective import sums  # noqa: E402
from malus.bench.learning.validation import measured  # noqa: E402
from malus.bench.running.progress import silent  # noqa: E402
from malus.renderers.variant import Variant  # noqa: E402
from malus.scenes import InputError, Suite  # noqa: E402
from malus.scenes.polarisation import PAPER_ANGLES_DEG, polarised  # noqa: E402


def test_skill_is_that_of_the_five_angles() -> None:
    """By brute force: pictures behind a polariser, true, estimated and unpolarised."""
    truth = made_up_truth(seed=3)
    light = truth.stokes / truth.image[truth.mask].mean()
    random = np.random.default_rng(0)
    ratios = random.uniform(-0.5, 0.5, (*truth.image.shape, 2)).astype(np.float32)
    estimate = light.copy()
    estimate[..., 1:] = ratios * light[..., :1]
    trivial = light * np.float32([1.0, 0.0, 0.0])

    def squares(other: np.ndarray) -> float:
        pictures = [polarised(light, a) - polarised(other, a) for a in PAPER_ANGLES_DEG]
        return float(np.square(np.array(pictures)[:, truth.mask], dtype=np.float64).sum())

    deviations = np.full(truth.image.shape, 0.2, np.float32)
    found = sums(light, truth.mask, ratios, deviations)
    expected = 1 - squares(estimate) / squares(trivial)
    assert 1 - float(found.error / found.guess) == pytest.approx(expected, rel=1e-4)  # single
    true = light[truth.mask][..., 1:] / light[truth.mask][..., :1]
    lit = light[truth.mask][..., 0] ** 2 > 1e-3
    residual = ((true - ratios[truth.mask]) / 0.2)[lit]
    assert float(found.residual) == pytest.approx(float((residual**2).sum()), rel=1e-4)
    assert int(found.visible) == residual.size


def test_noise_has_the_power_by_which_two_renders_differ() -> None:
    scene = malus.Scene(
        shape=malus.Sphere(),
        surface=malus.Dielectric(eta=1.5, alpha=0.4, albedo=0.3),
        light=malus.Uniform(),
        camera=malus.Camera(resolution=48),
    )
    one, two = (malus.render(scene, malus.Sampling(samples=16, seed=seed)) for seed in (1, 2))
    mask = one.mask & two.mask
    halved = (one.stokes - two.stokes)[..., 1:] / np.sqrt(2)
    pictures = [halved @ [np.cos(2 * a), np.sin(2 * a)] / 2 for a in np.radians(PAPER_ANGLES_DEG)]
    measured_power = float(np.square(np.array(pictures)[:, mask]).sum(axis=(1, 2)).mean())
    # 1,300 pixels of two components: 4 %; three standard deviations.
    assert noise_power(one.standard_error, mask) == pytest.approx(measured_power, rel=0.12)


def test_noise_in_the_truth_changes_no_skill(spheres: Path, trained: Path) -> None:
    val = read_examples(malus.open_dataset(spheres), "val", 0, silent)
    random = np.random.default_rng(4)
    signal = np.sqrt(np.square(val.light[val.mask][..., 1:].astype(np.float64)).mean())
    errors = np.zeros((*val.light.shape[1:4], 3)) + [0.0, signal, signal / 2]
    noise = random.normal(size=val.light.shape) * errors * val.mask[..., None, None]
    noisy = val._replace(
        light=(val.light + noise).astype(np.float16),
        noise=np.array([noise_power(errors, mask) for mask in val.mask]),
    )
    weights = read_model(trained).weights
    clean, found = (measured(weights, part, "none") for part in (val, noisy))
    assert clean.skill > 0.3
    # As much noise as signal, in 1000 numbers a scene: its power is known to 5 %.
    assert found.skill == pytest.approx(clean.skill, abs=0.15)
    forgotten = measured(weights, noisy._replace(noise=np.zeros(len(noise))), "none")
    assert forgotten.skill < clean.skill - 0.15


def test_red_comes_first_and_the_mean_is_one(spheres: Path) -> None:
    dataset = malus.open_dataset(spheres)
    val = read_examples(dataset, "val", 0, silent)
    sample = dataset.samples("val", maps=("stokes", "mask"))[2]
    assert sample["stokes"][..., 2, 0].sum() > 1.2 * sample["stokes"][..., 0, 0].sum()
    expected = sample["stokes"][:, :, ::-1]  # 650 nm first
    expected = expected / expected[sample["mask"]][..., 0].mean()
    np.testing.assert_array_equal(val.mask[2], sample["mask"])
    np.testing.assert_allclose(val.light[2], expected, rtol=1e-3, atol=1e-6)  # half precision


def test_processes_read_what_one_reads(spheres: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = malus.open_dataset(spheres)
    alone = read_examples(dataset, "train", 0, silent)
    monkeypatch.setattr(reading, "ALONE", 0)
    monkeypatch.setattr(reading, "_WORKERS", 2)
    together = read_examples(dataset, "train", 0, silent)
    np.testing.assert_array_equal(alone.light, together.light)
    np.testing.assert_array_equal(alone.mask, together.mask)


def test_smaller_pictures_are_means_of_pixels(spheres: Path) -> None:
    dataset = malus.open_dataset(spheres)
    whole, half = (read_examples(dataset, "val", 0, silent, side) for side in (None, 16))
    blocks = whole.light.astype(np.float64).reshape(8, 16, 2, 16, 2, 3, 3).mean(axis=(2, 4))
    mask = whole.mask.reshape(8, 16, 2, 16, 2).all(axis=(2, 4))
    np.testing.assert_array_equal(half.mask, mask)
    assert mask.any()
    for found, expected, valid in zip(half.light, blocks, mask, strict=True):
        expected = expected / expected[valid][..., 0].mean()
        np.testing.assert_allclose(found, expected, rtol=3e-3, atol=1e-6)  # half precision, twice
    with pytest.raises(malus.InputError, match=r"side: expected a divisor .* 32 × 32"):
        read_examples(dataset, "val", 0, silent, 20)


def test_means_of_pixels_vary_by_their_stated_error() -> None:
    errors = np.random.default_rng(1).uniform(0, 0.3, (8, 8, 3, 3))
    draws = errors * np.random.default_rng(2).normal(size=(4000, 8, 8, 3, 3))
    found = np.std([averaged(draw, 2) for draw in draws], axis=0)
    np.testing.assert_allclose(averaged_errors(errors, 2), found, rtol=0.06)  # 5 of 1/√8000


def test_memory_is_bounded(spheres: Path) -> None:
    few = read_examples(malus.open_dataset(spheres), "train", 0, silent, memory=19 * 32 * 32 * 5)
    assert few.light.shape == (5, 32, 32, 3, 3)


def test_light_beyond_half_precision_keeps_its_polarisation() -> None:
    stokes = np.zeros((400, 400, 3, 3), np.float32)
    stokes[0, 0] = [1.0, 0.5, -0.25]
    light = normalised(stokes, np.ones((400, 400), bool))
    assert np.isfinite(light).all()
    np.testing.assert_allclose(light[0, 0, 0] / light[0, 0, 0, 0], [1.0, 0.5, -0.25], rtol=1e-3)
    dark = normalised(np.full((2, 2, 3, 3), np.nan, np.float32), np.ones((2, 2), bool))
    assert not dark.any()


def test_datasets_that_cannot_be_trained_on_are_refused(tmp_path: Path) -> None:
    few = {"camera": {"resolution": 8}, "random": CONTENT["random"] | {"count": 10}}
    grey = {"surfaces": [{"alpha": 0.3, "albedo": 0.1}]}
    content = CONTENT | few | {"wavelengths_nm": [550], "random": few["random"] | grey}
    one_band = Suite.parse(content, "test")
    render_dataset(one_band, tmp_path / "one", Variant("none", "not used"))
    with pytest.raises(InputError, match="pictures of three bands"):
        malus.train(tmp_path / "one", tmp_path / "net.onnx", QUICK)
    render_dataset(Suite.parse(CONTENT | few, "test"), tmp_path / "tiny", Variant("none", "no"))
    with pytest.raises(InputError, match="at least 16 pixels a side, found 8 × 8"):
        malus.train(tmp_path / "tiny", tmp_path / "net.onnx", QUICK)
    whole = Suite.parse({k: v for k, v in (CONTENT | few).items() if k != "splits"}, "test")
    render_dataset(whole, tmp_path / "whole", Variant("none", "not used"))
    with pytest.raises(InputError, match="splits train and val"):
        malus.train(tmp_path / "whole", tmp_path / "net.onnx", QUICK)


def test_the_mean_with_the_mirror_image_is_a_mirror_image(spheres: Path) -> None:
    """Mirrored pictures, with s2 mirrored, have the same skill: exactly as good, to rounding."""
    val = read_examples(malus.open_dataset(spheres), "val", 0, silent)
    other = val._replace(
        light=val.light[:, :, ::-1] * np.float16([1, 1, -1]), mask=val.mask[:, :, ::-1]
    )
    weights = random_weights(Architecture(4, "none"))
    one, two = (measured(weights, part, "none", as_run=True) for part in (val, other))
    assert one.skill == pytest.approx(two.skill, rel=1e-3)
    assert measured(weights, val, "none").skill != pytest.approx(one.skill, rel=1e-2)


@pytest.mark.parametrize("side", [None, 16])
def test_a_picture_of_another_size_is_named(tmp_path: Path, side: int | None) -> None:
    """Reduced ones ended in a traceback, and the advice was what had been done: one suite."""
    sizes = {"cameras": [{"resolution": 33}, {"resolution": 32}], "count": 12}
    content = CONTENT | {"random": CONTENT["random"] | sizes}
    scenes = render_dataset(Suite.parse(content, "test"), tmp_path / "two", Variant("none", "no"))
    assert scenes["rendered"] == 12
    dataset = malus.open_dataset(tmp_path / "two")
    assert dataset.scene(dataset.scenes[0]).shape == (32, 32)
    told = r"scene [0-9a-f]{16}: expected 32 × 32 pixels, .*, found 33 × 33; render all in one res"
    with pytest.raises(InputError, match=told):
        read_examples(dataset, "train", 0, silent, side)
