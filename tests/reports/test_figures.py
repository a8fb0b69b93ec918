"""Figures: what they draw are the numbers of the table, and their text is text."""

from __future__ import annotations

import math
import re
import statistics
import xml.etree.ElementTree as ET
from itertools import count, pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from scipy.optimize import isotonic_regression

from malus.reports import write_report
from malus.reports.figures.angles import figure9
from malus.reports.figures.drawings import drawings, ladders
from malus.reports.figures.figure5 import figure5, figure5_by_light
from malus.reports.figures.ladder import figure_ladder
from malus.reports.figures.panels import spread
from malus.reports.figures.style import PALETTE, method_styles, png, svg
from malus.reports.tables import sample
from malus.reports.tables.colour_errors import figure9_numbers
from malus.reports.tables.figure_numbers import both_panels, ladder_numbers, numbers
from malus.reports.tables.sentences import LADDER

SVG = "{http://www.w3.org/2000/svg}"


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
    whole = [bar[0][1] for bar in ax.collections[2].get_segments()]
    np.testing.assert_array_equal(np.array(whole)[endless], values["mean"][endless])


@pytest.mark.parametrize("count", range(1, len(PALETTE) + 1))
def test_no_two_methods_share_a_colour_while_one_is_free(count: int) -> None:
    """Colours stayed kept for methods that were not run, and a seventh took the first again."""
    methods = ["eq8", "blind", "net", "paper", "my own", "another"][:count]
    styles = method_styles(["unpolarised", *methods])
    assert len({styles[method].colour for method in methods}) == count
    assert styles["eq8"].colour == method_styles(["eq8"])["eq8"].colour


def test_with_more_methods_than_colours_none_look_alike() -> None:
    methods = [f"method {number}" for number in range(3 * len(PALETTE))]
    styles = method_styles(methods)
    assert len({(style.colour, style.marker) for style in styles.values()}) == len(methods)


def test_methods_at_one_x_stand_side_by_side(table: pd.DataFrame) -> None:
    """Bars of equal errors would hide each other."""
    for ax in figure5(table, "unpolarised").axes:
        lines = ax.get_lines()[:2]
        first, second = (np.asarray(line.get_xdata(), float) for line in lines)
        assert (second > first).all()


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


def test_settings_of_the_user_do_not_reach_figures(table: pd.DataFrame) -> None:
    """A `matplotlibrc` for papers asks for LaTeX, which need not be there, and for other sizes."""
    plain = svg(figure5(table, "unpolarised")), png(figure5(table, "unpolarised"))
    own = {
        "text.usetex": True,
        "font.weight": "bold",
        "axes.facecolor": "red",
        "savefig.pad_inches": 1,
    }
    with mpl.rc_context({**own, "savefig.bbox": "tight", "savefig.transparent": True}):
        assert (svg(figure5(table, "unpolarised")), png(figure5(table, "unpolarised"))) == plain
        assert mpl.rcParams["font.weight"] == "bold"  # they are the user's again


def test_png_has_200_dots_an_inch(table: pd.DataFrame) -> None:
    data = png(figure5(table, "unpolarised"))
    width = int.from_bytes(data[16:20], "big")  # PNG header: width at byte 16
    assert width == round(7.1 * 200)


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


def test_pixels_of_several_scenes_are_pooled_as_one_crowd() -> None:
    """Three scenes of as many pixels, drawn in full: their deviation is that of all pixels."""
    table = sample.coloured().query("light == 'uniform' and surface == 'carbon'").copy()
    random = np.random.default_rng(2)
    scenes = list(table["scene"].unique())
    pixels = {scene: random.normal(k, 1 + k, 1000) for k, scene in enumerate(scenes)}
    angles = table["angle_deg"].notna() & (table["method"] == "eq8")
    for metric, of in (("delta_e76", np.mean), ("delta_e76_std", np.std)):
        chosen = angles & (table["metric"] == metric)
        table.loc[chosen, "value"] = [of(pixels[scene]) for scene in table.loc[chosen, "scene"]]
    found = figure9_numbers(table).query("method == 'eq8'")
    every = np.concatenate(list(pixels.values()))
    assert len(scenes) == 3
    np.testing.assert_allclose(found["mean"], every.mean(), rtol=1e-12)
    np.testing.assert_allclose(found["std"], every.std(), rtol=1e-12)


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
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "normals estimated" in page
    assert LADDER in page  # in a section of its own, which says what the parts are
    (drawing,) = ladders(results.table)
    assert [line[:2] for line in drawing.cells.lines] == [
        ["unpolarised", "eq8"], ["polarised", "eq8"],
    ]  # fmt: skip


def test_a_method_that_some_rung_never_lets_work_has_no_bar() -> None:
    table = sample.laddered()
    gone = (table["knowledge"] == "lobes estimated") & (table["metric"] == "nmse")
    assert ladder_numbers(table.assign(value=table["value"].mask(gone))).empty
    assert not list(ladders(table.assign(value=table["value"].mask(gone))))


def test_labels_of_near_roughnesses_do_not_lie_on_each_other(table: pd.DataFrame) -> None:
    """Measured on the drawn figure: those of several surfaces near 0.1 were one black spot."""
    alphas = table["material"].map(dict(zip(table["material"].unique(), count(), strict=False)))
    alphas = (0.1 + 0.001 * alphas).mask(table["surface"] == table["surface"].iloc[0], 0.5)
    figure = figure5(table.assign(alpha=alphas, surface=alphas.map(str)), "unpolarised")
    svg(figure)  # lays it out
    axis = figure.axes[1].xaxis
    boxes = [label.get_window_extent() for label in axis.get_ticklabels() if label.get_text()]
    assert len(boxes) >= 2
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))


def test_the_noise_of_one_roughness_is_seen(table: pd.DataFrame) -> None:
    """A line of one point is drawn as none."""
    one = table[table["surface"] == table["surface"].iloc[0]]
    figure = figure5(one, "unpolarised")
    noise = next(line for line in figure.axes[1].get_lines() if line.get_linestyle() == ":")
    assert len(noise.get_xdata()) == 1  # type: ignore[arg-type]
    assert noise.get_marker() == "_"


def test_a_caption_says_what_there_are_many_of(table: pd.DataFrame) -> None:
    """ "12 of them" after a number of scenes reads as 12 of the scenes."""
    many = [f"blob-{number}" for number in range(len(table))]
    title = figure5(table.assign(shape=many), "unpolarised").legends[0].get_title().get_text()
    assert re.search(r"in all: \d+ shapes; light uniform", " ".join(title.split()))
