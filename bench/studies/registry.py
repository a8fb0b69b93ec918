"""What `malus run` does besides suites of scenes: studies that make their own tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from malus.bench.running.output_folder import prepare_folder
from malus.bench.running.results import origin, write_run
from malus.renderers.variant import choose
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import write_whole


@dataclass(frozen=True)
class Study:
    """A study: what it is for, and a function of (folder, backend) that says whether it passed."""

    name: str
    description: str
    run: Callable[[Path, str], bool]

    @property
    def plan(self) -> str:
        """What a run of it will do, for `malus plan`."""
        return (
            f"{self.name}: {self.description}. A study of fixed cases instead of a suite of scenes:"
            f" nothing is left out. `malus run {self.name}` writes a table and a page"
        )


def _stress(out: Path, backend: str) -> bool:
    from malus.bench.studies.stress import stress_table, write_table
    from malus.reports.tables.text_tables import stress_cells

    table = stress_table()
    write_table(out, table)
    _show(table, stress_cells)
    failed = int((~table.passed).sum())
    Console().print(f"{len(table)} cases, {failed} failed; written to {out}", highlight=False)
    return failed == 0


def _precision(out: Path, backend: str) -> bool:
    from malus.bench.studies.precision import precision

    table = precision(choose(backend))
    write_whole(out / "precision.csv", lambda path: table.to_csv(path, index=False))
    _show(table, _cells)
    Console().print(f"written to {out}", highlight=False)
    return True


def _cells(row: pd.Series) -> list[str]:
    numbers = {"seconds", "spread", "error"}
    return [f"{value:.2e}" if name in numbers else str(value) for name, value in row.items()]


def _show(table: pd.DataFrame, to_cells: Callable[[pd.Series], list[str]]) -> None:
    shown = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name in table.columns:
        shown.add_column(str(name))
    for _, row in table.iterrows():
        shown.add_row(*to_cells(row))
    Console().print(shown)


STUDIES = {
    study.name: study
    for study in (
        Study("stress", "Stiff and extreme cases, each with its error and a verdict", _stress),
        Study("precision", "Error against run time: R, rendering, whole methods", _precision),
    )
}


def run_study(
    name: str, out: Path | None, backend: str, others: Mapping[str, object] | None = None
) -> bool:
    """Run a study; its files go to `out`, by default results/NAME. True if it passed.

    Raises
    ------
    InputError
        If one of the `others`, options of `malus run` that are for suites, was given.
    """
    from malus.reports.write import write_study

    given = [
        f"--{key}".replace("methods", "method")
        for key, value in (others or {}).items()
        if not (value is None or value is False or value == ())  # a seed of 0 is given
    ]
    if given:
        hint = f"leave it out: the cases of {name} are fixed"
        raise InputError(f"malus run {name}", "no option but --out and --backend", given[0], hint)
    folder = prepare_folder(out if out is not None else Path("results") / name, "a study")
    study = STUDIES[name]
    passed = study.run(folder, backend)
    write_run(folder, origin() | {"study": name, "description": study.description})
    write_study(folder)
    return passed
