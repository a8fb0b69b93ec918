"""Networks learn: they beat the guess, repeat, and go on where they were stopped.

A training that begins from a model keeps what the model knew, and tells where it came from.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from runs import one_line, run_malus

jax = pytest.importorskip("jax", reason="no jax; pip install jax optax onnx onnxruntime")

import onnx  # noqa: E402
import onnxruntime  # noqa: E402
from networks import brought_back, magnified  # noqa: E402
from trainings import QUICK, answers, rewritten, steps_on_two_devices  # noqa: E402

import malus  # noqa: E402
from malus.bench.learning import options, train, training  # noqa: E402
from malus.bench.learning.examples import (  # noqa: E402
    read_examples,
)
from malus.bench.learning.kept import KeptTraining  # noqa: E402
from malus.bench.learning.model_file import read_model  # noqa: E402
from malus.bench.learning.objective import sums  # noqa: E402
from malus.bench.learning.options import TrainingOptions  # noqa: E402
from malus.bench.learning.validation import measured  # noqa: E402
from malus.bench.running.progress import silent  # noqa: E402
from malus.bench.running.worker_process import WorkerProcess  # noqa: E402
from malus.scenes import InputError  # noqa: E402


def test_training_beats_the_guess(trained: Path, spheres: Path) -> None:
    facts = json.loads(trained.with_suffix(".json").read_text("utf-8"))
    assert facts["validation_skill"] > 0.05
    assert facts["test_skill"] > 0.0
    history = facts["history"]
    assert history[-1]["step"] == 150
    # The weights are those of the best row, but rounded: 5e-4 of each, and the skill follows.
    val = read_examples(malus.open_dataset(spheres), "val", 0, silent)
    kept = measured(read_model(trained).weights, val, "none").skill
    assert kept == pytest.approx(max(row["skill"] for row in history), abs=2e-3)
    assert trained.with_suffix(".svg").read_text("utf-8").startswith("<?xml")
    assert not trained.with_name("net.onnx.training").exists()


MAGNIFICATIONS = (1.0, 4 / 3, 2.0)


def as_run(
    session: onnxruntime.InferenceSession, picture: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Ratios and deviations of a picture (height, width, 3): the mean over it and its mirror image,
    at three sizes.
    """
    ratios, variances = [], []
    for magnification in MAGNIFICATIONS:
        seen = magnified(picture, magnification)
        beyond = [(0, -length % 16) for length in seen.shape[:2]]
        for step in (1, -1):
            shown = np.pad(seen[:, ::step], (*beyond, (0, 0)), mode="edge")
            found = np.concatenate(
                session.run(None, {"image": shown.transpose(2, 0, 1)[None]}), axis=1
            )[0]
            maps = found[:, : seen.shape[0], : seen.shape[1]][:, :, ::step].transpose(1, 2, 0)
            maps = brought_back(maps, picture.shape[:2])
            ratios.append(np.stack([maps[..., :3], step * maps[..., 3:6]], axis=-1))
            variances.append(np.square(maps[..., 6:]))
    return np.mean(ratios, axis=0), np.sqrt(np.mean(variances, axis=0))


def test_the_file_tells_its_recipe_and_does_what_it_says(trained: Path, spheres: Path) -> None:
    """Deviations are calibrated on `val` by one factor: their mean square there is 1."""
    session = onnxruntime.InferenceSession(trained)
    facts = json.loads(session.get_modelmeta().custom_metadata_map["malus"])
    recipe = facts["recipe"]
    assert facts["format"] == 1
    assert facts["resolution"] == 32
    assert facts["magnifications"] == list(MAGNIFICATIONS)
    assert facts["stride"] == 16
    assert recipe["dataset"]["splits"] == {"train": 29, "val": 8, "test": 3}
    assert recipe["options"]["steps"] == 150
    val = read_examples(malus.open_dataset(spheres), "val", 0, silent)
    found = []
    for light, mask in zip(val.light.astype(np.float32), val.mask, strict=True):
        answer = as_run(session, light[..., 0])
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


def test_what_no_such_training_wrote_is_not_replaced(
    trained: Path, spheres: Path, tmp_path: Path
) -> None:
    def begin(options: TrainingOptions, **told: Any) -> None:
        def stop(_done: int, _total: int, label: str) -> None:
            if label.startswith("steps"):
                raise KeyboardInterrupt

        malus.train(spheres, tmp_path / "net.onnx", options, stop, **told)

    for suffix in (".onnx", ".json", ".svg"):
        own = tmp_path / f"net{suffix}"
        own.write_text("mine", encoding="ascii")
        with pytest.raises(InputError, match="or that of a training, found"):
            begin(QUICK)
        assert own.read_text("ascii") == "mine"
        own.unlink()
    model = shutil.copy(trained, tmp_path / "net.onnx")
    with pytest.raises(InputError, match="found a model of other data or options"):
        malus.train(spheres, tmp_path / "net.onnx", replace(QUICK, steps=1))
    (tmp_path / "net.json").write_text('{"holiday": 1}', encoding="ascii")
    with pytest.raises(InputError, match="or that of a training, found"):
        begin(QUICK)
    (tmp_path / "net.json").write_text('{"recipe": "pancakes", "history": []}', encoding="ascii")
    with pytest.raises(InputError, match="or that of a training, found"):
        begin(QUICK)
    (tmp_path / "net.json").unlink()
    (tmp_path / "net.svg").write_text("mine", encoding="ascii")
    with pytest.raises(InputError, match="or that of a training, found"):
        begin(QUICK)
    shutil.copy(trained.with_suffix(".json"), tmp_path / "net.json")
    parent = rewritten(trained, tmp_path / "parent.onnx", 2.0)
    with pytest.raises(InputError, match="found a model of other data or options"):
        malus.train(spheres, tmp_path / "net.onnx", QUICK, begin_from=parent)
    with pytest.raises(KeyboardInterrupt):  # the same training anew
        begin(QUICK)
    with pytest.raises(KeyboardInterrupt):  # or this model, trained further
        begin(replace(QUICK, steps=1), begin_from=tmp_path / "net.onnx")
    assert Path(model).read_bytes() == trained.read_bytes()


def test_every_step_sees_other_examples(spheres: Path) -> None:
    train = read_examples(malus.open_dataset(spheres), "train", 0, silent)
    state = training.start(QUICK)
    errors = {
        float(training.take_step(train, replace(QUICK, seed=seed), state, number, 0.0, 0.0)[1])
        for seed, number in ((0, 0), (0, 1), (1, 0))
    }
    assert len(errors) == 3


def test_devices_share_a_step_and_their_gradients_count_alike() -> None:
    with WorkerProcess() as worker:
        two, one = worker.stream(steps_on_two_devices)
    devices, counts, keys = zip(*two[0], strict=True)
    assert counts == (QUICK.batch // 2,) * 4
    assert devices[0] != devices[1]
    assert len(set(keys)) == 4
    assert len({device for device, _, _ in one[0]}) == 1
    assert two[1] == one[1]


def test_the_rate_warms_up_and_ends_at_nothing() -> None:
    rates = [training._rates(step, 100, 1e-3)[0] for step in range(100)]
    assert rates[0] < max(rates) / 4
    assert rates[-1] < max(rates) / 1000
    assert [training._rates(step, 100, 1e-3)[1] for step in (0, 10**6)] == [0.1, 0.999]


def test_the_best_weights_are_the_running_mean_of_the_best_row(spheres: Path) -> None:
    data = [
        read_examples(malus.open_dataset(spheres), name, 0, silent) for name in ("train", "val")
    ]
    rows: list[training.Progressed] = []
    done = training.fit(*data, replace(QUICK, steps=20), silent, rows.append)
    skills = [row["skill"] for row in done.history]
    assert max(skills) > skills[0]
    best = rows[skills.index(max(skills)) - 1].state  # no step, no row that is kept
    for name, kept in done.best.items():
        np.testing.assert_array_equal(kept, best.average[name])
    assert any((best.average[name] != best.weights[name]).any() for name in done.best)


def test_a_split_of_nothing_but_noise_is_refused(
    spheres: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No weights would be better than others: the first, untrained, would be the best."""
    data = [
        read_examples(malus.open_dataset(spheres), name, 0, silent) for name in ("train", "val")
    ]
    drowned = data[1]._replace(noise=data[1].noise + 1e6)
    with pytest.raises(InputError, match="split val: expected scenes polarised beyond"):
        training.fit(data[0], drowned, QUICK, silent, lambda _: None)


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


def test_the_ablation_has_five_rows(spheres: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(train, "ABLATION", {"as it is": {}})
    done = run_malus(
        "train", str(spheres), "--ablate", "--steps", "2", "--batch", "8", "--width", "4", "--json"
    )
    rows = json.loads(done.stdout)
    assert [row["row"] for row in rows] == ["as it is", train.AS_RUN]
    assert all(np.isfinite([row["val"], row["test"]]).all() for row in rows)


def test_the_ablation_trains_no_network_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    trained = []

    def noted(_: object, __: object, options: TrainingOptions, *___: object) -> Any:
        trained.append(options)
        return training.Progressed(training.start(options), {}, 2, 2, [])

    monkeypatch.setattr(train, "fit", noted)
    monkeypatch.setattr(train, "read_data", lambda *_: train.Data(*[None] * 5))
    monkeypatch.setattr(train, "_compared", lambda row, *_: row)
    for given in ({}, {"prior": "lobes"}, {"turn_deg": 0.0}, {"turn_deg": 180.0}):
        trained.clear()
        # Seconds for the first, whose steps all others get: they are the same training even so.
        rows = list(train.ablation(Path(), replace(QUICK, steps=None, seconds=1, **given), silent))
        distinct = {(options.prior, options.turn_deg) for options in trained}
        assert len(trained) == len(distinct) == len(rows) - 1 == (3 if given else 4)
