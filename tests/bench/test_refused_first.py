"""What is refused is refused before work, in one line, and leaves nothing behind."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from runs import NOBODY, SUITE, TINY, formula_dataset, run_malus

from malus.bench.datasets.score import score_dataset
from malus.bench.running import runner
from malus.bench.running.overrides import chosen_suite
from malus.bench.running.plan import FamilyPlan, plan
from malus.reports import write
from malus.scenes import InputError, Suite, load_suite
from malus.scenes.core.result_files import TABLE


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("refused") / "dataset"
    formula_dataset(folder)
    return folder


@pytest.mark.parametrize("predictions", ["nosuch", "empty"])
def test_predictions_that_are_none_leave_no_folder(
    dataset: Path, tmp_path: Path, predictions: str
) -> None:
    (tmp_path / "empty").mkdir()
    out, given = tmp_path / "out", tmp_path / predictions
    done = run_malus("score", str(dataset), "--predictions", str(given), "--out", str(out))
    assert done.returncode == 2
    assert not out.exists()


def test_scores_go_into_no_dataset_and_nothing_is_read_first(dataset: Path, tmp_path: Path) -> None:
    nosuch = str(tmp_path / "nosuch")
    for inputs in ((str(dataset), "--predictions", nosuch), (nosuch, "--layout", "pol", "--truth")):
        given = (*inputs, nosuch) if inputs[-1] == "--truth" else inputs
        done = run_malus("score", *given, "--out", str(dataset))
        assert done.returncode == 2
        assert "expected a new folder, or scores, found a dataset" in done.stderr


def test_a_report_reads_the_studies_beside_it_before_it_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "r"
    assert run_malus(*TINY, "--method", "unpolarised", "--out", str(out)).returncode == 0
    monkeypatch.delattr(write, "Draughtsman")
    done = run_malus("report", str(out), "--with", str(tmp_path / "nosuch"))
    assert done.returncode == 2
    assert "nosuch" in done.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--workers", "1", "--scheduler", "tcp://127.0.0.1:1"), "--workers, --scheduler"),
        (("--scheduler", "nosuch"), "nosuch"),
        (("--out", "{folder}/photo.png"), "photo.png"),
        (("--out", "{dataset}"), "expected a new folder, or a run, found a dataset"),
        (("--timeout", "-1"), "--timeout"),
        # As of an older system, or a locale that is no UTF-8: a traceback after the first family.
        (("--out", "{folder}/" + os.fsdecode(b"q\xff")), "expected a path in UTF-8"),
    ],
)
def test_a_wrong_option_of_a_run_is_the_only_line(
    options: tuple[str, ...], words: str, dataset: Path, tmp_path: Path
) -> None:
    (tmp_path / "photo.png").write_bytes(b"a picture")
    given = [option.format(folder=tmp_path, dataset=dataset) for option in options]
    done = run_malus(*TINY, *given)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert words in line


def test_a_run_is_announced_before_it_is_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of thousands of drawn objects the plan takes half a minute; a refusal comes before both."""
    told: list[str] = []

    def planned(suite: Suite) -> list[FamilyPlan]:
        told.append("the plan")
        return plan(suite)

    def progress(_done: int, _total: int, label: str) -> None:
        told.append(label)

    monkeypatch.setattr(runner, "plan", planned)
    (tmp_path / "photo.png").write_bytes(b"a picture")
    with pytest.raises(InputError, match="a new folder, or a run, found a file"):
        runner.run(SUITE, tmp_path / "photo.png", NOBODY, progress)
    assert not told
    runner.run(SUITE, tmp_path / "results", NOBODY, progress)
    assert told[:2] == ["planning", "the plan"]


@pytest.mark.parametrize("option", ["--method", "--metric", "--backend", "--out"])
def test_an_empty_text_is_seen_in_the_message(option: str) -> None:
    done = run_malus("run", "quick", option, "")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "found ''" in line or "found an empty text" in line


def test_a_wrong_size_names_no_suite_twice() -> None:
    done = run_malus("run", "quick", "--resolution", "1")
    assert done.stderr.startswith("malus: the values asked for, suite quick, camera: expected an")


def test_methods_and_metrics_count_once(dataset: Path, tmp_path: Path) -> None:
    """In a suite, for a run and for a dataset: otherwise rows stood twice in the table."""
    suite = load_suite("quick")
    twice = {"methods": ["eq8", "eq8"], "metrics": ["psnr", "psnr"]}
    again = type(suite).parse(suite.model_dump(mode="json") | twice, "suite")
    assert (again.methods, again.metrics) == (("eq8",), ("psnr",))
    for changes in (twice, {name: values[:1] for name, values in twice.items()}):
        assert chosen_suite("quick", NOBODY, **changes).id == again.id
    table = score_dataset(dataset, **twice).table
    assert not table.duplicated(["scene", "method", "metric", "band_nm", "angle_deg"]).any()


def test_a_run_says_whose_results_it_replaces(tmp_path: Path) -> None:
    """And the earlier command brings them back from its parts."""
    first = (*TINY, "--method", "unpolarised", "--out", str(tmp_path))
    assert "replaced" not in run_malus(*first).stderr
    assert "replaced" not in run_malus(*first).stderr
    table = (tmp_path / TABLE).read_bytes()
    told = " ".join(run_malus(*first, "--seed", "5").stderr.split())
    assert "replaced results of an earlier run there (quick: 8² pixels, 2 samples, seed 1," in told
    assert (tmp_path / TABLE).read_bytes() != table
    assert "seed 5" in run_malus(*first).stderr
    assert (tmp_path / TABLE).read_bytes() == table
