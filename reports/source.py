"""What a page is made from: the results of a run, or the tables of a study."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from malus.reports.figures.drawings import Drawing
from malus.reports.figures.study_drawings import (
    precision_drawing,
    prices_drawing,
    readings_drawing,
    separation_drawing,
)
from malus.reports.tables.colour_errors import table1
from malus.reports.viewer.examples import Example, read_examples
from malus.reports.viewer.pack import Shown, fitted
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.result_files import EXAMPLES, RUN

_STUDY_COLUMNS = {
    "precision.csv": [
        "diagram", "method", "setting", "seconds", "spread", "unit", "error", "pareto",
    ],
    "stress.csv": ["group", "case", "value", "error", "seconds", "passed", "why"],
    "readings.csv": [
        "reading", "light", "albedo", "method", "panel", "name", "x", "mean", "std", "objects",
        "failed",
    ],
    "mismatch.csv": ["assumption", "kind", "scene", "method", "holds", "broken"],
    "separation.csv": ["shape", "body", "light", "colour", "separation", "rmse", "why"],
}  # fmt: skip

_STUDIES = {"readings": "paper"}
"""Studies whose table has another name than the study."""

_TEXT_COLUMNS = (
    "group", "case", "why", "diagram", "method", "setting", "unit", "reading", "light", "panel",
    "name", "shape", "body", "colour", "separation",
    "assumption", "kind", "scene",
)  # fmt: skip
"""Columns that are text also where every cell is empty."""


@dataclass(frozen=True)
class Source:
    """The results of a run, its folder, and the figures made of the results.

    `ladders` are the figures of the error budget, `beside` folders of
    studies whose sections the page shows too.
    """

    table: pd.DataFrame
    run: dict[str, Any]
    folder: Path
    drawings: tuple[Drawing, ...]
    ladders: tuple[Drawing, ...] = ()
    beside: tuple[Path, ...] = ()

    @cached_property
    def colours(self) -> pd.DataFrame:
        """Table I; empty where the run scored no colours."""
        return table1(self.table)

    @cached_property
    def examples(self) -> tuple[Example, ...]:
        """Scenes whose images the run kept, in the order of the suite; no other run's.

        Earlier runs may have left other scenes in the folder, and images of other methods.
        """
        order = {scene: number for number, scene in enumerate(self.table["scene"].unique())}
        methods = set(self.table["method"].unique())
        own = (
            replace(example, methods={k: v for k, v in example.methods.items() if k in methods})
            for example in read_examples(self.folder / EXAMPLES)
            if example.scene in order
        )
        return tuple(sorted(own, key=lambda example: order[example.scene]))

    @cached_property
    def shown(self) -> tuple[list[Shown], int]:
        """Those with images of methods that fit a page, and the number of those left out."""
        return fitted([example for example in self.examples if example.methods])


@dataclass(frozen=True)
class StudyTables:
    """What a study wrote: `run.json` and its table or tables, None for one that it has not."""

    run: dict[str, Any]
    precision: pd.DataFrame | None
    stress: pd.DataFrame | None
    readings: pd.DataFrame | None
    mismatch: pd.DataFrame | None
    separation: pd.DataFrame | None

    @cached_property
    def drawings(self) -> tuple[Drawing, ...]:
        """The figure of a study that has one."""
        tables = (
            (self.precision, precision_drawing),
            (self.readings, readings_drawing),
            (self.mismatch, prices_drawing),
            (self.separation, separation_drawing),
        )
        return tuple(drawing(table) for table, drawing in tables if table is not None)


def is_study(folder: Path) -> bool:
    """Whether a folder holds the table of a study."""
    return any((folder / name).exists() for name in _STUDY_COLUMNS)


def read_study(folder: Path) -> StudyTables:
    """The study in a folder.

    Raises
    ------
    InputError
        If there is none, or it cannot be read.
    """
    run = _read_run(folder / RUN)
    return StudyTables(run, *(_read_table(folder / name) for name in _STUDY_COLUMNS))


def _read_run(path: Path) -> dict[str, Any]:
    expected = "how a study came about, as JSON"
    hint = "`malus bench` lists the studies that make it"
    with reading(str(path), expected, hint):
        run: dict[str, Any] = json.loads(path.read_text("utf-8"))
        if "study" not in run:
            raise ValueError("no study in it")
    return run


def _read_table(path: Path) -> pd.DataFrame | None:
    if not path.exists():
        return None
    columns = _STUDY_COLUMNS[path.name]
    expected = f"columns {', '.join(columns)}"
    hint = f"`malus bench {_STUDIES.get(path.stem, path.stem)}` makes it"
    with reading(str(path), expected, hint), path.open("rb") as file:
        table = pd.read_csv(file, dtype=dict.fromkeys(_TEXT_COLUMNS, str))
    if not set(columns) <= set(table.columns):
        raise InputError(str(path), expected, ", ".join(map(str, table.columns)), hint)
    return table[columns].fillna({name: "" for name in _TEXT_COLUMNS if name in columns})
