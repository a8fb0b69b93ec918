"""Tables, progress and JSON that several commands print."""

from __future__ import annotations

import sys
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table

from malus.bench.commands.console import plain_console
from malus.bench.running.results import Results, headline
from malus.reports.tables.text_tables import left_out
from malus.scenes.core.errors import counted, printable
from malus.scenes.core.json_text import json_text

_METHOD_WIDTH = 20
"""Columns of a terminal for names of methods: longer ones would leave none to the numbers."""

NEXT_RUN = (
    "a next run tries again what failed for a wrong input, and leaves out the rest, which"
    " --retry-failed tries again"
)
"""What becomes of failures."""


def print_json(values: Any, indent: int | None = None) -> None:
    """Print values as JSON on standard output."""
    sys.stdout.write(json_text(values, indent) + "\n")


def plain_table(*columns: str) -> Table:
    """An empty table with little space between its columns; long names are broken, not cut."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in columns:
        table.add_column(printable(column), overflow="fold")
    return table


def print_results(results: Results, notes: Console) -> None:
    """Print the table of results, then into `notes` what each method could not work on, and why."""
    table = results_table(results)
    if table.row_count:
        plain_console().print(table)
    for method, reason, scenes in left_out(results.table).lines:
        text = f"{method} could not work on {scenes} of {results.table['scene'].nunique()} scenes"
        notes.print(printable(f"{text}: {reason}"))


def results_table(results: Results) -> Table:
    """NMSE and skill, one row a light, body and method; long lights are broken at 80 columns."""
    title = "skill: 1 is perfect, 0 no better than guessing “unpolarised”"
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    # Where columns are too wide together, those that may wrap are made narrower, and no other.
    table.add_column("light", overflow="fold")
    table.add_column("body", no_wrap=True)
    rows = list(headline(results))
    longest = max(cell_len(name) for name in ("method", *(printable(r["method"]) for r in rows)))
    table.add_column("method", width=min(longest, _METHOD_WIDTH), overflow="fold")
    for name in ("NMSE", "skill", "worst", "unmixed"):
        table.add_column(name, justify="right", no_wrap=True)
    without: dict[tuple[str, str], int] = {}
    for row in rows:
        numbers = [_skill(row[f"skill_{name}"]) for name in ("median", "min", "unmixed_median")]
        mean = row["nmse_mean"]
        nmse = "not finite" if mean is None else f"{mean:.1e}"
        names = (printable(row[key]) for key in ("light", "body", "method"))
        table.add_row(*names, nmse, *numbers)
        place = row["light"], row["body"]
        without[place] = max(without.get(place, 0), row["without_skill"])
    if any(without.values()):
        table.caption = (
            f"{counted(sum(without.values()), 'scene')} without a skill, in no median: the noise "
            "is too large to tell it; more samples help"
        )
    return table


def _skill(value: float | None) -> str:
    # Zero is added so that what rounds to it has no sign.
    return "–" if value is None else f"{round(value, 3) + 0.0:.3f}"
