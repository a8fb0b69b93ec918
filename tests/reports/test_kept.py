"""What a summary and a page both show is computed once."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from malus.reports.tables import rows, sample, skills
from malus.reports.write import write_report


def test_a_report_computes_its_table_of_errors_once_and_the_next_one_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def overall_rows(table: pd.DataFrame, metric: str) -> pd.DataFrame:
        asked.append(metric)
        return rows.overall_rows(table, metric)

    monkeypatch.setattr(skills, "overall_rows", overall_rows)
    results = SimpleNamespace(table=sample.table(), run=sample.run())
    write_report(results, tmp_path)
    of_errors = "skill_unmixed"  # which nothing else in that module asks for
    assert asked.count(of_errors) == 1
    before = (tmp_path / "errors.csv").read_text("utf-8")
    results.table.loc[results.table["metric"] == "nmse", "value"] *= 2
    write_report(results, tmp_path)
    assert asked.count(of_errors) == 2
    assert (tmp_path / "errors.csv").read_text("utf-8") != before
