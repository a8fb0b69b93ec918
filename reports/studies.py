"""Sections of what `malus run precision` and `malus run stress` found."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from malus.reports.figures.drawings import Drawing, precision_drawing
from malus.reports.html import Markup, folded, join, table, tag
from malus.reports.section import Section, figure
from malus.reports.tables import sentences
from malus.reports.tables.formats import counted, listed, scientific
from malus.reports.tables.text_tables import TextTable, stress_cells
from malus.scenes.core.errors import InputError
from malus.scenes.core.result_files import RUN

_COLUMNS = {
    "precision.csv": [
        "diagram", "method", "setting", "seconds", "spread", "unit", "error", "pareto",
    ],
    "stress.csv": ["group", "case", "value", "error", "seconds", "passed", "why"],
}  # fmt: skip

_TEXTS = ("group", "case", "why", "diagram", "method", "setting", "unit")
"""Columns that are text also where every cell is empty."""


def is_study(folder: Path) -> bool:
    """Whether a folder holds what a study found."""
    return any((folder / name).exists() for name in _COLUMNS)


@dataclass(frozen=True)
class Study:
    """What a study found: `run.json`, its figures, and the sections that show them."""

    run: dict[str, Any]
    drawings: tuple[Drawing, ...]
    sections: tuple[Section, ...]


def read_study(folder: Path) -> Study:
    """The study in a folder.

    Raises
    ------
    InputError
        If there is none, or it cannot be read.
    """
    run = _run(folder / RUN)
    sections, drawings = [], []
    if (folder / "precision.csv").exists():
        found = _read(folder / "precision.csv")
        drawings.append(precision_drawing(found))
        sections.append(precision(drawings[0], run))
    if (folder / "stress.csv").exists():
        sections.append(stress(_read(folder / "stress.csv"), run))
    return Study(run, tuple(drawings), tuple(sections))


def _run(path: Path) -> dict[str, Any]:
    try:
        run: dict[str, Any] = json.loads(path.read_text("utf-8"))
        if "study" not in run:
            raise ValueError("no study in it")
    except (OSError, ValueError) as error:
        expected = "how a study came about, as JSON"
        hint = "`malus run precision` and `malus run stress` make it"
        raise InputError(str(path), expected, str(error).splitlines()[0], hint) from None
    return run


def _read(path: Path) -> pd.DataFrame:
    expected = ", ".join(_COLUMNS[path.name])
    hint = f"`malus run {path.stem}` makes it"
    try:
        with path.open("rb") as file:
            found = pd.read_csv(file, dtype=dict.fromkeys(_TEXTS, str))
    except (OSError, ValueError) as error:
        raise InputError(str(path), f"columns {expected}", str(error), hint) from None
    if not set(_COLUMNS[path.name]) <= set(found.columns):
        names = ", ".join(map(str, found.columns))
        raise InputError(str(path), f"columns {expected}", names, hint)
    found = found[_COLUMNS[path.name]]
    return found.fillna({name: "" for name in _TEXTS if name in found})


def precision(drawing: Drawing, run: dict[str, Any]) -> Section:
    """Work-precision diagrams with their Pareto fronts."""
    content = join(tag("p", sentences.PRECISION), figure(drawing), _origin(run))
    return Section("precision", "Error against run time", content)


def stress(found: pd.DataFrame, run: dict[str, Any]) -> Section:
    """The stress table: groups in short, what failed, and every case."""
    failed = found[~found["passed"]]
    verdict = f"{counted(len(found), 'case')}, {len(failed)} failed."
    content = join(
        tag("p", sentences.STRESS),
        tag("p", tag("b", verdict), class_="warning" if len(failed) else "note"),
        table(_groups(found), "Groups of cases"),
        table(_cases(failed), "What failed") if len(failed) else Markup(""),
        folded("Every case", table(_cases(found), "stress.csv")),
        _origin(run),
    )
    return Section("stress", "Stress", content)


def _origin(run: dict[str, Any]) -> Markup:
    machine = ", ".join(str(value) for value in run["machine"].values())
    versions = listed([f"{name} {version}" for name, version in run["versions"].items()])
    return tag("p", f"Finished {run['finished']} on {machine}; {versions}.", class_="note")


def _groups(found: pd.DataFrame) -> TextTable:
    lines = [
        [
            str(name), str(len(rows)), str(int((~rows["passed"]).sum())),
            scientific(float(rows["error"].max())), scientific(float(rows["seconds"].max())),
        ]
        for name, rows in found.groupby("group", sort=False)
    ]  # fmt: skip
    return TextTable(("group", "cases", "failed", "largest error", "longest, seconds"), lines)


def _cases(found: pd.DataFrame) -> TextTable:
    return TextTable(
        tuple(map(str, found.columns)), [stress_cells(row) for _, row in found.iterrows()]
    )
