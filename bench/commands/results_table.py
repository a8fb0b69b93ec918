"""The table that a run or a score ends with."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.table import Table

from malus.bench.running.results import Results, headline


def final_table(results: Results) -> Table:
    """One row a light, body and method; narrow enough for 80 columns."""
    title = "skill: 1 is perfect, 0 no better than guessing “unpolarised”"
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name in ("light", "body", "method"):
        table.add_column(name, no_wrap=True)
    for name in ("NMSE", "skill", "worst"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in headline(results):
        numbers = [_skill(row["skill_median"]), _skill(row["skill_min"])]
        nmse = f"{row['nmse_mean']:.1e}"
        table.add_row(row["light"], row["body"], row["method"], nmse, *numbers)
    return table


def _skill(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
