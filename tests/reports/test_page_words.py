"""What a page says of metals, of estimates that are no numbers, and without a script."""

from __future__ import annotations

import html
import io
import math
import re
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
from rich.console import Console

from malus.bench.commands.printing import plain_table
from malus.reports import write_report
from malus.reports.tables import sample, text_tables
from malus.reports.tables.compared_runs import means_table
from malus.reports.tables.figure_numbers import both_panels


def words(table: pd.DataFrame, folder: Path) -> str:
    """The text of the page of a table, without its scripts, styles and tags."""
    write_report(SimpleNamespace(table=table, run=sample.run()), folder)
    page = (folder / "report.html").read_text("utf-8")
    bare = re.sub(r"<(script|style)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", bare)).split())


@pytest.mark.parametrize(("body", "called"), [("none", "no body (metal)"), ("mixed", "mixed bodies")])
def test_a_body_that_is_none_is_not_called_a_none_body(
    table: pd.DataFrame, tmp_path: Path, body: str, called: str
) -> None:
    """As a column's value `none` is plain; "eq8, none body" is no English."""
    text = words(table.assign(body=body), tmp_path)
    assert f"Everything known to the methods; {called}." in text
    assert f"Figure 5, {called}" in text
    assert f"eq8, {called}" in text
    assert f"{body} body" not in text
    assert f"body {body}" not in text.lower()


def test_an_estimate_that_is_not_finite_has_no_dash_for_its_error(
    table: pd.DataFrame, tmp_path: Path
) -> None:
    """A dash stands where nothing was scored or the noise hides a skill: neither is so here."""
    errors = table["metric"].isin(["nmse", "skill"]) & (table["method"] == "eq8")
    table.loc[errors, "value"] = math.nan
    lines = [line for line in text_tables.errors(table).lines if line[2] == "eq8"]
    assert {tuple(line[4:6]) for line in lines} == {("not finite", "not finite")}
    ranges = [line[2:5] for line in text_tables.beside_paper(table).lines if line[1] == "eq8"]
    assert ranges == [["not finite"] * 3] * len(ranges)
    behind = text_tables.by_method(both_panels(table))
    column = behind.heads.index("eq8")
    assert {line[column] for line in behind.lines} == {"not finite"}
    assert "– ± –" not in words(table, tmp_path)


def test_runs_side_by_side_fit_a_terminal_of_80_columns(table: pd.DataFrame) -> None:
    """A number that goes on in the next line reads as another number."""
    names = ["results/before", "results/after", "results/another"]
    runs = [SimpleNamespace(table=table, run=sample.run()) for _ in names]
    means = means_table(names, runs)
    shown = plain_table(*means.heads)
    for line in means.lines:
        shown.add_row(*line)
    console = Console(width=80, file=io.StringIO())
    console.print(shown)
    printed = console.file.getvalue()
    assert all(cell in printed for line in means.lines for cell in line)
