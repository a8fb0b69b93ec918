"""The page `files.md`: it has exactly the columns, metrics, files and keys that there are."""

from __future__ import annotations

import contextlib
import json
import os
import re
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
from documents import FILES, execute

from malus.bench import read_results
from malus.bench.scoring.extra_metrics import METRICS
from malus.reports import write_report
from malus.reports.tables import sample
from malus.scenes import load_suite
from malus.scenes.suite import Suite


def section(document: Path, heading: str) -> str:
    text = document.read_text("utf-8")
    found = re.search(rf"^(#+) {re.escape(heading)}$(.*?)(?=^##? |^### |\Z)", text, re.M | re.S)
    assert found, f"{document.name} has no section {heading}"
    return found[2]


def first_cells(text: str) -> list[str]:
    """Code spans in the first column of the tables of a section."""
    rows = re.findall(r"^\|([^|]*)\|", text, re.MULTILINE)
    return [span for row in rows for span in re.findall(r"`([^`]+)`", row)]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with every further metric, and its report."""
    folder = tmp_path_factory.mktemp("finished")
    suite = load_suite("quick").model_dump(mode="json") | {"metrics": list(METRICS)}
    suite |= {"bodies": ["unpolarised"], "materials": ["water"], "surfaces": ["carbon"]}
    suite["camera"]["resolution"], suite["sampling"]["samples"] = 12, 4
    from malus.bench import run

    write_report(run(Suite.parse(suite, "test"), folder), folder)
    return folder


def test_files_md_has_exactly_the_columns(finished: Path) -> None:
    table = read_results(finished).table
    assert first_cells(section(FILES, "Columns of the results table")) == list_in_order(table)
    headlines = pd.read_csv(finished / "results.csv")
    assert set(table.columns) - set(headlines.columns) == {"band_nm", "angle_deg"}


def list_in_order(table: pd.DataFrame) -> list[str]:
    """Columns as the page groups them; a column that it lacks comes last and fails the test."""
    page = first_cells(section(FILES, "Columns of the results table"))
    return sorted(table.columns, key=lambda name: page.index(name) if name in page else 99)


def test_files_md_has_every_column_of_the_reports_tables(tmp_path: Path) -> None:
    """Those of errors.csv stood nowhere but in a docstring."""
    below = sample.laddered().query("knowledge != 'everything'")
    table = pd.concat([sample.coloured(), below], ignore_index=True)
    write_report(SimpleNamespace(table=table, run=sample.run()), tmp_path)
    written = {column for path in tmp_path.glob("*.csv") for column in pd.read_csv(path).columns}
    page = first_cells(section(FILES, "Columns of the report's tables"))
    assert set(page) - {"column"} == written - {"body", "light", "method"}


def test_files_md_has_every_metric(finished: Path) -> None:
    table = read_results(finished).table
    text = section(FILES, "Metrics")
    assert set(METRICS) <= set(first_cells(text))
    endings = ("_std", "_i_max", "_i_min")
    for name in table.metric.unique():
        bare = re.sub(r"_\d+_\d+$", "_<from>_<to>", name)
        for ending in endings:
            bare = bare.removesuffix(ending)
        assert f"`{bare}`" in text, f"files.md has no metric {name}"


def test_files_md_has_every_file_of_a_run(finished: Path) -> None:
    text = section(FILES, "A run")
    for path in finished.iterdir():
        name = path.name.replace("_polarised_body", "")
        stem, ending = os.path.splitext(name)
        known = f"`{name}`" in text or f"`{name}/" in text
        known = known or (f"`{stem}.svg`" in text and ending in (".svg", ".png", ".csv"))
        assert known, f"files.md has no {path.name}"
    assert set(json.loads((finished / "run.json").read_text("utf-8"))) == set(
        first_cells(section(FILES, "run.json"))
    )


def test_files_md_has_every_file_of_a_scene(tmp_path: Path) -> None:
    folder = tmp_path / "quick-dataset"
    with contextlib.chdir(tmp_path):
        execute("malus render quick --out quick-dataset")
    scene = next(path for path in folder.iterdir() if path.is_dir())
    # Only where a suite asks for them, and where arrays are in double precision.
    asked_for = {"float64.exr", "maps.exr", "raw.tiff", "sensor.exr"}
    named = first_cells(section(FILES, "A dataset"))
    assert {path.name for path in scene.iterdir()} == set(named) - asked_for


def test_files_md_has_every_key_of_a_suite() -> None:
    assert set(first_cells(section(FILES, "A suite"))) == set(Suite.model_fields)
