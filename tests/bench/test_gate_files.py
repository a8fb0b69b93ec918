"""Where a gate writes its reports: over nothing but such reports of an earlier gate."""

from __future__ import annotations

from pathlib import Path

import pytest
from runs import NOBODY, SUITE, one_line, run_malus

import malus
from malus.bench.gates.baseline import write_baseline
from malus.bench.running.runner import run
from malus.scenes import InputError
from malus.scenes.core.model import content_id

JUNIT = "<?xml version='1.0' encoding='utf-8'?>\n<testsuites>"


@pytest.fixture
def gated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder, the current one, with the run `quick` and the baseline `b.toml`."""
    monkeypatch.chdir(tmp_path)
    run(SUITE, tmp_path / "quick", variant=NOBODY)
    malus.update_baseline("quick", "b.toml")
    return tmp_path


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--junit", "b.toml"], "--junit: expected a file of its own, found b.toml, the baseline"),
        (["--summary", "./quick/../b.toml"], "--summary: expected a file of its own"),
        (["--summary", "link.md"], "found link.md, the baseline; choose another name"),
        (["--junit", "new", "--summary", "new"], "found new, the same as --junit"),
        (["--junit", "quick/run.json"], "a file that no run writes, found quick/run.json"),
        (["--summary", "quick/summary.md"], "a file that no run writes"),
        (["--junit", "quick/figure9.svg"], "a file that no run writes"),
        (["--summary", "quick/parts/new.md"], "a file that no run writes"),
        (["--junit", "other.toml"], "expected a new file, or JUnit's XML, found other.toml"),
        (["--summary", "other.toml"], "expected a new file, or Markdown"),
        (["--junit", "page.xml"], "expected a new file, or JUnit's XML"),
        (["--update", "--junit", "new"], "leave out --update"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_reports_of_a_gate_replace_nothing_else(
    gated: Path, arguments: list[str], says: str
) -> None:
    """The reviewed baseline became XML behind a gate that passed."""
    (gated / "other.toml").write_text("# another baseline", "utf-8")
    (gated / "page.xml").write_text("<?xml version='1.0'?><svg>", "utf-8")
    (gated / "link.md").symlink_to("b.toml")
    before = contents(gated)
    done = run_malus("gate", "quick", "--baseline", "b.toml", *arguments)
    assert done.returncode == 2
    assert says in one_line(done.stderr)
    assert contents(gated) == before


def test_reports_of_an_earlier_gate_are_replaced(gated: Path) -> None:
    """So are empty files, as behind $GITHUB_STEP_SUMMARY, and Markdown that was put there."""
    for earlier in ("", "## Accuracy\n", "### gate FAILED"):
        (gated / "step_summary_1").write_text(earlier, "utf-8")
        (gated / "quick" / "gate.xml").write_text(JUNIT if earlier else "", "utf-8")
        malus.gate("quick", "b.toml", junit="quick/gate.xml", summary="step_summary_1")
        assert (gated / "step_summary_1").read_text("utf-8").startswith("### gate passed")
        assert (gated / "quick" / "gate.xml").read_text("utf-8").startswith(JUNIT)


def test_a_baseline_of_an_earlier_version_is_compared_when_it_is_replaced(gated: Path) -> None:
    """Earlier hashes of the scenes count metrics: `gate` knows them, `update_baseline` did not."""
    run(SUITE.model_copy(update={"metrics": ("polarisation",)}), gated / "more", variant=NOBODY)
    path = gated / "old.toml"
    now = malus.update_baseline("more", path).baseline
    suite = dict(malus.read_results("more").run["suite"])
    sampling = {key: value for key, value in suite["sampling"].items() if key != "seed"}
    content = {k: v for k, v in suite.items() if k not in ("name", "description", "methods")}
    earlier = content_id(content | {"sampling": sampling})
    assert earlier != now.origin.scenes
    origin = now.origin.model_copy(update={"scenes": earlier})
    write_baseline(path, now.model_copy(update={"origin": origin}))
    compared = malus.update_baseline("more", path).compared
    assert compared is not None
    assert compared.passed


def test_a_folder_is_no_file_to_write(gated: Path) -> None:
    (gated / "reports").mkdir()
    with pytest.raises(InputError, match="junit: expected a new file"):
        malus.gate("quick", "b.toml", junit="reports")
