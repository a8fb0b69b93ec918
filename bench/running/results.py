"""The results of a run: its table and its record, as files that are written whole or not at all.

pandas is imported where there is a table: what scores makes none.
"""

from __future__ import annotations

import json
import math
import platform
import shlex
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from malus.bench.scoring.metric_value import MetricColumns, MetricValue, Place
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.errors import InputError, first_line
from malus.scenes.core.files import open_regular, write_text, write_whole
from malus.scenes.core.remote import as_path
from malus.scenes.core.result_files import HEADLINES, RUN, TABLE
from malus.scenes.core.versions import versions
from malus.scenes.scene import Scene

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Results:
    """A finished run: its table, and the record of how it came about.

    Attributes
    ----------
    table : DataFrame
        One row a scene × method × knowledge × metric; `band_nm` and `angle_deg` are missing where
        the value is over all bands and angles. Text columns of a table that was read are
        categories.
    run : dict
        Suite, versions, seeds, machine, seconds of every stage.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> options = {"resolution": 8, "samples": 2, "methods": ["eq8"], "report": False}
    >>> results = malus.run("quick", folder, **options)
    >>> results.headlines.query("metric == 'skill'").shape[0], results.run["suite"]["name"]
    (16, 'quick')
    """

    __repr__ = brief_repr

    table: pd.DataFrame
    run: dict[str, Any]

    @property
    def headlines(self) -> pd.DataFrame:
        """Rows over all bands and angles."""
        return headlines(self.table)


def headlines(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of a table over all bands and angles."""
    return table[table.band_nm.isna() & table.angle_deg.isna()]


def headline(results: Results) -> list[dict[str, Any]]:
    """NMSE and skill of every method, body and kind of light, as plain numbers.

    Skills are medians over scenes that have one, `skill_unmixed_median` over the pixels of one
    normal; `without_skill` counts those that the noise leaves without one. Where an estimate is
    not finite on any scene, neither error nor skill is a number: without it a method would seem
    better than it is.
    """
    table = results.headlines
    table = table[table.knowledge == "everything"]
    keys = ["body", "light", "method"]
    rows = []
    for group, part in table.groupby(keys, sort=False):
        nmse = part.value[part.metric == "nmse"]
        skill = part.value[part.metric == "skill"]
        unmixed = part.value[part.metric == "skill_unmixed"]
        if nmse.empty:
            continue
        broken = nmse.isna().any()
        rows.append(
            dict(zip(keys, group, strict=True))
            | {
                "nmse_mean": _or_none(nmse.mean(skipna=False)),
                "nmse_max": _or_none(nmse.max(skipna=False)),
                "skill_median": None if broken else _or_none(skill.median()),
                "skill_min": None if broken else _or_none(skill.min()),
                "skill_unmixed_median": None if broken else _or_none(unmixed.median()),
                "scenes": len(nmse),
                "without_skill": int(skill.isna().sum() - nmse.isna().sum()),
            }
        )
    return rows


def _or_none(value: Any) -> float | None:
    return None if math.isnan(value) else float(value)


class Record(NamedTuple):
    """Rows of the table that share all columns but those of a MetricValue."""

    common: Mapping[str, Any]
    values: MetricColumns


def record(
    scene_columns: Mapping[str, Any],
    method: str,
    values: Iterable[MetricValue] | MetricColumns,
    note: str = "",
    knowledge: str = "everything",
) -> Record:
    """Scores of one method on one scene; `scene_columns` are those of `describe`."""
    common = {**scene_columns, "method": method, "knowledge": knowledge, "note": note}
    return Record(common, values if isinstance(values, MetricColumns) else MetricColumns.of(values))


def inapplicable(
    scene_columns: Mapping[str, Any], method: str, reason: str, knowledge: str = "everything"
) -> Record:
    """One row that says why a method could not work on a scene."""
    return record(scene_columns, method, [MetricValue("inapplicable", 1.0)], reason, knowledge)


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
        "alpha": surface.isotropic_alpha,
        "body": surface.body,
        "light": light.label,
        "incidence_deg": getattr(light, "incidence_deg", None),
    }


_FLOATS = {"eta", "alpha", "incidence_deg"}


def table_of(records: Sequence[Record]) -> pd.DataFrame:
    """Records as a table with stable column types, also where a column is empty throughout.

    Examples
    --------
    >>> values = [MetricValue("nmse", 0.1), MetricValue("skill", 0.9)]
    >>> table = table_of([record({"scene": "a"}, "eq8", values)])
    >>> table.scene.tolist(), table.metric.tolist()
    (['a', 'a'], ['nmse', 'skill'])
    """
    import pandas as pd

    counts = [len(record.values.value) for record in records]
    columns: dict[str, Any] = {}
    for name in records[0].common:
        floats = "float64" if name in _FLOATS else None
        column = pd.Series([record.common[name] for record in records], dtype=floats)
        columns[name] = column.repeat(counts).array
    kinds = {record.values.places for record in records}
    by_kind = {places: _place_columns(places) for places in kinds}
    places = [by_kind[record.values.places] for record in records]
    for name in ("metric", "band_nm", "angle_deg"):
        columns[name] = np.concatenate([kind[name] for kind in places])
    columns["value"] = np.concatenate([record.values.value for record in records])
    columns["noise"] = np.concatenate([record.values.noise for record in records])
    return pd.DataFrame(columns)


def _place_columns(places: Sequence[Place]) -> dict[str, AnyArray]:
    """Columns that say what numbers are; a band or an angle that is None is missing."""
    metrics, bands, angles = ([place[column] for place in places] for column in range(3))
    return {
        "metric": np.array(metrics, dtype=object),
        "band_nm": np.array(bands, dtype=np.float64),
        "angle_deg": np.array(angles, dtype=np.float64),
    }


def write_results(out: Path, results: Results) -> None:
    """Write the table as Parquet, its headline rows as CSV, and run.json."""
    write_tables(out, [results.table])
    write_run(out, results.run)


def write_run(out: Path, run: dict[str, Any]) -> None:
    """Write run.json, the record of how results came about."""
    text = json.dumps(run, indent=2, sort_keys=True, allow_nan=False)
    write_text(out / RUN, text + "\n")


def origin() -> dict[str, Any]:
    """When, where, with which versions and by which command results were made, for `run.json`.

    Examples
    --------
    >>> sorted(set(origin()) - {"command"})
    ['finished', 'machine', 'versions']
    """
    return given_command() | {
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": versions("malus", "mitsuba", "drjit", "numpy", "scipy", "pandas"),
        "machine": {"system": platform.platform(), "processor": platform.machine()},
    }


def given_command() -> dict[str, str]:
    """The command line, as `command` of `run.json`; nothing where another program calls malus."""
    program, *arguments = sys.argv or [""]
    return {"command": shlex.join(["malus", *arguments])} if Path(program).stem == "malus" else {}


def write_tables(out: Path, tables: Iterable[pd.DataFrame]) -> None:
    """Write tables one after the other as one Parquet file, and their headline rows as CSV.

    Some `GROUP_ROWS` rows are in memory at a time, however many there are.
    """

    def write_both(parquet: Path) -> None:
        write_whole(out / HEADLINES, lambda csv: _stream(tables, parquet, csv))

    write_whole(out / TABLE, write_both)


def _stream(tables: Iterable[pd.DataFrame], parquet: Path, csv: Path) -> None:
    """Write tables as one Parquet file, and their headline rows as CSV."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet as pq

    with ExitStack() as stack:
        lines = stack.enter_context(csv.open("wb"))
        writer = None
        for table in _in_groups(tables):
            table.attrs = {}  # those of one family
            group = pa.Table.from_pandas(table, preserve_index=False)
            if writer is None:
                writer = stack.enter_context(pq.ParquetWriter(parquet, group.schema))
            writer.write_table(group.cast(writer.schema))
            rows = headlines(table).drop(columns=["band_nm", "angle_deg"])
            options = pyarrow.csv.WriteOptions(include_header=lines.tell() == 0)
            headline_rows = pa.Table.from_pandas(rows, preserve_index=False)
            pyarrow.csv.write_csv(headline_rows, lines, options)  # a tenth of the time of pandas


GROUP_ROWS = 100_000
"""Rows that are held before they are written: some 30 MB."""


def _in_groups(tables: Iterable[pd.DataFrame]) -> Iterator[pd.DataFrame]:
    """Join tables to some `GROUP_ROWS` rows: small groups would make a long index."""
    import pandas as pd

    waiting: list[pd.DataFrame] = []
    for table in tables:
        waiting.append(table)
        if sum(map(len, waiting)) >= GROUP_ROWS:
            yield pd.concat(waiting, ignore_index=True)
            waiting.clear()
    if waiting:
        yield pd.concat(waiting, ignore_index=True)


def read_results(folder: Path | str) -> Results:
    """Read the results of a finished run.

    Parameters
    ----------
    folder : path or URL of a folder

    Returns
    -------
    Results
        Its table and its record.

    Raises
    ------
    InputError
        If the folder holds none, or they cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> options = {"resolution": 8, "samples": 2, "methods": ["eq8"], "report": False}
    >>> written = malus.run("quick", folder, **options)
    >>> read_results(folder).run == written.run
    True
    """
    folder = as_path(folder) if isinstance(folder, str) else folder
    try:
        with open_regular(folder / TABLE) as file:
            table = _read_table(file)
        run = _checked(json.loads((folder / RUN).read_text("utf-8")))
    except Exception as error:  # also an InputError that names one file instead of the folder
        where, expected = f"results folder {folder}", f"{TABLE} and {RUN} of a finished run"
        hint = "`malus run` makes them"
        found = error.found if isinstance(error, InputError) else first_line(error)
        raise InputError(where, expected, found, hint) from None
    return Results(table, run)


def replaced_by(folder: Path, suite_id: str) -> str:
    """What a run of another suite, or at other sizes, left as results in a folder; empty: nothing.

    Its parts stay there, so that its command brings the results back.
    """
    try:
        run = _checked(json.loads((folder / RUN).read_text("utf-8")))
        earlier, size = run["suite"], run["suite"]["camera"]["resolution"]
        samples, seed = (earlier["sampling"][key] for key in ("samples", "seed"))
        methods = ", ".join(earlier["methods"])
    except Exception:  # no results of a run: there is nothing to bring back
        return ""
    if run.get("suite_id") == suite_id:
        return ""
    return f"{earlier['name']}: {size}² pixels, {samples} samples, seed {seed}, methods {methods}"


_COLUMNS = (
    "scene", "shape", "material", "eta", "surface", "alpha", "body", "light", "method", "knowledge",
    "note", "metric", "band_nm", "angle_deg", "value", "noise",
)  # fmt: skip
"""Columns that every table of results has."""

_PARTS = ("suite", "variant", "versions", "seconds", "machine")
"""Keys of a run's record whose values are objects."""


def _checked(run: Any) -> dict[str, Any]:
    """The record of a run; raises ValueError for another object."""
    is_whole = isinstance(run, dict) and all(isinstance(run.get(k, {}), dict) for k in _PARTS)
    if is_whole and isinstance(run.get("suite", {}).get("name"), str):
        return dict(run)
    raise ValueError(f"a {RUN} that is the record of something else")


def _read_table(parquet: BinaryIO) -> pd.DataFrame:
    """Read a table with its text as categories, few names many times: a fifth of the memory.

    Columns are read one after the other, so that one at most is held twice. Raises ValueError for
    another table.
    """
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields = pq.read_schema(parquet)
    missing = [name for name in _COLUMNS if name not in fields.names]
    if missing:
        raise ValueError(f"a table without {', '.join(missing)}")
    texts = [
        f.name for f in fields if pa.types.is_string(f.type) or pa.types.is_large_string(f.type)
    ]
    with pq.ParquetFile(parquet, read_dictionary=texts) as file:
        if file.metadata.num_rows == 0:
            raise ValueError("a table without rows")
        columns = {name: file.read([name]).column(0).to_pandas() for name in fields.names}
    return pd.DataFrame(columns, copy=False)
