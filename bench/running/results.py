"""The results of a run as files: one table and one JSON; written whole or not at all."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from malus.bench.running.pieces import headlines, read_compact, stream
from malus.bench.scoring.judge import Value
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import open_regular, replace_file
from malus.scenes.scene import Scene

TABLE = "results.parquet"
HEADLINES = "results.csv"
RUN = "run.json"
PARTS = "parts"
EXAMPLES = "examples"


@dataclass(frozen=True)
class Results:
    """A finished run: the table, and how it came about.

    Attributes
    ----------
    table : DataFrame
        One row a scene × method × knowledge × metric; `band_nm` and `angle_deg` are missing where
        the value is over all bands and angles. Text columns of a table that was read are
        categories.
    run : dict
        Suite, versions, seeds, machine, seconds of every stage.
    """

    table: pd.DataFrame
    run: dict[str, Any]

    @property
    def headlines(self) -> pd.DataFrame:
        """Rows over all bands and angles."""
        return headlines(self.table)


class Record(NamedTuple):
    """Rows of the table that share all columns but those of a Value."""

    common: Mapping[str, Any]
    values: Sequence[Value]


def record(
    about: Mapping[str, Any],
    method: str,
    values: Iterable[Value],
    note: str = "",
    knowledge: str = "everything",
) -> Record:
    """What was found out about one method on one scene; `about` is what `describe` says of it."""
    common = {**about, "method": method, "knowledge": knowledge, "note": note}
    return Record(common, tuple(values))


def inapplicable(
    about: Mapping[str, Any], method: str, reason: str, knowledge: str = "everything"
) -> Record:
    """One row that says why a method could not work on a scene."""
    return record(about, method, [Value("inapplicable", 1.0)], reason, knowledge)


def describe(scene: Scene) -> dict[str, Any]:
    """The columns that say what a scene is."""
    surface = scene.surface
    light = scene.light
    return {
        "scene": scene.id,
        "shape": scene.label,
        "material": surface.material_label,
        "eta": float(scene.eta.real.mean()),
        "surface": surface.label,
        "alpha": surface.alpha,
        "body": surface.body,
        "light": light.label,
        "incidence_deg": getattr(light, "incidence_deg", None),
    }


def table_of(records: Sequence[Record]) -> pd.DataFrame:
    """Records as a table with stable column types, also where a column is empty throughout.

    Examples
    --------
    >>> found = table_of([Record({"scene": "a"}, [Value("nmse", 0.1), Value("skill", 0.9)])])
    >>> found.scene.tolist(), found.metric.tolist()
    (['a', 'a'], ['nmse', 'skill'])
    """
    counts = [len(record.values) for record in records]
    columns: dict[str, Any] = {}
    for name in records[0].common:
        floats = "float64" if name in _FLOATS else None
        column = pd.Series([record.common[name] for record in records], dtype=floats)
        columns[name] = column.repeat(counts).array
    values = zip(*(value for record in records for value in record.values), strict=True)
    found = dict(zip(Value._fields, values, strict=True))
    columns["metric"] = found["metric"]
    for name in ("band_nm", "angle_deg", "value", "noise"):
        columns[name] = np.array(found[name], dtype=np.float64)
    return pd.DataFrame(columns)


_FLOATS = {"eta", "alpha", "incidence_deg"}


def origin() -> dict[str, Any]:
    """When, where and with which versions results were made, for `run.json`.

    Examples
    --------
    >>> sorted(origin())
    ['finished', 'machine', 'versions']
    """
    packages = ("malus", "mitsuba", "drjit", "numpy", "scipy", "pandas")
    versions = {name: version(name) for name in packages}
    return {
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions | {"python": platform.python_version()},
        "machine": {"system": platform.platform(), "processor": platform.machine()},
    }


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Call `write` with a temporary name beside `path`, then rename: whole or not at all.

    Raises
    ------
    InputError
        Where there is no room, or no permission to write.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, write)


def write_results(out: Path, results: Results) -> None:
    """The table as Parquet, its headline rows as CSV, and run.json."""
    write_tables(out, [results.table])
    write_run(out, results.run)


def write_tables(out: Path, tables: Iterable[pd.DataFrame]) -> None:
    """Tables one after the other as one Parquet file, and their headline rows as CSV.

    Memory holds some `pieces.GROUP_ROWS` rows, however many there are.
    """

    def both(parquet: Path) -> None:
        write_whole(out / HEADLINES, lambda csv: stream(tables, parquet, csv))

    write_whole(out / TABLE, both)


def write_run(out: Path, run: dict[str, Any]) -> None:
    """run.json: how results came about."""
    text = json.dumps(run, indent=2, sort_keys=True, allow_nan=False)
    write_whole(out / RUN, lambda path: path.write_text(text + "\n", encoding="utf-8"))


def read_results(folder: Path) -> Results:
    """The results of a finished run.

    Raises
    ------
    InputError
        If the folder holds none, or they cannot be read.
    """
    try:
        with open_regular(folder / TABLE) as file:
            table = read_compact(file)
        run = json.loads((folder / RUN).read_text("utf-8"))
    except Exception as error:  # a foreign parser raises anything on a broken file
        raise InputError(
            f"results folder {folder}",
            f"{TABLE} and {RUN} of a finished run",
            (str(error).splitlines() or [type(error).__name__])[0],
            "`malus run SUITE --out DIR` makes them",
        ) from None
    return Results(table, run)
