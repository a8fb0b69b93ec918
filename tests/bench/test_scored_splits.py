"""Methods and predictions are scored on one split of a dataset alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from runs import NOBODY, SUITE, run_malus

import malus
from malus.bench.datasets.export import export
from malus.bench.datasets.render import render_dataset
from malus.bench.datasets.score import score_dataset
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.scenes import InputError, Suite

CONTENT = {
    "name": "drawn",
    "wavelengths_nm": [450, 550, 650],
    "methods": ["unpolarised"],
    "renderer": "torrance-sparrow",
    "camera": {"resolution": 8},
    "random": {
        "count": 12,
        "seed": 1,
        "shapes": [{"kind": "sphere"}],
        "materials": [{"eta": {"uniform": [1.3, 1.8]}}],
        "surfaces": [{"alpha": 0.3, "albedo": 0.1}],
        "lights": [{"kind": "distant", "incidence_deg": {"uniform": [40, 80]}}],
    },
    "splits": {"train": 0.6, "test": 0.4},
}


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("drawn")
    render_dataset(Suite.parse(CONTENT, "test"), folder, NOBODY)
    return open_folder(folder)


def predict(drawn: Dataset, folder: Path, scenes: list[str]) -> Path:
    folder.mkdir()
    for scene in scenes:
        np.savez(folder / f"{scene}.npz", stokes=drawn.truth(scene).stokes)
    return folder


def test_a_split_is_predicted_and_scored_alone(drawn: Dataset, tmp_path: Path) -> None:
    test = drawn.splits["test"]
    assert set(test) == set(json.loads((drawn.path / "splits.json").read_text())["splits"]["test"])
    mine = predict(drawn, tmp_path / "mine", test)
    results = malus.score_dataset(drawn.path, ["eq8"], mine, split="test")
    assert set(results.table.scene) == set(test)
    assert results.run["scenes"] == len(test)
    assert results.run["scenes_missing"] == 0
    assert results.run["dataset"]["split"] == "test"
    assert "split" not in malus.score_dataset(drawn.path, ["unpolarised"]).run["dataset"]
    # Predictions of other scenes may lie beside them, and change nothing.
    everything = predict(drawn, tmp_path / "all", list(drawn.scenes))
    again = malus.score_dataset(drawn.path, [], everything, split="test")
    assert again.run["predictions"]["sha256"] == results.run["predictions"]["sha256"]
    (mine / f"{test[0]}.npz").unlink()
    with pytest.raises(InputError, match=f"each of {len(test)} scenes, found 1 problem"):
        malus.score_dataset(drawn.path, [], mine, split="test")
    with pytest.raises(InputError, match=f"each of 12 scenes, found {12 - len(test) + 1} problem"):
        malus.score_dataset(drawn.path, [], mine)


@pytest.mark.parametrize("layout", ["webdataset", "numpy", "pol"])
def test_a_split_is_exported_alone(drawn: Dataset, tmp_path: Path, layout: str) -> None:
    """Refused as damaged before: `splits.json` has scenes of the other splits too."""
    test = drawn.splits["test"]
    assert export(drawn.of_split("test"), layout, tmp_path / "test") == len(test)
    told = json.loads((tmp_path / "test" / "splits.json").read_text("utf-8"))
    assert told["splits"] == {"train": [], "test": test}
    if layout == "webdataset":
        samples = malus.open_dataset(tmp_path / "test", split="test", maps="stokes")
        stokes = {sample["scene"]: sample["stokes"] for sample in samples}
        assert sorted(stokes) == sorted(test)
        single = drawn.truth(test[0]).stokes.astype(np.float32)  # as shards hold it
        np.testing.assert_array_equal(stokes[test[0]], single)


def test_the_command_exports_a_split(drawn: Dataset, tmp_path: Path) -> None:
    """By the numbers of the whole dataset, by which `malus score` reads predictions."""
    numbers = {scene: f"{number:04}" for number, scene in enumerate(drawn.scenes)}
    out = ["--format", "pol", "--out", str(tmp_path / "out")]
    assert run_malus("export", str(drawn.path), *out, "--split", "test").returncode == 0
    names = json.loads((tmp_path / "out" / "names.json").read_text("utf-8"))
    assert names == {scene: numbers[scene] for scene in drawn.splits["test"]}
    pictures = {path.stem for path in (tmp_path / "out" / "pol045").iterdir()}
    assert pictures == set(names.values())
    refused = run_malus("export", str(drawn.path), *out, "--split", "val")
    assert refused.returncode == 2
    assert "expected a scene in it" in " ".join(refused.stderr.split())


def test_a_dataset_of_a_split_is_scored_as_that_split(drawn: Dataset, tmp_path: Path) -> None:
    """Pictures were taken by their numbers in the split: those of other scenes, in silence."""
    test = drawn.splits["test"]
    export(drawn, "pol", tmp_path / "all")
    export(drawn.of_split("test"), "pol", tmp_path / "test")
    wanted = score_dataset(drawn, [], tmp_path / "all", layout="pol", split="test")
    assert wanted.run["scenes_missing"] == 0
    for folder, dataset in (("all", drawn.of_split("test")), ("test", drawn)):
        split = "test" if dataset is drawn else None
        found = score_dataset(dataset, [], tmp_path / folder, layout="pol", split=split)
        pd.testing.assert_frame_equal(found.table, wanted.table)
        for key in ("scenes", "scenes_missing", "dataset", "predictions"):
            told = [
                dict(run[key]) | {"folder": ""} if isinstance(run[key], dict) else run[key]
                for run in (found.run, wanted.run)
            ]
            assert told[0] == told[1], key
    # Predictions of other scenes may lie beside those of the split.
    everything = predict(drawn, tmp_path / "every", list(drawn.scenes))
    assert set(score_dataset(drawn.of_split("test"), [], everything).table.scene) == set(test)
    assert drawn.of_split("test").of_split("test").whole is drawn


def test_numbers_of_layouts_are_those_in_the_whole_dataset(drawn: Dataset, tmp_path: Path) -> None:
    export(drawn, "pol", tmp_path / "pol")
    names = json.loads((tmp_path / "pol" / "names.json").read_text("utf-8"))
    for scene in drawn.splits["train"]:
        for file in tmp_path.glob(f"pol/*/{names[scene]}.png"):
            file.unlink()
    results = score_dataset(drawn, [], tmp_path / "pol", layout="pol", split="test")
    skill = results.headlines[results.headlines.metric == "skill"]
    assert set(skill.scene) == set(drawn.splits["test"])
    assert skill.value.min() > 0.99  # 16 bits of the truth itself


def test_a_split_that_is_not_there_is_told(drawn: Dataset, tmp_path: Path) -> None:
    told = run_malus("score", str(drawn.path), "--method", "eq8", "--split", "val")
    assert told.returncode == 2
    assert "split val: expected a scene in it; there are some in" in told.stderr
    assert "leave --split out" in told.stderr
    render_dataset(SUITE, tmp_path / "plain", NOBODY)
    told = run_malus("score", str(tmp_path / "plain"), "--method", "eq8", "--split", "test")
    assert told.returncode == 2
    assert "malus: --split: expected a dataset with splits, found one without" in told.stderr
    told = run_malus("score", "--truth", "set", "--layout", "pol", "--split", "test")
    assert told.returncode == 2
    assert "--split is of DATASET" in told.stderr


def test_the_command_scores_a_split(drawn: Dataset, tmp_path: Path) -> None:
    mine = predict(drawn, tmp_path / "mine", drawn.splits["test"])
    out = tmp_path / "out"
    told = run_malus(
        "score", str(drawn.path), "--predictions", str(mine), "--split", "test", "--out", str(out)
    )
    assert told.returncode == 0, told.stderr
    assert json.loads((out / "run.json").read_text("utf-8"))["dataset"]["split"] == "test"
