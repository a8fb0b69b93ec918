"""The results of a run as files: one table and one JSON; written whole or not at all."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pandas as pd

from malus.bench.scoring.judge import Value
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import open_regular, write_whole
from malus.scenes.core.result_files import HEADLINES, RUN, TABLE
from malus.scenes.scene import Scene

GROUP_ROWS = 100_000
"""Rows that are held before they are written: some 30 MB."""


def headlines(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of a table over all bands and angles."""
    return table[table.band_nm.isna() & table.angle_deg.isna()]


def stream(tables: Iterable[pd.DataFrame], parquet: Path, csv: Path) -> None:
    """Write tables as one Parquet file, and their headline rows as CSV."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    with ExitStack() as stack:
        lines = stack.enter_context(csv.open("w", encoding="utf-8", newline=""))
        writer = None
        for table in _groups(tables):
            table.attrs = {}  # those of one family
            group = pa.Table.from_pandas(table, preserve_index=False)
            if writer is None:
                writer = stack.enter_context(pq.ParquetWriter(parquet, group.schema))
            writer.write_table(group.cast(writer.schema))
            rows = headlines(table).drop(columns=["band_nm", "angle_deg"])
            rows.to_csv(lines, index=False, header=lines.tell() == 0)


def read_compact(parquet: BinaryIO) -> pd.DataFrame:
    """A table whose text is categories: few names, many times; a fifth of the memory.

    Columns are read one after the other, so that one at most is held twice.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = pq.read_schema(parquet)
    texts = [
        f.name for f in fields if pa.types.is_string(f.type) or pa.types.is_large_string(f.type)
    ]
    with pq.ParquetFile(parquet, read_dictionary=texts) as file:
        columns = {name: file.read([name]).column(0).to_pandas() for name in fields.names}
    return pd.DataFrame(columns, copy=False)


def _groups(tables: Iterable[pd.DataFrame]) -> Iterator[pd.DataFrame]:
    """Tables joined to some `GROUP_ROWS` rows: small groups would make a long index."""
    waiting: list[pd.DataFrame] = []
    for table in tables:
        waiting.append(table)
        if sum(map(len, waiting)) >= GROUP_ROWS:
            yield pd.concat(waiting, ignore_index=True)
            waiting.clear()
    if waiting:
        yield pd.concat(waiting, ignore_index=True)


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


def headline(results: Results) -> list[dict[str, Any]]:
    """NMSE and skill of every method, body and kind of light, as plain numbers.

    Skill is the median over scenes that have one; `without_skill` counts the others.
    """
    table = results.headlines
    table = table[table.knowledge == "everything"]
    keys = ["body", "light", "method"]
    rows = []
    for group, part in table.groupby(keys, sort=False):
        nmse = part.value[part.metric == "nmse"]
        skill = part.value[part.metric == "skill"]
        if nmse.empty:
            continue
        rows.append(
            dict(zip(keys, group, strict=True))
            | {
                "nmse_mean": float(nmse.mean()),
                "nmse_max": float(nmse.max()),
                "skill_median": _or_none(skill.median()),
                "skill_min": _or_none(skill.min()),
                "scenes": len(nmse),
                "without_skill": int(skill.isna().sum()),
            }
        )
    return rows


def _or_none(value: Any) -> float | None:
    return None if pd.isna(value) else float(value)
