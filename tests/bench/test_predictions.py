"""Somebody else's images: scored like a method, checked like an enemy's."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from made_up import made_up_truth
from runs import check_predictions, formula_dataset

from malus.bench import read_results, run
from malus.bench.commands.score import score_command
from malus.bench.datasets.export import export
from malus.bench.datasets.score import score_dataset
from malus.reconstruct import get_method
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.datasets.spectral_exr import write_spectral
from malus.renderers.variant import Variant
from malus.scenes import InputError, Suite

NOBODY = Variant("scalar_spectral_polarized", "not used")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return formula_dataset(tmp_path_factory.mktemp("dataset"))


def quiet(done: int, total: int, label: str) -> None:
    del done, total, label


def imperfect(stokes: np.ndarray) -> np.ndarray:
    """A prediction with nine tenths of the polarisation."""
    return stokes * [1.0, 0.9, 0.9]


def as_stokes(folder: Path, scene: str, stokes: np.ndarray) -> None:
    np.savez_compressed(folder / f"{scene}.npz", stokes=stokes)


def as_extremes(folder: Path, scene: str, stokes: np.ndarray) -> None:
    """Written from physics.md: ψ counts from the vertical."""
    amplitude = np.hypot(stokes[..., 1], stokes[..., 2])
    i_max, i_min = (stokes[..., 0] + amplitude) / 2, (stokes[..., 0] - amplitude) / 2
    from_horizontal = 0.5 * np.arctan2(stokes[..., 2], stokes[..., 1])
    phase = from_horizontal - np.pi / 2
    np.savez(folder / f"{scene}.npz", i_max=i_max, i_min=i_min, phase=phase)


def as_angles(folder: Path, scene: str, stokes: np.ndarray) -> None:
    (folder / scene).mkdir()
    for degrees in (0, 30, 60.5, 135):
        double = 2 * np.radians(degrees)
        seen = stokes[..., 0] - stokes[..., 1] * np.cos(double) - stokes[..., 2] * np.sin(double)
        np.save(folder / scene / f"{degrees}.npy", 0.5 * seen)


def as_exr(folder: Path, scene: str, stokes: np.ndarray) -> None:
    write_spectral(folder / f"{scene}.exr", stokes, (450.0, 550.0, 650.0))


def predict(
    dataset: Dataset,
    folder: Path,
    write: Callable[[Path, str, np.ndarray], None] = as_stokes,
    change: Callable[[np.ndarray], np.ndarray] = imperfect,
) -> Path:
    for truth in dataset.truths():
        write(folder, truth.scene.id, change(truth.stokes))
    return folder


@pytest.mark.parametrize("write", [as_stokes, as_extremes, as_angles, as_exr])
def test_every_form_of_a_prediction_scores_the_same(
    dataset: Dataset, tmp_path: Path, write: Callable[[Path, str, np.ndarray], None]
) -> None:
    predictions, problems = check_predictions(dataset, predict(dataset, tmp_path, write), quiet)
    assert not problems
    results = score_dataset(dataset, [], predictions, "mine")
    skill = results.headlines[results.headlines.metric == "skill"].value
    # A tenth of the polarisation is missing: 1 − 0.1²; float32 files round to 1e-7.
    np.testing.assert_allclose(skill, 0.99, atol=1e-5)
    assert results.run["predictions"]["suspicions"] == []
    assert len(results.run["predictions"]["sha256"]) == 64


def test_methods_and_predictions_share_a_table(dataset: Dataset, tmp_path: Path) -> None:
    predictions, _ = check_predictions(dataset, predict(dataset, tmp_path), quiet)
    results = score_dataset(dataset, [get_method("half_vector")], predictions, "mine")
    nmse = results.headlines[results.headlines.metric == "nmse"]
    assert set(nmse.method) == {"half_vector", "mine"}
    assert set(nmse.scene) == set(dataset.scenes)
    exact = nmse[nmse.method == "half_vector"].value
    assert exact.max() < 1e-20  # the method is the model of this renderer


def test_the_hash_is_of_the_contents(dataset: Dataset, tmp_path: Path) -> None:
    predictions, _ = check_predictions(dataset, predict(dataset, tmp_path, as_angles), quiet)
    before = predictions.sha256()
    assert before == predictions.sha256()
    path = next(tmp_path.rglob("30.npy"))
    np.save(path, np.load(path) * 1.5)
    assert predictions.sha256() != before


@pytest.mark.parametrize(
    ("signs", "says"),
    [((1, -1, -1), "turned by 90°"), ((1, 1, -1), "s2 negated"), ((1, -1, 1), "s1 negated")],
)
def test_a_swapped_convention_is_suspected(
    dataset: Dataset, tmp_path: Path, signs: tuple[int, ...], says: str
) -> None:
    folder = predict(dataset, tmp_path, change=lambda stokes: imperfect(stokes) * signs)
    predictions, problems = check_predictions(dataset, folder, quiet)
    assert not problems
    (suspicion,) = score_dataset(dataset, [], predictions).run["predictions"]["suspicions"]
    assert says in suspicion


def test_a_wrong_scale_is_suspected(dataset: Dataset, tmp_path: Path) -> None:
    folder = predict(dataset, tmp_path, change=lambda stokes: 255 * stokes)
    predictions, _ = check_predictions(dataset, folder, quiet)
    suspicions = score_dataset(dataset, [], predictions).run["predictions"]["suspicions"]
    assert any("255 times" in suspicion for suspicion in suspicions)


@pytest.mark.parametrize("name", ["unpolarised", "half_vector", "half_vector+body"])
def test_an_honest_method_is_not_suspected(dataset: Dataset, tmp_path: Path, name: str) -> None:
    from malus.bench.scoring.observe import observe

    method = get_method(name)
    for truth in dataset.truths():
        estimate = method.reconstruct(observe(truth, method.needs))
        as_stokes(tmp_path, truth.scene.id, estimate.stokes)
    predictions, _ = check_predictions(dataset, tmp_path, quiet)
    assert score_dataset(dataset, [], predictions).run["predictions"]["suspicions"] == []


def test_arrays_in_either_order_are_the_same(dataset: Dataset, tmp_path: Path) -> None:
    folder = predict(dataset, tmp_path, change=np.asfortranarray)
    predictions, problems = check_predictions(dataset, folder, quiet)
    assert not problems
    for truth in dataset.truths():
        found = predictions.stokes(dataset.scene(truth.scene.id))
        np.testing.assert_array_equal(found, truth.stokes)


def test_noise_of_the_picture_is_not_counted_as_noise_of_a_prediction(tmp_path: Path) -> None:
    """Where only s0 is noisy, an estimate that follows the picture has no noise at all."""
    truth = made_up_truth()
    noise = truth.specular_noise * np.float32([1, 0, 0])
    truth = dataclasses.replace(truth, specular_noise=noise, diffuse_noise=noise)
    with DatasetWriter(tmp_path / "dataset") as writer:
        writer.add(truth)
    dataset = open_folder(tmp_path / "dataset")
    as_stokes(tmp_path, truth.scene.id, imperfect(truth.stokes))
    predictions, _ = check_predictions(dataset, tmp_path, quiet)
    table = score_dataset(dataset, [], predictions).headlines
    row = table[table.metric == "nmse"].iloc[0]
    assert row.value > 0
    # What single precision leaves of s0 + noise - s0.
    assert row.noise < 1e-12


# --- problems ---


def one_of(**arrays: object) -> Callable[[Path], None]:
    return lambda path: np.savez(path, **arrays)


GOOD = np.ones((14, 14, 3))
NOT_FINITE = np.full((14, 14, 3, 3), np.nan)


def text(path: Path) -> None:
    path.write_text("hello", "utf-8")


def linked(path: Path) -> None:
    path.symlink_to("/etc/passwd")


def bomb(path: Path) -> None:
    """A header that says little, and a member that inflates to much."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("stokes.npy", bytes(1 << 26))


def lying_header(path: Path) -> None:
    header = np.lib.format.magic(1, 0) + (118).to_bytes(2, "little")
    words = "{'descr': '<f8', 'fortran_order': False, 'shape': (999999999, 999999999), }"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("stokes.npy", header + words.ljust(117).encode() + b"\n")


def pickled(path: Path) -> None:
    np.savez(path, stokes=np.array([{"a": 1}], dtype=object))


@pytest.mark.parametrize(
    ("write", "says"),
    [
        (Path.touch, "npz"),
        (text, "npz"),
        (linked, "link"),
        (os.mkfifo, "regular file"),
        (bomb, "array stokes"),
        (lying_header, "999999999"),
        (pickled, "float32 or float64"),
        (one_of(stokes=GOOD), "(14, 14, 3, 3)"),
        (one_of(stokes=np.ones((14, 14, 3, 3), int)), "float32 or float64"),
        (one_of(stokes=NOT_FINITE), "1764 that are not"),
        (one_of(i_max=GOOD, i_min=GOOD), "i_max, i_min and phase"),
        (one_of(i_max=GOOD, i_min=GOOD, phase=30 * GOOD), "radians"),
        (one_of(i_max=GOOD, i_min=GOOD[1:], phase=GOOD), "array i_min"),
        (Path.mkdir, "three different polariser angles"),
    ],
)
def test_a_bad_prediction_is_named(
    dataset: Dataset, tmp_path: Path, write: Callable[[Path], None], says: str
) -> None:
    predict(dataset, tmp_path)
    scene = dataset.scenes[1]
    (tmp_path / f"{scene}.npz").unlink()
    write(tmp_path / (scene if write is Path.mkdir else f"{scene}.npz"))
    _, problems = check_predictions(dataset, tmp_path, quiet)
    assert len(problems) == 1
    assert says in str(problems[0])
    assert scene in problems[0].where


def test_a_folder_of_angles_elsewhere_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "mine").mkdir()
    predict(dataset, tmp_path / "elsewhere", as_angles)
    for scene in dataset.scenes:
        (tmp_path / "mine" / scene).symlink_to(tmp_path / "elsewhere" / scene)
    _, problems = check_predictions(dataset, tmp_path / "mine", quiet)
    assert [problem.found for problem in problems] == ["a link"] * len(dataset)


def test_every_problem_is_named_at_once(dataset: Dataset, tmp_path: Path) -> None:
    first, second, third, fourth = dataset.scenes
    wrong = GOOD[:5]
    np.savez(tmp_path / f"{first}.npz", i_max=wrong, i_min=np.nan * GOOD, phase=wrong)
    as_angles(tmp_path, second, np.ones((14, 14, 3, 3)))
    np.save(tmp_path / second / "ninety.npy", GOOD)
    as_stokes(tmp_path, third, np.ones((14, 14, 3, 3)))
    as_exr(tmp_path, third, np.ones((14, 14, 3, 3)))
    as_stokes(tmp_path, "0" * 16, GOOD)
    _, problems = check_predictions(dataset, tmp_path, quiet)
    told = "\n".join(map(str, problems))
    assert len(problems) == 7
    for says in ("i_max", "not", "phase", "ninety", "a second", "0" * 16, f"{fourth}.npz"):
        assert says in told


# --- the command line, and the worked example of the README ---


def malus(*arguments: object) -> subprocess.CompletedProcess[str]:
    script = "from malus.bench.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_example_of_the_readme(dataset: Dataset, tmp_path: Path) -> None:
    export(dataset, "numpy", tmp_path / "numpy")
    (tmp_path / "mine").mkdir()
    for path in (tmp_path / "numpy").glob("*/truth.npz"):
        image = np.load(path)["image"]
        guess = {"i_max": 0.6 * image, "i_min": 0.4 * image, "phase": np.zeros_like(image)}
        np.savez(tmp_path / "mine" / path.parent.name, **guess)
    done = malus(
        "score", dataset.path, "--predictions", tmp_path / "mine", "--name", "mine",
        "--method", "unpolarised", "--out", tmp_path / "out", "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    methods = {row["method"] for row in json.loads(done.stdout)["methods"]}
    assert methods == {"mine", "unpolarised"}
    assert read_results(tmp_path / "out").run["predictions"]["name"] == "mine"


def test_problems_on_the_command_line_are_lines_and_exit_code_2(
    dataset: Dataset, tmp_path: Path
) -> None:
    done = malus("score", dataset.path, "--predictions", tmp_path, "--out", tmp_path / "out")
    assert done.returncode == 2
    lines = done.stderr.strip().splitlines()
    assert len(lines) == len(dataset) + 1
    assert lines[-1].startswith("malus: ")
    assert "4 problem(s)" in lines[-1]


def test_nothing_to_score_is_told(dataset: Dataset) -> None:
    with pytest.raises(InputError, match="--predictions DIR"):
        CliRunner().invoke(score_command, [str(dataset.path)], catch_exceptions=False)


def test_a_made_up_dataset_without_a_suite_is_scored(tmp_path: Path) -> None:
    with DatasetWriter(tmp_path) as writer:
        writer.add(made_up_truth())
    results = score_dataset(open_folder(tmp_path), [get_method("unpolarised")])
    assert len(results.headlines) > 0


def test_a_folder_that_is_none_is_told(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="folder of predictions"):
        check_predictions(dataset, tmp_path / "nowhere", quiet)


def test_a_stored_dataset_scores_as_the_run_does(dataset: Dataset, tmp_path: Path) -> None:
    suite = Suite.parse(dataset.record.suite, "dataset.json")
    direct = run(suite, tmp_path, NOBODY).table
    methods = [get_method(name) for name in suite.methods]
    # To the bit: the truths are, and the order of scenes and methods is the same.
    scored = score_dataset(dataset, methods).table
    # A dataset does not say what rendered it.
    direct = direct.drop(columns="renderer").astype(scored.dtypes)
    pd.testing.assert_frame_equal(scored, direct)


def test_predictions_may_not_be_called_as_the_guess_that_a_profile_adds(
    dataset: Dataset, tmp_path: Path
) -> None:
    """Rows of one name were averaged, and the guess had a skill."""
    with pytest.raises(InputError, match="another name than a method's, found unpolarised"):
        score_dataset(dataset, [], tmp_path, "unpolarised", metrics=["profile:polarscale"])
