"""Networks learn: they beat the guess, repeat, go on where they were stopped, and become a file.

A training that begins from a model keeps what the model knew, and tells where it came from.
"""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up import made_up_truth
from runs import one_line, run_malus

jax = pytest.importorskip("jax", reason="no jax; pip install jax optax onnx onnxruntime")

import onnx  # noqa: E402
import onnxruntime  # noqa: E402

import malus  # noqa: E402
from malus.bench.datasets.render import render_dataset  # noqa: E402
from malus.bench.learning import examples as reading  # noqa: E402
from malus.bench.learning import network, options, train, training  # noqa: E402
from malus.bench.learning.examples import (  # noqa: E402
    averaged,
    averaged_errors,
    noise_power,
    normalised,
    read_examples,
)
from malus.bench.learning.kept import KeptTraining  # noqa: E402
from malus.bench.learning.model_file import read_model, write_model  # noqa: E402
from malus.bench.learning.network import Architecture  # noqa: E402
from malus.bench.learning.objective import sums  # noqa: E402
from malus.bench.learning.options import TrainingOptions  # noqa: E402
from malus.bench.learning.validation import measured  # noqa: E402
from malus.bench.running.progress import silent  # noqa: E402
from malus.renderers.variant import Variant  # noqa: E402
from malus.scenes import InputError, Suite  # noqa: E402
from malus.scenes.polarisation import PAPER_ANGLES_DEG, polarised  # noqa: E402

CONTENT: dict[str, Any] = {
    "name": "drawn",
    "description": "Spheres at random",
    "wavelengths_nm": [450, 550, 650],
    "methods": ["unpolarised"],
    "renderer": "torrance-sparrow",
    "camera": {"resolution": 32},
    "random": {
        "count": 40,
        "seed": 1,
        "shapes": [{"kind": "sphere"}],
        "materials": [{"eta": {"uniform": [1.3, 1.8]}}],
        "surfaces": [{"alpha": {"uniform": [0.2, 0.4]}, "albedo": [0.05, 0.1, 0.2]}],
        "lights": [{"kind": "distant", "incidence_deg": {"uniform": [40, 80]}}],
    },
    "splits": {"train": 0.7, "val": 0.2, "test": 0.1, "disjoint": ["material", "light"]},
}
QUICK = TrainingOptions(steps=150, batch=8, width=4)
TINY = Architecture(width=4, prior="lobes")


@pytest.fixture(scope="module")
def spheres(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("spheres")
    render_dataset(Suite.parse(CONTENT, "test"), folder, Variant("none", "not used"))
    return folder


@pytest.fixture(scope="module")
def trained(spheres: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    model = tmp_path_factory.mktemp("trained") / "net.onnx"
    done = run_malus(
        "train", str(spheres), "--out", str(model), "--steps", "150", "--batch", "8", "--width", "4"
    )
    assert done.returncode == 0, done.stderr
    assert "median skill val" in done.stdout
    return model


def random_weights(architecture: Architecture, seed: int = 0) -> dict[str, Any]:
    """Weights of which none is zero: every part of the network has a say."""
    random = np.random.default_rng(seed)
    weights = network.initial_weights(seed, architecture)
    return {
        name: (w + random.normal(0, 0.03, w.shape)).astype(np.float32)
        for name, w in weights.items()
    }


def test_training_beats_the_guess(trained: Path) -> None:
    facts = json.loads(trained.with_suffix(".json").read_text("utf-8"))
    assert facts["validation_skill"] > 0.05
    assert facts["test_skill"] > 0.0
    history = facts["history"]
    assert history[-1]["step"] == 150
    # Weights are rounded, and the mean with the mirror image errs less than both on average.
    assert facts["validation_skill"] > max(row["skill"] for row in history) - 0.01
    assert trained.with_suffix(".svg").read_text("utf-8").startswith("<?xml")
    assert not trained.with_name("net.onnx.training").exists()


def both_ways(
    session: onnxruntime.InferenceSession, picture: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Ratios and deviations of a picture (height, width, 3), averaged with its mirror image's."""
    shown = np.stack([picture, picture[:, ::-1]]).transpose(0, 3, 1, 2)
    answers = [session.run(None, {"image": one[None]}) for one in shown]
    stokes, deviation = (
        np.concatenate(a).transpose(0, 2, 3, 1) for a in zip(*answers, strict=True)
    )
    ratios = np.stack([stokes[..., :3], stokes[..., 3:]], axis=-1)
    ratios[1] = ratios[1, :, ::-1] * np.float32([1, -1])
    deviation[1] = deviation[1, :, ::-1].copy()
    return ratios.mean(axis=0), np.sqrt(np.square(deviation).mean(axis=0))


def test_the_file_tells_its_recipe_and_does_what_it_says(trained: Path, spheres: Path) -> None:
    """Deviations are calibrated on `val` by one factor: their mean square there is 1."""
    session = onnxruntime.InferenceSession(trained)
    facts = json.loads(session.get_modelmeta().custom_metadata_map["malus"])
    recipe = facts["recipe"]
    assert facts["format"] == 1
    assert facts["resolution"] == 32
    assert facts["stride"] == 16
    assert recipe["dataset"]["splits"] == {"train": 29, "val": 8, "test": 3}
    assert recipe["options"]["steps"] == 150
    val = read_examples(malus.open_dataset(spheres), "val", 0, silent)
    found = []
    for light, mask in zip(val.light.astype(np.float32), val.mask, strict=True):
        answer = both_ways(session, light[..., 0])
        found.append([float(one) for one in sums(light, mask, *answer)])
    error, guess, residual, visible = np.array(found).T
    # The file has four digits of the skill, and these truths, of formulas, no noise.
    assert np.median(1 - error / guess) == pytest.approx(facts["validation_skill"], abs=2e-4)
    assert np.mean(residual / visible) == pytest.approx(1.0, rel=1e-3)


def test_the_same_seed_gives_the_same_weights_also_after_a_stop(
    trained: Path, spheres: Path, tmp_path: Path
) -> None:
    model = tmp_path / "again.onnx"
    stopped: list[int] = []

    def stop(done: int, total: int, label: str) -> None:
        if label.startswith("steps") and done >= 60 and not stopped:
            stopped.append(done)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        malus.train(spheres, model, QUICK, stop)
    assert not model.exists()
    assert (tmp_path / "again.onnx.training" / "state.npz").exists()
    other = TrainingOptions(steps=150, batch=8, width=4, seed=1)
    with pytest.raises(InputError, match="the data, options, versions and device of"):
        malus.train(spheres, model, other)
    first: list[int] = []
    malus.train(spheres, model, QUICK, lambda done, _total, label: first.append(done))
    assert 0 < min(d for d in first[-20:] if d) <= 60
    one, two = (onnx.load(path).graph.initializer for path in (trained, model))
    assert all(a.raw_data == b.raw_data for a, b in zip(one, two, strict=True))


@pytest.mark.parametrize("prior", ["none", "lobes"])
def test_the_file_agrees_with_the_network(prior: str, tmp_path: Path) -> None:
    architecture = Architecture(width=4, prior=prior)
    weights = network.rounded(random_weights(architecture))
    write_model(tmp_path / "net.onnx", weights, architecture, 1.5, {"format": 1})
    picture = np.random.default_rng(0).uniform(0, 3, (1, 48, 64, 3)).astype(np.float32)
    expected, deviations = network.forward(weights, picture, prior)
    session = onnxruntime.InferenceSession(tmp_path / "net.onnx")
    stokes, deviation = session.run(None, {"image": picture.transpose(0, 3, 1, 2)})
    # Single precision through 30 convolutions of up to 360 products, in another order.
    np.testing.assert_allclose(stokes[0, :3], np.moveaxis(expected[0, ..., 0], -1, 0), atol=1e-4)
    np.testing.assert_allclose(stokes[0, 3:], np.moveaxis(expected[0, ..., 1], -1, 0), atol=1e-4)
    np.testing.assert_allclose(
        deviation[0], 1.5 * np.moveaxis(deviations[0], -1, 0), rtol=1e-3, atol=1e-4
    )
    assert np.hypot(stokes[0, :3], stokes[0, 3:]).max() <= 1.0
    assert deviation.min() > 0


def answers(model: Path) -> list[np.ndarray]:
    """What a model says of one picture: `stokes` and `deviation`."""
    picture = np.random.default_rng(2).uniform(0, 3, (1, 3, 32, 32)).astype(np.float32)
    return onnxruntime.InferenceSession(model).run(None, {"image": picture})


def rewritten(model: Path, other: Path, factor: float, **options: object) -> Path:
    """The same network with its deviations times a factor, and another story of its options."""
    read, facts = read_model(model), json.loads(model.with_suffix(".json").read_text("utf-8"))
    del facts["history"]
    facts["calibration"] *= factor
    facts["recipe"]["options"] |= options
    write_model(other, read.weights, read.architecture, facts["calibration"], facts)
    return other


@pytest.mark.parametrize("prior", ["none", "lobes"])
def test_a_model_is_read_back_as_it_was_written(prior: str, tmp_path: Path) -> None:
    architecture, path = Architecture(width=8, prior=prior), tmp_path / "net.onnx"
    weights = network.rounded(random_weights(architecture))
    recipe = {"options": architecture._asdict()}
    write_model(path, weights, architecture, 1.5, {"recipe": recipe, "calibration": 1.5})
    read = read_model(path)
    assert read.architecture == architecture
    assert read.recipe == recipe
    assert read.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert read.weights.keys() == weights.keys()
    assert all(np.array_equal(read.weights[name], w) for name, w in weights.items())


def test_a_training_of_no_rate_is_the_model_it_began_from(
    trained: Path, spheres: Path, tmp_path: Path
) -> None:
    """The factor on the deviations is undone and fitted anew: a wrong one has no influence."""
    wrong = rewritten(trained, tmp_path / "wrong.onnx", 3.0)
    np.testing.assert_allclose(answers(wrong)[1], 3 * answers(trained)[1], rtol=1e-5)  # single
    still = replace(QUICK, steps=1, rate=0.0)
    done = malus.train(spheres, tmp_path / "net.onnx", still, begin_from=wrong)
    for one, two in zip(answers(trained), answers(done.model), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-5)  # the same numbers but for the last bit
    before = json.loads(trained.with_suffix(".json").read_text("utf-8"))
    assert done.facts["calibration"] == pytest.approx(before["calibration"], rel=1e-5)
    assert [row["step"] for row in done.history] == [0, 1]
    assert done.facts["validation_skill"] == pytest.approx(before["validation_skill"], abs=1e-4)
    assert done.facts["recipe"]["from"] == {
        "sha256": hashlib.sha256(wrong.read_bytes()).hexdigest(),
        "recipe": before["recipe"],
    }
    assert "from" not in before["recipe"]


def test_a_training_that_only_makes_worse_keeps_its_model(
    trained: Path, spheres: Path, tmp_path: Path
) -> None:
    ruinous = TrainingOptions(steps=4, batch=8, width=4, rate=1.0)
    done = malus.train(spheres, tmp_path / "net.onnx", ruinous, begin_from=trained)
    assert max(row["skill"] for row in done.history[1:]) < done.history[0]["skill"]
    np.testing.assert_allclose(answers(done.model)[0], answers(trained)[0], rtol=1e-5)


def test_going_on_needs_the_same_model_and_versions(
    trained: Path, spheres: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, other = tmp_path / "net.onnx", rewritten(trained, tmp_path / "other.onnx", 2.0)

    def stop(done: int, _total: int, label: str) -> None:
        if label.startswith("steps") and done:
            raise KeyboardInterrupt

    # Validated and kept at every step.
    options = replace(QUICK, steps=training.VALIDATIONS)
    with pytest.raises(KeyboardInterrupt):
        malus.train(spheres, model, options, stop, begin_from=trained)
    for parent in (None, other):
        with pytest.raises(InputError, match="the data, options, versions and device of"):
            malus.train(spheres, model, options, begin_from=parent)
    with pytest.raises(InputError, match="the data, options, versions and device of"):
        malus.train(spheres, model, replace(options, rate=1e-4), begin_from=trained)
    with monkeypatch.context() as changed:
        changed.setattr(train, "versions", lambda *names: dict.fromkeys(names, "0"))
        with pytest.raises(InputError, match="the data, options, versions and device of"):
            malus.train(spheres, model, options, begin_from=trained)
    assert malus.train(spheres, model, options, begin_from=trained).history[0]["step"] == 0


def test_what_is_no_model_of_this_network_is_refused(
    trained: Path, spheres: Path, tmp_path: Path
) -> None:
    wide = run_malus("train", str(spheres), "--from", str(trained), "--width", "8")
    assert wide.returncode == 2
    assert "--width: expected 4, as the model to begin from has, found 8" in one_line(wide.stderr)
    both = run_malus("train", str(spheres), "--from", str(trained), "--ablate")
    assert "--from, --ablate: expected one of them" in one_line(both.stderr)
    text = run_malus("train", str(spheres), "--from", str(trained.with_suffix(".json")))
    assert text.returncode == 2
    assert "net.json: expected a model of malus train" in one_line(text.stderr)
    with pytest.raises(InputError, match="prior: expected none, as the model"):
        malus.train(spheres, "net.onnx", replace(QUICK, prior="lobes"), begin_from=trained)
    bare = onnx.load(trained)
    del bare.metadata_props[:]
    onnx.save(bare, tmp_path / "bare.onnx")
    moved = onnx.load(trained)
    moved.graph.node[-1].input[1] = "c0"
    onnx.save(moved, tmp_path / "moved.onnx")
    rewritten(trained, tmp_path / "told.onnx", 1.0, width=8)
    for name in ("bare", "moved", "told", "missing"):
        with pytest.raises(InputError, match=f"{name}.onnx: expected a model of malus train"):
            read_model(tmp_path / f"{name}.onnx")


def test_the_default_network_is_small_enough() -> None:
    weights = network.initial_weights(0, Architecture(16, "none"))
    assert 2 * sum(w.size for w in weights.values()) < 3.9e6  # bytes; the file has at most 4 MB


def test_ratios_stay_within_all_light() -> None:
    raw = np.full((1, 1, 1, 9), 1e6, np.float32)
    ratios, deviations = network._answers(raw)
    assert float(np.linalg.norm(ratios, axis=-1).max()) <= 1.0
    assert np.isfinite(deviations).all()


def reached(place: int, side: int) -> np.ndarray:
    """Pixels of a line that a change at `place` reaches through the network, by brute force."""

    def convolved(line: np.ndarray) -> np.ndarray:
        return line | np.append(line[1:], False) | np.insert(line[:-1], 0, False)

    def blocks(line: np.ndarray, count: int) -> np.ndarray:
        for _ in range(2 * count):
            line = convolved(line)
        return line

    line = convolved(np.arange(side) == place)
    lines = [line]
    for count in (1, 1, 1, 2):
        line = blocks(convolved(line)[::2], count)
        lines.append(line)
    for finer in lines[-2::-1]:
        line = blocks(finer | np.repeat(line, 2), 1)
    return line


def test_nothing_farther_than_the_radius_has_an_influence() -> None:
    reach = network.radius(TINY)
    side = 16 * ((2 * reach + 48) // 16)
    farthest = [
        np.abs(np.nonzero(reached(place, side))[0] - place).max()
        for place in range(side // 2 - 8, side // 2 + 8)
    ]
    assert max(farthest) == reach
    weights = random_weights(TINY)
    picture = np.random.default_rng(1).uniform(0.5, 1.5, (1, side, side, 3)).astype(np.float32)
    changed = picture.copy()
    place = side // 2
    changed[0, place, place] *= 30.0
    one, two = (np.asarray(network.forward(weights, p, "lobes")[0]) for p in (picture, changed))
    rows, columns = np.nonzero((np.abs(one - two) > 1e-6).any(axis=(-1, -2))[0])  # rounding
    seen = max(np.abs(rows - place).max(), np.abs(columns - place).max())
    assert reach / 4 < seen <= reach


def test_every_step_sees_other_examples(spheres: Path) -> None:
    train = read_examples(malus.open_dataset(spheres), "train", 0, silent)
    step = training._step_function(QUICK.batch, QUICK.prior, 32)
    state = training.start(QUICK)
    errors = {
        float(step(train.light, train.mask, jax.random.key(seed), 20.0, state, number, 0.0, 0.0)[1])
        for seed, number in ((0, 0), (0, 1), (1, 0))
    }
    assert len(errors) == 3


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


def test_the_rate_warms_up_and_ends_at_nothing() -> None:
    rates = [training._rates(step, 100, 1e-3)[0] for step in range(100)]
    assert rates[0] < max(rates) / 4
    assert rates[-1] < max(rates) / 1000
    assert [training._rates(step, 100, 1e-3)[1] for step in (0, 10**6)] == [0.1, 0.999]


def test_time_buys_steps(spheres: Path) -> None:
    data = [
        read_examples(malus.open_dataset(spheres), name, 0, silent) for name in ("train", "val")
    ]
    asked = TrainingOptions(seconds=1e-3, batch=8, width=4)
    done = training.fit(*data, asked, silent, lambda _: None)
    assert done.steps == done.step == training.VALIDATIONS  # the least


def test_a_state_that_was_cut_is_told(tmp_path: Path) -> None:
    kept = KeptTraining(tmp_path / "net.onnx", {}, 0.0)
    assert kept.read(training.start(QUICK)) is None
    kept.folder.mkdir()
    (kept.folder / "state.npz").write_bytes(b"PK")
    with pytest.raises(InputError, match="the state of a training"):
        kept.read(training.start(QUICK))


def test_the_time_of_a_training_is_that_of_all_its_sessions(tmp_path: Path) -> None:
    state = training.start(QUICK)
    first = KeptTraining(tmp_path / "net.onnx", {}, time.monotonic() - 1000)
    first.write(training.Progressed(state, state.average, 1, 2, []))
    second = KeptTraining(tmp_path / "net.onnx", {}, time.monotonic() - 500)
    assert second.read(state) is not None
    assert second.seconds == pytest.approx(1500, abs=100)  # and what this test takes


def test_bad_input_ends_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = run_malus("train", str(tmp_path))
    assert missing.returncode == 2
    assert "dataset.json" in one_line(missing.stderr)
    both = run_malus("train", str(tmp_path), "--seconds", "3", "--steps", "2")
    assert both.returncode == 2
    assert "--seconds, --steps: expected one of them" in one_line(both.stderr)
    other = run_malus("train", str(tmp_path), "--out", str(tmp_path / "net.json"))
    assert "--out: expected the name of a file that ends in .onnx" in one_line(other.stderr)
    (tmp_path / "file").touch()
    nowhere = run_malus("train", str(tmp_path), "--out", str(tmp_path / "file" / "x" / "net.onnx"))
    assert nowhere.returncode == 2
    assert "--out: expected a folder that can be written, found Not a dir" in one_line(
        nowhere.stderr
    )
    in_vain = run_malus("train", str(tmp_path), "--out", "z.onnx", "--ablate")
    assert in_vain.returncode == 2
    assert "--out, --ablate: expected one of them" in one_line(in_vain.stderr)
    fast = run_malus("train", str(tmp_path), "--rate", "2")
    assert "--rate: expected a number from 0 to 1" in one_line(fast.stderr)
    turned = run_malus("train", str(tmp_path), "--turn", "200")
    assert "--turn: expected degrees from 0 to 180" in one_line(turned.stderr)
    monkeypatch.setattr(options, "PACKAGES", ("jax", "no_such_package"))
    lacking = run_malus("train", str(tmp_path))
    assert lacking.returncode == 2
    assert 'pip install "malus[learn]"' in one_line(lacking.stderr)


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


def test_the_ablation_has_five_rows(spheres: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(train, "ABLATION", {"as it is": {}})
    done = run_malus(
        "train", str(spheres), "--ablate", "--steps", "2", "--batch", "8", "--width", "4", "--json"
    )
    rows = json.loads(done.stdout)
    assert [row["row"] for row in rows] == ["as it is", "mean with its mirror image"]
    assert all(np.isfinite([row["val"], row["test"]]).all() for row in rows)


def test_the_mean_with_the_mirror_image_is_a_mirror_image(spheres: Path) -> None:
    """Mirrored pictures, with s2 mirrored, have the same skill: exactly as good, to rounding."""
    val = read_examples(malus.open_dataset(spheres), "val", 0, silent)
    other = val._replace(
        light=val.light[:, :, ::-1] * np.float16([1, 1, -1]), mask=val.mask[:, :, ::-1]
    )
    weights = random_weights(Architecture(4, "none"))
    one, two = (measured(weights, part, "none", mirrored=True) for part in (val, other))
    assert one.skill == pytest.approx(two.skill, rel=1e-3)
    assert measured(weights, val, "none").skill != pytest.approx(one.skill, rel=1e-2)
