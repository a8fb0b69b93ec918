"""What is refused is refused before work, in one line, and leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

import pytest
from runs import TINY, formula_dataset, run_malus

from malus.reports import write


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
