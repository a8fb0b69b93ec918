"""Figures and summary: the numbers that they show are those of the table."""

from __future__ import annotations

import base64
import json
import math
import statistics
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
import pytest
from jinja2 import UndefinedError
from markupsafe import escape
from scipy.optimize import isotonic_regression

from malus.reports import write_report
from malus.reports.figures.drawings import drawings, ladders
from malus.reports.figures.figure5 import figure5, figure5_by_light
from malus.reports.figures.figure9 import figure9
from malus.reports.figures.ladder import figure_ladder
from malus.reports.figures.panels import spread
from malus.reports.figures.style import png, svg
from malus.reports.sections import made_by, of_run, of_study
from malus.reports.source import Source, read_study
from malus.reports.summary import summary
from malus.reports.tables import sample
from malus.reports.tables.colour_errors import figure9_numbers, table1, table1_text
from malus.reports.tables.figure_numbers import both_panels, ladder_numbers, numbers
from malus.reports.tables.formats import markdown
from malus.reports.tables.headline import headline_tiles
from malus.reports.tables.rows import coverage
from malus.reports.tables.skills import (
    by_light_and_body,
    median_skills,
    negative_skills,
    unreported_skills,
)
from malus.reports.tables.text_tables import savings
from malus.reports.templates.render import asset, render
from malus.reports.write import write_study
from malus.scenes.core.errors import InputError, printable

SVG = "{http://www.w3.org/2000/svg}"
HOSTILE = "<script>alert(1)</script> $x^2$ & \"'|`*_ \U00013000"


@pytest.fixture
def table() -> pd.DataFrame:
    return sample.table()


def headline(table: pd.DataFrame, metric: str, **where: Any) -> list[float]:
    """Values over all bands and angles, by going through the rows one by one."""
    return [
        row["value"]
        for row in table.to_dict("records")
        if row["metric"] == metric
        and math.isnan(row["band_nm"])
        and math.isnan(row["angle_deg"])
        and all(row[name] == value for name, value in where.items())
    ]


def with_skill(table: pd.DataFrame, value: float, **where: Any) -> pd.DataFrame:
    chosen = table["metric"] == "skill"
    for name, wanted in where.items():
        chosen &= table[name] == wanted
    return table.assign(value=table["value"].mask(chosen, value))


@pytest.mark.parametrize(("x", "name"), [("eta", "material"), ("alpha", "surface")])
def test_means_and_deviations_equal_an_independent_computation(
    table: pd.DataFrame, x: str, name: str
) -> None:
    table.loc[table["shape"] == "sphere", "value"] *= np.linspace(1, 2, len(table))
    rows = numbers(table, x).to_dict("records")
    assert len(rows) == 3 * table[name].nunique()
    for row in rows:
        values = headline(table, "nmse", method=row["method"], **{name: row["name"]})
        assert row["mean"] == pytest.approx(statistics.fmean(values), rel=1e-12)
        assert row["std"] == pytest.approx(statistics.pstdev(values), rel=1e-9)
        assert row["scenes"] == len(values)


def test_the_lines_that_are_drawn_are_those_numbers(table: pd.DataFrame) -> None:
    axes = figure5(table, "unpolarised").axes
    for ax, x in zip(axes, ("eta", "alpha"), strict=True):
        values = numbers(table, x)
        for line, method in zip(ax.get_lines(), ("unpolarised", "eq8"), strict=False):
            wanted = values.loc[values["method"] == method, "mean"]
            np.testing.assert_array_equal(line.get_ydata(), wanted)


def test_error_bars_end_at_mean_plus_and_minus_deviation(table: pd.DataFrame) -> None:
    ax = figure5(table, "unpolarised").axes[1]
    values = numbers(table, "alpha")
    eq8 = values[values["method"] == "eq8"]
    bars = ax.collections[2].get_segments()  # two collections a method: whole and endless bars
    np.testing.assert_allclose([b[0][1] for b in bars], eq8["mean"] - eq8["std"], rtol=1e-12)
    np.testing.assert_allclose([b[1][1] for b in bars], eq8["mean"] + eq8["std"], rtol=1e-12)


def test_a_bar_that_ends_below_zero_runs_off_the_logarithmic_axis(table: pd.DataFrame) -> None:
    table.loc[table["scene"] == f"{0:016x}", "value"] *= 1000
    values = numbers(table, "alpha").query("method == 'eq8'")
    endless = values["mean"] < values["std"]
    assert endless.any()
    ax = figure5(table, "unpolarised").axes[1]
    assert len(ax.collections[3].get_segments()) == endless.sum()
    assert all(b[0][1] < ax.get_ylim()[0] for b in ax.collections[3].get_segments())


def test_errors_below_the_axis_are_named(table: pd.DataFrame) -> None:
    tiny = table["method"] == "half_vector"
    table.loc[tiny & (table["metric"] == "nmse"), "value"] = 3e-17
    ax = figure5(table, "unpolarised").axes[0]
    assert ax.get_ylim()[0] > 1e-9
    assert any("half_vector: 3.0e-17" in text.get_text() for text in ax.texts)


def test_by_light_shows_every_light_for_itself(table: pd.DataFrame) -> None:
    values = numbers(table, "eta", by_light=True)
    for row in values.to_dict("records"):
        where = {"method": row["method"], "material": row["name"], "light": row["light"]}
        assert row["mean"] == pytest.approx(statistics.fmean(headline(table, "nmse", **where)))
    titles = [ax.get_title("left") for ax in figure5_by_light(table, "unpolarised").axes]
    assert titles[:2] == ["uniform", "distant 60°"]


def test_legend_says_which_lights_a_partial_mean_covers(table: pd.DataFrame) -> None:
    figure = figure5(table, "unpolarised")
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "half_vector: only distant 60°" in labels
    assert "eq8" in labels


def with_own_range(table: pd.DataFrame) -> pd.DataFrame:
    """The table with errors in each image's own range: a thousand times the others."""
    errors = table[table["metric"] == "nmse"]
    second = errors.assign(metric="nmse_own_range", value=1e3 * errors["value"], noise=math.nan)
    return pd.concat([table, second[second["angle_deg"].isna()]], ignore_index=True)


def test_the_likeliest_reading_is_a_second_curve(table: pd.DataFrame) -> None:
    plain, both = both_panels(table), both_panels(with_own_range(table))
    # What was there stays, line by line; the second curve follows.
    pd.testing.assert_frame_equal(both.iloc[: len(plain)], plain, check_dtype=False)
    second = both.iloc[len(plain) :]
    assert set(second["method"]) == {"eq8, each image to [0, 1] by its own range"}
    eq8 = plain[plain["method"] == "eq8"]
    np.testing.assert_allclose(second["mean"], 1e3 * eq8["mean"], rtol=1e-12)
    for draw, by_light in ((figure5, False), (figure5_by_light, True)):
        figure = draw(with_own_range(table), "unpolarised")
        labels = [" ".join(text.get_text().split()) for text in figure.legends[0].get_texts()]
        assert labels[-1] == "eq8, each image to [0, 1] by its own range"
        values = both_panels(with_own_range(table), by_light)["mean"]
        assert all(ax.get_ylim()[1] >= values.max() for ax in figure.axes)
        lines = [line for line in figure.axes[0].get_lines() if line.get_marker() == "*"]
        assert len(lines) == 1
    assert not any(
        line.get_marker() == "*" for line in figure5(table, "unpolarised").axes[0].get_lines()
    )


def test_coverage_of_part_of_a_light(table: pd.DataFrame) -> None:
    first = table["scene"] == f"{0:016x}"
    covered = coverage(table[~(first & (table["metric"] == "nmse"))], "eq8")
    assert (covered.partial_lights, covered.missing_lights) == (("uniform",), ())
    assert str(covered) == "only distant 60°, part of uniform"


def test_bodies_are_never_averaged_together(table: pd.DataFrame) -> None:
    other = table.assign(body="polarised", value=table["value"] * 100, scene=table["scene"] + "b")
    both = pd.concat([table, other])
    line = figure5(both, "unpolarised").axes[0].get_lines()[1]
    alone = figure5(table, "unpolarised").axes[0].get_lines()[1]
    np.testing.assert_array_equal(line.get_ydata(), alone.get_ydata())


def test_figures_are_well_formed_reproducible_and_keep_text_as_text(table: pd.DataFrame) -> None:
    text = svg(figure5(table, "unpolarised"))
    assert text == svg(figure5(table, "unpolarised"))
    root = ET.fromstring(text)
    words = " ".join("".join(element.itertext()) for element in root.iter(f"{SVG}text"))
    assert "refractive index η" in words
    assert "range of the paper’s Figure 5" in words
    assert "date" not in text.lower().split("<defs>")[0]


def test_png_has_200_dots_an_inch(table: pd.DataFrame) -> None:
    data = png(figure5(table, "unpolarised"))
    width = int.from_bytes(data[16:20], "big")  # PNG header: width at byte 16
    assert width == round(7.1 * 200)


@pytest.mark.parametrize("column", ["material", "surface", "light", "method", "shape"])
def test_names_are_text_whatever_they_contain(table: pd.DataFrame, column: str) -> None:
    table[column] = table[column].where(table[column] != table[column].iloc[0], HOSTILE)
    for draw in (figure5, figure5_by_light):
        root = ET.fromstring(svg(draw(table, "unpolarised")))
        assert not list(root.iter(f"{SVG}script"))
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


def test_nan_skills_are_counted_and_never_dropped_in_silence(table: pd.DataFrame) -> None:
    table = with_skill(table, math.nan, method="eq8", light="uniform", surface="carbon")
    row = by_light_and_body(table).query("method == 'eq8' and light == 'uniform'").iloc[0]
    assert (row["scenes"], row["unreported"], row["negative"]) == (6, 3, 0)
    assert unreported_skills(table, "eq8").values.tolist() == [
        ["uniform", "carbon", "unpolarised", 3, 3]
    ]
    assert "| eq8 | uniform | carbon | unpolarised | 3 of 3 |" in summary(table, sample.run())


def test_negative_skills_are_listed_with_their_place_and_number(table: pd.DataFrame) -> None:
    table = with_skill(table, -0.5, method="eq8", light="uniform", surface="carbon")
    table = with_skill(table, -7.0, method="eq8", light="distant 60°", material="pmma")
    negative = [
        (row["light"], row["surface"], row["negative"], row["scenes"], row["worst"])
        for row in negative_skills(table, "eq8").to_dict("records")
    ]
    assert negative == [
        ("distant 60°", "carbon", 1, 3, -7.0),
        ("distant 60°", "obsidian", 1, 3, -7.0),
        ("uniform", "carbon", 3, 3, -0.5),
    ]
    text = summary(table, sample.run())
    assert "5 scenes in 3 places" in text
    assert "| uniform | carbon (0.4) | unpolarised | 3 of 3 | −0.50 |" in text


def test_skill_map_is_in_order_of_roughness_and_keeps_its_holes(table: pd.DataFrame) -> None:
    table = with_skill(table, math.nan, method="eq8", light="uniform", surface="carbon")
    skills = median_skills(table, "eq8", "unpolarised")
    assert list(skills.columns) == ["obsidian", "carbon"]
    assert skills.loc["uniform", "obsidian"] == pytest.approx(0.95)
    assert math.isnan(skills.loc["uniform", "carbon"])


def test_table_1_pools_pixels_and_stands_beside_the_paper() -> None:
    random = np.random.default_rng(1)
    pixels = {scene: random.uniform(0, 9, 50) for scene in ("a", "b", "c")}
    rows = sample.table().drop_duplicates(["metric", "method"]).query("metric == 'nmse'")
    plain = rows[rows["method"] == "eq8"]
    parts = [plain]
    for scene, values in pixels.items():
        for end, value in (("", values.mean()), ("_std", values.std())):
            metric = f"delta_e76_i_min{end}"
            parts.append(plain.assign(scene=scene, metric=metric, value=value, noise=0.2))
    errors = dict(zip(pixels, (2e-3, 5e-3, 1e-3), strict=True))
    for scene, value in errors.items():
        parts.append(plain.assign(scene=scene, metric="nmse_i_max", value=value, noise=1e-5))
    table = pd.concat([*parts[1:], *(plain.assign(scene=scene) for scene in pixels)])
    differences = table1(table).set_index(["formula", "image"])
    assert list(differences.index) == [("ΔE76", "I_min"), ("NMSE", "I_max"), ("NMSE", "I(ϑ)")]
    pooled = np.concatenate(list(pixels.values()))
    means = [values.mean() for values in pixels.values()]
    colour, error = differences.loc[("ΔE76", "I_min")], differences.loc[("NMSE", "I_max")]
    # The same sums in another order: a few roundings of float64.
    assert colour["mean"] == pytest.approx(pooled.mean(), rel=1e-12)
    assert colour["std"] == pytest.approx(pooled.std(), rel=1e-12)
    assert colour["scene_std"] == pytest.approx(np.std(means), rel=1e-12)
    assert (colour["noise"], colour["scenes"]) == (pytest.approx(0.2), 3)
    assert error["mean"] == pytest.approx(np.mean(list(errors.values())), rel=1e-12)
    assert error["scene_std"] == pytest.approx(np.std(list(errors.values())), rel=1e-12)
    assert math.isnan(error["std"])
    printed = table1_text(table1(table))
    assert printed.heads[3:] == ("ΔE76 of I_min", "NMSE of I_max", "NMSE of I(ϑ)")
    text = f"{pooled.mean():.2f} ± {pooled.std():.2f} ({np.std(means):.2f})"
    assert printed.lines[0][:5] == ["unpolarised", "eq8", "3", text, "2.7e-3 (1.7e-3)"]
    paper = ["the paper, Indoor", "–", "1.24 ± 0.31", "0.008 ± 0.0011", "–"]
    assert printed.lines[-2][1:] == paper


def test_figure_9_draws_the_pooled_numbers_of_every_light() -> None:
    table = sample.coloured()
    values = figure9_numbers(table)
    axes = figure9(table, "unpolarised").axes
    assert [ax.get_title("left") for ax in axes] == ["uniform", "distant 60°"]
    (legend,) = axes[0].figure.legends
    assert "deviation over the pixels of" in legend.get_title().get_text()
    for ax in axes:
        rows = values[values["light"] == ax.get_title("left")]
        for method, line in zip(("unpolarised", "eq8"), ax.get_lines(), strict=False):
            wanted = rows.loc[rows["method"] == method, "mean"]
            np.testing.assert_array_equal(line.get_ydata(), wanted)


def test_one_material_and_roughness_make_no_figure_5(table: pd.DataFrame) -> None:
    single = table[(table["material"] == "pmma") & (table["surface"] == "carbon")]
    assert [drawing.name for drawing in drawings(single)] == ["angles"]


def test_captions_stay_inside_their_figure() -> None:
    table = sample.coloured()
    for number, shape in enumerate(("sphere in a room full of things", "torus beside", "blob of")):
        chosen = table["scene"].isin([f"{2 * number:016x}", f"{2 * number + 1:016x}"])
        table["shape"] = table["shape"].mask(chosen, f"{shape} many words that name it")
    # Legends name the lights that a mean covers.
    table["light"] = table["light"].replace("distant 60°", "distant 60°" + " and others" * 8)
    for draw in (figure5, figure5_by_light, figure9):
        figure = draw(table, "unpolarised")
        figure.canvas.draw()
        box = figure.legends[0].get_window_extent()
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.width


def test_without_colour_metrics_there_is_neither(table: pd.DataFrame) -> None:
    assert not table1_text(table1(table))
    assert "Table I" not in summary(table, sample.run())
    names = [drawing.name for drawing in drawings(table)]
    assert "figure9" not in names
    assert "figure9" in [drawing.name for drawing in drawings(sample.coloured())]


def test_the_page_names_the_papers_method_where_it_was_run(
    table: pd.DataFrame, tmp_path: Path
) -> None:
    without = table[table.method != "eq8"]
    assert len(without)
    for rows, named in ((table, True), (without, False)):
        first = of_run(Source(rows, sample.run(), tmp_path, ()))[0]
        assert first.name == "headline"
        assert ("eq8" in first.content) == named
        assert ("mean NMSE by material of the trivial guess" in first.content) != named


def headline_of(rows: pd.DataFrame, suite: str = "sample") -> str:
    """Labels and numbers of a headline's tiles, as one text."""
    tiles = headline_tiles(rows, table1(rows), suite)
    return " | ".join(f"{number} {label}" for number, label in tiles)


def test_the_headline_answers_what_the_suite_asks(table: pd.DataFrame) -> None:
    """Several materials ask Figure 5's question, colours Table I's, a ladder its own."""
    figure5 = headline_of(table)
    assert "mean NMSE of eq8 by material. The paper: 4e-3" in figure5
    assert "ΔE76" not in figure5
    colours = headline_of(sample.coloured())
    assert "Figure 5" not in colours
    assert "by material" not in colours
    # Means of the sample: 3 of the guess, 1 of eq8.
    assert "1.00 mean ΔE76 of I_max by eq8; unpolarised: 3.00 |" in colours
    assert "the paper, Indoor: 2.09 ± 0.64" in headline_of(sample.coloured(), "indoor")
    assert "the paper, Outdoor: 4.40 ± 1.95" in headline_of(sample.coloured(), "outdoor")
    ladder = headline_of(sample.laddered())
    # From 1e-3 with everything known to 3e-3, 7e-3 and back to 6e-3.
    assert "2.0e-3 of the mean NMSE of eq8: lobes estimated" in ladder
    assert "-1.0e-3 of the mean NMSE of eq8: single image" in ladder
    one = table[table["material"] == "pmma"]
    assert "by material" not in headline_of(one)
    assert "0.95 median skill of eq8" in headline_of(one)


def test_errors_of_degree_and_angle_stand_first_where_they_were_asked_for(
    table: pd.DataFrame,
) -> None:
    errors = table[(table["metric"] == "nmse") & table["angle_deg"].isna()]
    degree = errors.assign(metric="dolp_mae", value=errors["method"].map({"eq8": 0.02}).fillna(0.1))
    text = headline_of(pd.concat([table, degree], ignore_index=True))
    assert "0.02 mean DoLP MAE of eq8; of the trivial guess 0.1 |" in text


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


def test_summary_says_what_a_reader_must_know(table: pd.DataFrame) -> None:
    text = summary(table, sample.run())
    for words in (
        "4e-3 … 6e-3",
        "unverified stand-ins",
        "64 samples a pixel",
        "scalar_spectral_polarized",
        "2.0e-6 of the peak",
        "half_vector left out 6 scenes: needs a distant light, found uniform",
        "| render | 1.50 |",
    ):
        assert words in text


@pytest.mark.parametrize("seed", range(5))
def test_spread_moves_as_little_as_scipy_does(seed: int) -> None:
    positions = np.sort(np.random.default_rng(seed).uniform(0.0, 9.0, 12))
    steps = 1.0 * np.arange(12)
    expected = isotonic_regression(positions - steps).x + steps
    np.testing.assert_allclose(spread(positions, 1.0), expected, rtol=1e-13)  # order of the means


def test_spread_keeps_order_and_distance() -> None:
    positions = spread(np.array([0.0, 0.1, 0.1, 3.0]), 1.0)
    assert np.all(np.diff(positions) >= 1.0 - 1e-12)
    assert positions.mean() == pytest.approx(0.8)  # moved as little as possible: the mean stays


def test_the_parts_of_an_error_add_up_to_it() -> None:
    table = sample.laddered()
    # On one scene a rung has no error: that scene is left out everywhere.
    rows = (table["knowledge"] == "lobes estimated") & (table["scene"] == f"{0:016x}")
    table = table[~rows]
    first = table["scene"] == f"{1:016x}"
    table.loc[first & (table["metric"] == "nmse"), "value"] *= 5
    parts = ladder_numbers(table)
    assert parts["source"].tolist() == [
        "Monte Carlo noise", "model form", "lobes estimated", "normals estimated", "single image",
    ]  # fmt: skip
    assert set(parts["scenes"]) == {11}
    np.testing.assert_allclose(parts["increment"].cumsum(), parts["nmse"], rtol=1e-12)
    for rung, total in zip(table["knowledge"].unique(), parts["nmse"][1:], strict=True):
        errors = [
            row["value"]
            for row in table[table["scene"] != f"{0:016x}"].to_dict("records")
            if row["knowledge"] == rung and row["metric"] == "nmse" and math.isnan(row["angle_deg"])
        ]
        assert total == pytest.approx(statistics.fmean(errors), rel=1e-12)
    assert parts["increment"].iloc[-1] < 0  # a rung may help


def both_bodies() -> pd.DataFrame:
    table = sample.laddered()
    other = table.assign(body="polarised", scene="p" + table["scene"])
    other["value"] = other["value"].mask(other["metric"] == "nmse", 3 * other["value"])
    return pd.concat([table, other], ignore_index=True)


def test_the_bars_are_those_parts() -> None:
    numbers = ladder_numbers(both_bodies())
    axes = figure_ladder(numbers).axes
    assert [ax.get_title("left") for ax in axes] == ["unpolarised body", "polarised body"]
    for ax, (_, rows) in zip(axes, numbers.groupby("body", sort=False), strict=True):
        widths = [round(bar.get_width(), 12) for bar in ax.patches if bar.get_width()]
        assert widths == [width for width in rows["increment"].round(12) if width]


def test_bars_over_other_scenes_say_so() -> None:
    """A guess over the easier scenes alone stood below a method over all of them."""
    table = sample.laddered()
    other = table[table["scene"] != table["scene"].iloc[0]].assign(method="half_vector")
    count = table["scene"].nunique()
    both = pd.concat([table, other], ignore_index=True)
    told = [f"eq8, {count} scenes", f"half_vector, {count - 1} scenes"]
    for rows, labels in ((table, ["eq8"]), (both, told)):
        (drawing,) = ladders(rows)
        (ax,) = figure_ladder(drawing.numbers).axes
        assert [tick.get_text() for tick in ax.get_yticklabels()] == labels
        assert ("do not compare" in drawing.caption) == (len(labels) > 1)


def test_the_ladder_is_on_the_page_of_a_run_that_has_one(tmp_path: Path) -> None:
    results = SimpleNamespace(table=both_bodies(), run=sample.run())
    names = {path.name for path in write_report(results, tmp_path, png=True)}
    assert {name for name in names if "ladder" in name} == {
        "ladder.svg", "ladder.png", "ladder.csv",
    }  # fmt: skip
    written = pd.read_csv(tmp_path / "ladder.csv")
    last = written[written["source"] == "single image"]
    totals = dict(zip(last["body"], last["nmse"], strict=True))
    # Written with all digits, of float64 sums in another order.
    assert totals == pytest.approx({"unpolarised": 6e-3, "polarised": 18e-3}, rel=1e-12)
    assert "normals estimated" in (tmp_path / "report.html").read_text("utf-8")
    (drawing,) = ladders(results.table)
    assert [line[:2] for line in drawing.cells.lines] == [
        ["unpolarised", "eq8"], ["polarised", "eq8"],
    ]  # fmt: skip


def test_a_method_that_some_rung_never_lets_work_has_no_bar() -> None:
    table = sample.laddered()
    gone = (table["knowledge"] == "lobes estimated") & (table["metric"] == "nmse")
    assert ladder_numbers(table.assign(value=table["value"].mask(gone))).empty
    assert not list(ladders(table.assign(value=table["value"].mask(gone))))


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


def test_the_viewers_colour_maps_are_those_of_matplotlib() -> None:
    tables = json.loads(asset("colour_maps.json"))
    for name, theirs in (
        ("diverging", "RdBu_r"), ("sequential", "cividis"), ("cyclic", "twilight"),
    ):  # fmt: skip
        stored = np.frombuffer(base64.b64decode(tables[name]), np.uint8).reshape(256, 3)
        expected = 255 * matplotlib.colormaps[theirs](np.linspace(0.0, 1.0, 256))[:, :3]
        np.testing.assert_array_equal(stored, np.rint(expected))
