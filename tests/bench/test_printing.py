"""What commands print of results: a reason where there is no number, and no name that acts."""

from __future__ import annotations

import pytest

from malus.bench.commands.console import plain_console
from malus.bench.commands.printing import print_results
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
