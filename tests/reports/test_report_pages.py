"""Reports of runs and studies: written whole, names escaped, and each section where it belongs."""

from __future__ import annotations

import base64
import json
import math
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import numpy as np
import pandas as pd
import pytest
from jinja2 import UndefinedError
from markupsafe import escape

from malus.reports import write_report
from malus.reports.figures.figure5 import figure5, figure5_by_light
from malus.reports.figures.style import svg
from malus.reports.sections import made_by, of_run, of_study
from malus.reports.source import Source, read_study
from malus.reports.summary import summary
from malus.reports.tables import sample
from malus.reports.tables.figure_numbers import numbers
from malus.reports.tables.formats import markdown
from malus.reports.tables.text_tables import savings
from malus.reports.templates.render import asset, render
from malus.reports.write import write_study
from malus.scenes.core.errors import InputError, printable

HOSTILE = "<script>alert(1)</script> $x^2$ & \"'|`*_ \U00013000"


@pytest.mark.parametrize("column", ["material", "surface", "light", "method", "shape"])
def test_names_are_text_whatever_they_contain(table: pd.DataFrame, column: str) -> None:
    table[column] = table[column].where(table[column] != table[column].iloc[0], HOSTILE)
    for draw in (figure5, figure5_by_light):
        root = ET.fromstring(svg(draw(table, "unpolarised")))
        assert not list(root.iter("{http://www.w3.org/2000/svg}script"))
    text = summary(table, sample.run())
    assert "<script>" not in text


def test_names_are_escaped_everywhere() -> None:
    assert markdown("a|b") == "a\\|b"
    assert markdown("# a_b\n") == "\\# a_b\\\\n"


def test_values_of_templates_are_escaped_and_none_may_be_missing() -> None:
    values = {"tiles": [], "lines": [], "drawings": [], "origin": ""}
    text = render("figures.html", explanation="<b> & \"'\n\udc80", **values)
    assert text == "<p>&lt;b&gt; &amp; &#34;&#39;\\n\\udc80</p>"
    with pytest.raises(UndefinedError, match="explanation"):
        render("figures.html", **values)


def test_the_page_names_the_papers_method_where_it_was_run(
    table: pd.DataFrame, tmp_path: Path
) -> None:
    without = table[table.method != "eq8"]
    assert len(without)
    for rows, named in ((table, True), (without, False)):
        first = of_run(Source(rows, sample.run(), tmp_path, ()))[0]
        assert first.name == "headline"
        assert ("eq8" in first.content) == named
        assert "mean NMSE of the trivial guess I(ϑ) = I/2 by material" in first.content


def test_a_page_has_the_command_and_links_the_data_set(tmp_path: Path) -> None:
    run = sample.run() | {"command": "malus score 'a <b>'", "dataset": {"folder": str(tmp_path)}}
    page = made_by(run)
    assert "<code>malus score &#39;a &lt;b&gt;&#39;</code>" in page
    assert f'<a href="{tmp_path.as_uri()}">{tmp_path}</a>' in page
    address = "https://example.org/data"
    assert f'<a href="{address}">' in made_by({"dataset": {"folder": address}})
    for elsewhere in ("s3://bucket/data", "gone", "javascript://x"):
        assert "<a" not in made_by({"dataset": {"folder": elsewhere}})
    assert made_by(sample.run()) == ""  # of an older malus


def test_the_page_says_what_the_plan_saved(table: pd.DataFrame, tmp_path: Path) -> None:
    lines = savings(sample.run()["plan"]).lines
    assert [line[:3] for line in lines] == [
        ["polariser images", "240 of 1,200", "960"],
        ["specular images", "30 of 210", "180"],
        ["shadow rays", "0 of 4", "only rays"],
    ]
    sections = of_run(Source(table, sample.run(), tmp_path, ()))
    (plan,) = [section.content for section in sections if section.name == "plan"]
    assert "60 of 1,200" in plan
    run = sample.run()
    del run["plan"]  # of an older malus
    names = [section.name for section in of_run(Source(table, run, tmp_path, ()))]
    assert "plan" not in names


def a_study(folder: Path, **tables: pd.DataFrame) -> None:
    folder.mkdir()
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
    run = {name: sample.run()[name] for name in ("versions", "machine", "finished")}
    run |= {"study": HOSTILE, "description": HOSTILE}
    (folder / "run.json").write_text(json.dumps(run), "utf-8")


def precision_table() -> pd.DataFrame:
    points = [("slow", 2.0, 1e-6, True), ("fast", 1e-3, 1e-2, True), ("neither", 3.0, 1e-1, False)]
    rows = [
        {"diagram": HOSTILE, "method": "a", "setting": setting, "seconds": seconds, "spread": 0.1,
         "unit": "an image", "error": error, "pareto": front}
        for setting, seconds, error, front in points
    ]  # fmt: skip
    return pd.DataFrame(rows)


def stress_table() -> pd.DataFrame:
    return pd.DataFrame(
        {
            "group": ["rho", "rho", "image"], "case": ["90°", HOSTILE, "black"],
            "value": [0.5, 0.1, math.nan], "error": [1e-11, 3e-4, math.nan],
            "seconds": [1e-3, 2e-3, 3e-3], "passed": [True, False, True],
            "why": ["", "error above 1e-08", ""],
        }
    )  # fmt: skip


def test_a_study_has_a_page_and_its_figure(tmp_path: Path) -> None:
    a_study(tmp_path / "precision", precision=precision_table())
    written = {path.name for path in write_study(tmp_path / "precision")}
    assert written == {"precision.svg", "precision.csv", "report.html"}
    assert tmp_path / "precision" / "precision.png" in write_study(tmp_path / "precision", png=True)
    pd.testing.assert_frame_equal(
        pd.read_csv(tmp_path / "precision" / "precision.csv"), precision_table()
    )
    text = (tmp_path / "precision" / "report.html").read_text("utf-8")
    assert "<script>alert" not in text
    for cell in ("fast", "1.0e-3 ± 1.0e-1", "on the front"):
        assert cell in text


def test_stress_names_what_failed_and_counts_every_group(tmp_path: Path) -> None:
    a_study(tmp_path / "stress", stress=stress_table())
    (section,) = of_study(read_study(tmp_path / "stress"))
    assert "3 cases, 1 failed." in section.content
    assert escape(printable(HOSTILE)) in section.content
    row = '<th scope="row">rho</th><td>2</td><td>1</td><td>3.0e-4</td>'
    assert row in section.content


def test_a_run_shows_the_studies_that_it_is_given(table: pd.DataFrame, tmp_path: Path) -> None:
    a_study(tmp_path / "stress", stress=stress_table())
    source = Source(table, sample.run(), tmp_path, (), (), (tmp_path / "stress",))
    names = [section.name for section in of_run(source)]
    assert names[-2:] == ["stress", "provenance"]


def test_what_is_no_study_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"run\.json: expected how a study came about"):
        read_study(tmp_path)
    a_study(tmp_path / "bad", stress=stress_table().drop(columns="why"))
    with pytest.raises(InputError, match=r"stress\.csv: expected columns group"):
        read_study(tmp_path / "bad")


def test_report_is_written_whole(table: pd.DataFrame, tmp_path: Path) -> None:
    results = SimpleNamespace(table=table, run=sample.run())
    written = write_report(results, tmp_path / "report")
    assert sorted(written) == sorted((tmp_path / "report").iterdir())
    assert all(path.stat().st_size > 100 for path in written)
    behind = pd.read_csv(tmp_path / "report" / "figure5.csv")
    eta = numbers(table, "eta")
    np.testing.assert_allclose(behind.loc[behind["panel"] == "eta", "mean"], eta["mean"])


def test_files_are_the_same_whatever_was_imported(table: pd.DataFrame, tmp_path: Path) -> None:
    """Tables had 12 digits where colour-science had been imported, which sets NumPy to these."""
    results = SimpleNamespace(table=table.assign(value=table["value"] / 3), run=sample.run())
    plain = {path.name: path.read_bytes() for path in write_report(results, tmp_path / "plain")}
    with np.printoptions(legacy="1.13"):
        written = write_report(results, tmp_path / "other")
    assert {path.name: path.read_bytes() for path in written} == plain
    behind = pd.read_csv(tmp_path / "other" / "figure5.csv")
    eta = numbers(results.table, "eta")
    np.testing.assert_array_equal(behind.loc[behind["panel"] == "eta", "mean"], eta["mean"])


def test_a_report_keeps_nothing_of_an_earlier_one(table: pd.DataFrame, tmp_path: Path) -> None:
    """Table I and Figure 9 of a run with colours stood beside the page of one without."""
    results = SimpleNamespace(table=table, run=sample.run())
    for name in ("table1.csv", "figure9.svg", "figure9_polarised_body.csv"):
        (tmp_path / name).write_text("of an earlier run", "utf-8")
    mine = {"figure9_of_mine.svg", "table2.csv", "results.csv", "notes.md"}
    for name in mine:
        (tmp_path / name).write_text("mine", "utf-8")
    assert any(path.suffix == ".png" for path in write_report(results, tmp_path, png=True))
    written = {path.name for path in write_report(results, tmp_path)}
    assert {path.name for path in tmp_path.iterdir()} == written | mine
    a_study(tmp_path / "study", precision=precision_table())
    write_study(tmp_path / "study", png=True)
    write_study(tmp_path / "study")
    assert not list((tmp_path / "study").glob("*.png"))


def test_a_report_of_any_body_leaves_no_file_to_the_next(
    table: pd.DataFrame, tmp_path: Path
) -> None:
    """Figures of metals stood for ever beside the page of dielectrics."""
    run, bodies = sample.run(), ("polarised", "none", "mixed", "unknown")
    every = [table.assign(body=body, scene=table["scene"] + body) for body in bodies]
    write_report(SimpleNamespace(table=pd.concat(every, ignore_index=True), run=run), tmp_path)
    written = {path.name for path in write_report(SimpleNamespace(table=table, run=run), tmp_path)}
    assert {path.name for path in tmp_path.iterdir()} == written


def test_the_viewers_colour_maps_are_those_of_matplotlib() -> None:
    tables = json.loads(asset("colour_maps.json"))
    for name, theirs in (
        ("diverging", "RdBu_r"), ("sequential", "cividis"), ("cyclic", "twilight"),
    ):  # fmt: skip
        stored = np.frombuffer(base64.b64decode(tables[name]), np.uint8).reshape(256, 3)
        expected = 255 * matplotlib.colormaps[theirs](np.linspace(0.0, 1.0, 256))[:, :3]
        np.testing.assert_array_equal(stored, np.rint(expected))
