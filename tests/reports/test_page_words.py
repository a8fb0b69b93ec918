"""What a page says of metals, of estimates that are no numbers, and without a script."""

from __future__ import annotations

import html
import re
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from malus.reports import write_report
from malus.reports.tables import sample


def words(table: pd.DataFrame, folder: Path) -> str:
    """The text of the page of a table, without its scripts, styles and tags."""
    write_report(SimpleNamespace(table=table, run=sample.run()), folder)
    page = (folder / "report.html").read_text("utf-8")
    bare = re.sub(r"<(script|style)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", bare)).split())


@pytest.mark.parametrize(("body", "called"), [("none", "no body (metal)"), ("mixed", "mixed bodies")])
def test_a_body_that_is_none_is_not_called_a_none_body(
    table: pd.DataFrame, tmp_path: Path, body: str, called: str
) -> None:
    """As a column's value `none` is plain; "eq8, none body" is no English."""
    text = words(table.assign(body=body), tmp_path)
    assert f"Everything known to the methods; {called}." in text
    assert f"Figure 5, {called}" in text
    assert f"eq8, {called}" in text
    assert f"{body} body" not in text
    assert f"body {body}" not in text.lower()
