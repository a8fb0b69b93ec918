"""Results go to disk in pieces and come back as one."""

from __future__ import annotations

import io
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pandas as pd
import pyarrow.parquet as pq
import pytest
from rich.console import Console

from malus.bench import read_results, run
from malus.bench.commands import printing
from malus.bench.running.results import (
    Results,
    given_command,
    headline,
    origin,
    write_results,
    write_run,
    write_tables,
)
from malus.reports.tables import sample
from malus.scenes import Suite
from malus.scenes.core.result_files import HEADLINES, TABLE


def test_truths_of_two_renderers_can_be_told_apart(tmp_path: Path) -> None:
    """Their scenes have the same ids, so that joined tables need a column that says it."""
    common = {
        "name": "tiny",
        "description": "one sphere",
        "shapes": [{"kind": "sphere"}],
        "materials": ["pmma"],
        "surfaces": ["rubber"],
        "bodies": ["unpolarised"],
        "lights": [{"kind": "distant", "incidence_deg": 60}],
        "wavelengths_nm": [550],
        "methods": ["eq8"],
        "camera": {"resolution": 12},
        "sampling": {"samples": 4, "seed": 1},
    }
    tables = [
        run(Suite.parse(common | {"renderer": name}, name), tmp_path / name).table
        for name in ("mitsuba", "torrance-sparrow")
    ]
    joined = pd.concat(tables)
    assert joined.scene.nunique() == 1
    assert joined.groupby("renderer").size().to_dict() == {
        "mitsuba": len(tables[0]),
        "torrance-sparrow": len(tables[1]),
    }
    assert "renderer" in pd.read_csv(tmp_path / "mitsuba" / HEADLINES).columns


def test_pieces_come_back_as_one_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table, run = sample.table(), sample.run()
    at_once, pieces = tmp_path / "at once", tmp_path / "pieces"
    for folder in (at_once, pieces):
        folder.mkdir()
    write_results(at_once, Results(table, run))
    monkeypatch.setattr("malus.bench.running.results.GROUP_ROWS", 100)
    write_tables(pieces, (table.iloc[k : k + 30] for k in range(0, len(table), 30)))
    write_run(pieces, run)
    read = read_results(pieces).table
    pd.testing.assert_frame_equal(read.astype(table.dtypes), table.reset_index(drop=True))
    pd.testing.assert_frame_equal(read_results(pieces).table, read_results(at_once).table)
    assert (pieces / HEADLINES).read_bytes() == (at_once / HEADLINES).read_bytes()
    # 120 rows a group, as four pieces are the first to reach 100.
    assert pq.ParquetFile(pieces / TABLE).num_row_groups == -(-len(table) // 120)


def test_a_table_that_is_read_holds_every_name_once(tmp_path: Path) -> None:
    table = sample.table()
    many = pd.concat([table] * 100, ignore_index=True)
    write_results(tmp_path, Results(many, sample.run()))
    read = read_results(tmp_path).table
    numbers = many.select_dtypes("number").shape[1]
    texts = many.shape[1] - numbers
    # 8 bytes a number, a byte a name, and the names once; as text it is more than twice as much.
    size = read.memory_usage(deep=True, index=False).sum()
    assert size < 1.1 * len(many) * (8 * numbers + texts)
    assert many.memory_usage(deep=True, index=False).sum() > 2 * size


def test_memory_holds_a_group_of_tables_and_not_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("malus.bench.running.results.GROUP_ROWS", 100)
    piece = sample.table().head(30)
    alive = most = 0

    def gone() -> None:
        nonlocal alive
        alive -= 1

    def pieces() -> Iterator[pd.DataFrame]:
        nonlocal alive, most
        for _ in range(100):
            table = piece.copy()
            weakref.finalize(table, gone)
            alive += 1
            most = max(most, alive)
            yield table

    write_tables(tmp_path, pieces())
    # Four to a group, the next, and one that a loop variable still holds.
    assert most <= 6


def test_tables_that_end_in_an_error_leave_what_was_there(tmp_path: Path) -> None:
    write_tables(tmp_path, [sample.table().head(5)])

    def breaks() -> Iterator[pd.DataFrame]:
        yield sample.table()
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_tables(tmp_path, breaks())
    assert len(pd.read_parquet(tmp_path / TABLE)) == 5
    assert {path.name for path in tmp_path.iterdir()} == {TABLE, HEADLINES}


@pytest.mark.parametrize("method", ["shadowed+body", "my_own_method_" * 9, "方法" * 20])
def test_no_number_of_the_printed_table_is_cut(
    monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    """On 80 columns the names of lights and methods give way: half a number is none."""
    row: dict[str, Any] = {
        "light": "area 106.766° polarised 36.7486° to 0.912345",
        "body": "unpolarised",
        "method": method,
        "nmse_mean": 1.2e-11,
        "skill_median": -40.125,
        "skill_min": -1234.5,
        "skill_unmixed_median": 0.75,
        "without_skill": 0,
    }
    monkeypatch.setattr(printing, "headline", lambda _: [row])
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(printing.results_table(cast(Results, None)))
    text = console.export_text()
    for number in ("1.2e-11", "-40.125", "-1234.500", "0.750", method[:10], "unpolarised"):
        assert number in text
    assert "…" not in text


def test_scenes_that_are_in_no_median_are_told() -> None:
    """Two scenes a light: of each light one has no skill, for every method that was scored."""
    table = sample.table()
    scenes = table.groupby("light")["scene"].first()
    hidden = (table["metric"] == "skill") & table["scene"].isin(scenes)
    results = Results(table.assign(value=table["value"].mask(hidden)), sample.run())
    printed = " ".join(str(printing.results_table(results).caption).split())
    assert printed.startswith(f"{len(scenes)} scenes without a skill, in no median")
    assert printing.results_table(Results(table, sample.run())).caption is None


def test_a_scene_that_is_not_finite_is_not_one_without_a_skill() -> None:
    """Of six scenes one has an estimate that is no number, another a guess inside the noise."""
    table = sample.table()
    chosen = (table["method"] == "eq8") & (table["light"] == "uniform")
    broken, hidden, *_ = table.loc[chosen, "scene"].unique()
    lost = chosen & (table["scene"] == broken) & table["metric"].isin(["nmse", "skill"])
    lost |= chosen & (table["scene"] == hidden) & (table["metric"] == "skill")
    rows = headline(Results(table.assign(value=table["value"].mask(lost)), sample.run()))
    row = next(r for r in rows if (r["method"], r["light"]) == ("eq8", "uniform"))
    assert (row["scenes"], row["without_skill"]) == (6, 1)
    assert (row["nmse_mean"], row["skill_median"]) == (None, None)


@pytest.mark.parametrize(
    ("program", "wanted"),
    [
        ("/usr/bin/malus", {"command": "malus run 'my suite.toml' --samples 4"}),
        ("malus.exe", {"command": "malus run 'my suite.toml' --samples 4"}),
        ("/usr/bin/pytest", {}),
        ("", {}),
    ],
)
def test_the_command_is_recorded_where_malus_was_called(
    monkeypatch: pytest.MonkeyPatch, program: str, wanted: dict[str, str]
) -> None:
    monkeypatch.setattr("sys.argv", [program, "run", "my suite.toml", "--samples", "4"])
    assert given_command() == wanted
    assert origin().items() >= wanted.items()
