"""Tables, progress and JSON that several commands print."""

from __future__ import annotations

import sys
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from malus.bench.running.results import Results, headline
from malus.reports.tables.formats import counted
from malus.scenes.core.json_text import json_text


def print_json(values: Any, indent: int | None = None) -> None:
    """Print values as JSON on standard output."""
    sys.stdout.write(json_text(values, indent) + "\n")


def plain_table(*columns: str) -> Table:
    """An empty table with little space between its columns; long names are broken, not cut."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def results_table(results: Results) -> Table:
    """NMSE and skill, one row a light, body and method; long lights are broken at 80 columns."""
    title = "skill: 1 is perfect, 0 no better than guessing “unpolarised”"
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    # Where columns are too wide together, those that may wrap are made narrower, and no other.
    table.add_column("light", overflow="fold")
    for name in ("body", "method"):
        table.add_column(name, no_wrap=True)
    for name in ("NMSE", "skill", "worst", "unmixed"):
        table.add_column(name, justify="right", no_wrap=True)
    without: dict[tuple[str, str], int] = {}
    for row in headline(results):
        numbers = [_skill(row[f"skill_{name}"]) for name in ("median", "min", "unmixed_median")]
        mean = row["nmse_mean"]
        nmse = "not finite" if mean is None else f"{mean:.1e}"
        table.add_row(row["light"], row["body"], row["method"], nmse, *numbers)
        place = row["light"], row["body"]
        without[place] = max(without.get(place, 0), row["without_skill"])
    if any(without.values()):
        table.caption = (
            f"{counted(sum(without.values()), 'scene')} without a skill, in no median: the noise "
            "is too large to tell it; more samples help"
        )
    return table


def _skill(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
