"""What commands print of results: a reason where there is no number, and no name that acts."""

from __future__ import annotations

import pytest

from malus.bench.commands.console import plain_console
from malus.bench.commands.printing import print_results
from malus.bench.gates.gate import Comparison
from malus.bench.gates.gate_report import tables
from malus.bench.running.results import Results
from malus.reports.tables import sample

RED, TURNED = "[red]mine[/red]", "eq8\u202e\x1b[2J"


def test_a_run_of_which_no_method_could_work_prints_why(
    capsys: pytest.CaptureFixture[str],
) -> None:
    table = sample.table()
    table = table[table["metric"] == "inapplicable"]
    assert len(table)
    print_results(Results(table, sample.run()), plain_console(stderr=True, soft_wrap=True))
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "half_vector could not work on 6 of 6 scenes: needs a distant light" in printed.err


def test_names_are_printed_as_they_are_and_move_no_cursor(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    table = sample.table()
    table["method"] = table["method"].replace({"eq8": TURNED, "half_vector": RED})
    print_results(Results(table, sample.run()), plain_console(stderr=True))
    printed = capsys.readouterr()
    for text in (printed.out, printed.err):  # half_vector is among the reasons, too
        assert RED in text
    assert r"eq8\u202e\x1b[2J" in printed.out


def test_the_head_over_short_names_of_methods_is_whole(capsys: pytest.CaptureFixture[str]) -> None:
    table = sample.table()
    table["method"] = table["method"].replace({name: name[:3] for name in set(table["method"])})
    print_results(Results(table, sample.run()), plain_console(stderr=True))
    assert " method " in capsys.readouterr().out


def test_the_gate_cuts_no_word_of_a_narrow_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All letters of every cell, in the order of their lines, are printed at 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")
    scenes = ("polarised", "distant 60° azimuth 90°", "obsidian")
    worse = Comparison(
        ("facing_skill", "half_vector+body", "everything", *scenes), "worse",
        before=0.9414, after=0.9109, error=0.0001, limit=0.0101, visible=0.01,
        paired=True,
    )  # fmt: skip
    for part in tables([worse]):
        plain_console().print(part)
    printed = capsys.readouterr().out
    assert "…" not in printed
    words = "facing_skill", "polarised", "distant", "azimuth", "obsidian", "-0.0305", "0.0001"
    for word in words:
        assert word in printed, word


@pytest.mark.parametrize("columns", [0, 20, 60])
def test_a_narrow_terminal_loses_nothing(
    columns: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With 60 columns the lights were left out and numbers cut, with 0 nothing was printed."""
    printed = []
    for width in (80, columns):
        monkeypatch.setenv("COLUMNS", str(width))
        print_results(Results(sample.table(), sample.run()), plain_console(stderr=True))
        printed.append(capsys.readouterr())
    wide, narrow = printed
    assert narrow.out == wide.out
    # Words are broken over lines where they are wider than the terminal.
    assert "".join(narrow.err.split()) == "".join(wide.err.split()) != ""
