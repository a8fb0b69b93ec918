"""What a page says of metals, of estimates that are no numbers, and without a script."""

from __future__ import annotations

import html
import io
import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest
from browser import Browser
from rich.console import Console

from malus.bench.commands.printing import plain_table
from malus.reports import write_report
from malus.reports.tables import sample, text_tables
from malus.reports.tables.compared_runs import means_table
from malus.reports.tables.figure_numbers import both_panels
from malus.reports.tables.headline import headline_tiles
from malus.reports.tables.sentences import doubts


def words(table: pd.DataFrame, folder: Path) -> str:
    """The text of the page of a table, without its scripts, styles and tags."""
    write_report(SimpleNamespace(table=table, run=sample.run()), folder)
    page = (folder / "report.html").read_text("utf-8")
    bare = re.sub(r"<(script|style)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", bare)).split())


@pytest.mark.parametrize(
    ("body", "called"), [("none", "no body (metal)"), ("mixed", "mixed bodies")]
)
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


def test_an_estimate_that_is_not_finite_has_no_dash_for_its_error(
    table: pd.DataFrame, tmp_path: Path
) -> None:
    """A dash stands where nothing was scored or the noise hides a skill: neither is so here."""
    errors = table["metric"].isin(["nmse", "skill"]) & (table["method"] == "eq8")
    table.loc[errors, "value"] = math.nan
    lines = [line for line in text_tables.errors(table).lines if line[2] == "eq8"]
    assert {tuple(line[4:6]) for line in lines} == {("not finite", "not finite")}
    ranges = [line[2:5] for line in text_tables.beside_paper(table).lines if line[1] == "eq8"]
    assert ranges == [["not finite"] * 3] * len(ranges)
    behind = text_tables.by_method(both_panels(table))
    column = behind.heads.index("eq8")
    assert {line[column] for line in behind.lines} == {"not finite"}
    assert "– ± –" not in words(table, tmp_path)


def test_runs_side_by_side_fit_a_terminal_of_80_columns(table: pd.DataFrame) -> None:
    """A number that goes on in the next line reads as another number."""
    names = ["results/before", "results/after", "results/another"]
    runs = [SimpleNamespace(table=table, run=sample.run()) for _ in names]
    means = means_table(names, runs)
    shown = plain_table(*means.heads)
    for line in means.lines:
        shown.add_row(*line)
    console = Console(width=80, file=io.StringIO())
    console.print(shown)
    printed = console.file.getvalue()
    assert all(cell in printed for line in means.lines for cell in line)


def test_the_guess_has_a_tile_of_its_own_words(table: pd.DataFrame) -> None:
    """It stood behind the noise as "the same": a reader took it for the noise of the guess."""
    tiles = {label: number for number, label in headline_tiles(table, pd.DataFrame(), "sample")}
    rows = table[(table["metric"] == "nmse") & (table["body"] == "unpolarised")]
    rows = rows[rows["band_nm"].isna() & rows["angle_deg"].isna()]
    means = rows[rows["method"] == "unpolarised"].groupby("material")["value"].mean()
    guess = tiles["mean NMSE of the trivial guess I(ϑ) = I/2 by material"]
    least, most = (float(number) for number in guess.split(" … "))
    # Two digits are shown.
    assert (least, most) == pytest.approx((means.min(), means.max()), rel=0.05)


def test_one_surface_makes_no_range(table: pd.DataFrame) -> None:
    one = table[table["surface"] == table["surface"].iloc[0]]
    labels = [label for _, label in headline_tiles(one, pd.DataFrame(), "sample")]
    assert any("by material" in label for label in labels)
    assert not any("by surface" in label for label in labels)


def test_one_roughness_value_is_doubted_in_the_singular(table: pd.DataFrame) -> None:
    one = table[table["surface"] == "carbon"]
    (doubt,) = doubts(one)
    assert "them" not in doubt
    assert "they" not in doubt
    assert doubt.startswith("The roughness value of carbon is an unverified stand-in")


def test_without_a_script_the_page_says_so_and_stays_legible(
    report: Path, tmp_path: Path, browser: Browser
) -> None:
    """Dead buttons and empty panels tell nobody why; dark colours came without their links' one."""
    page = tmp_path / "page.html"
    page.write_text(re.sub(r"<script>.*?</script>", "", report.read_text("utf-8"), flags=re.DOTALL))
    cdp = browser.driver.execute_cdp_cmd
    try:
        cdp("Emulation.setScriptExecutionDisabled", {"value": True})
        features = [{"name": "prefers-color-scheme", "value": "dark"}]
        cdp("Emulation.setEmulatedMedia", {"features": features})
        browser.driver.get(page.as_uri())
        seen = browser.driver.find_element("id", "look").text
        assert "needs JavaScript" in seen
        assert "Exposure" not in seen
        link = browser.driver.find_element("css selector", "nav a")
        body = browser.driver.find_element("tag name", "body")
        pair = (rgb(link, "color"), rgb(body, "background-color"))
    finally:
        cdp("Emulation.setScriptExecutionDisabled", {"value": False})
        cdp("Emulation.setEmulatedMedia", {"features": []})
    assert contrast(*pair) >= 4.5  # WCAG 2.1, level AA


def rgb(element: Any, name: str) -> list[float]:
    """Red, green and blue of a colour of an element, 0 to 255."""
    return [float(part) for part in re.findall(r"[0-9.]+", element.value_of_css_property(name))[:3]]


def contrast(first: list[float], second: list[float]) -> float:
    """Contrast of two colours as WCAG 2.1 defines it."""
    light, dark = sorted(map(luminance, (first, second)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def luminance(colour: list[float]) -> float:
    """Relative luminance of a colour of sRGB."""
    codes = [part / 255 for part in colour]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in codes]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_error_maps_stand_under_their_heads_whatever_is_written_beside_them(
    browser: Browser, report: Path
) -> None:
    """A name or number that is long pushed the images from their heads, and out of the page."""
    browser.open(report)
    apart = browser.js("""
        const table = document.querySelector(".error-maps table");
        table.querySelector("tbody th").textContent = "a_method".repeat(20);
        table.querySelector("tbody span").textContent = "4.33 ± 0.76, 222 pixels not finite";
        const middle = (e) => { const b = e.getBoundingClientRect(); return b.left + b.width / 2; };
        const heads = [...table.querySelectorAll("thead th")];
        const images = [...table.querySelectorAll("tbody tr:first-child img")];
        return [images[0].getBoundingClientRect().right,
                Math.max(...images.map((image, k) => Math.abs(middle(image) - middle(heads[k]))))];
    """)
    assert apart[0] < 1280 / 2
    assert apart[1] < 5  # cells have 8 pixels of room on their right, heads 12


def test_seconds_of_the_study_stress_are_no_powers_of_ten() -> None:
    cases = pd.DataFrame({"group": ["rho"], "passed": [True], "error": [0.0], "seconds": [0.4812]})
    assert text_tables.stress_groups(cases).lines[0][-1] == "0.48"
