"""Figures and maps of many methods, lights, materials and surfaces can still be read."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from malus.reports.figures.angles import figure9, figure_angles
from malus.reports.figures.drawings import drawings
from malus.reports.figures.figure5 import figure5, figure5_by_light
from malus.reports.figures.style import svg
from malus.reports.sections import of_run
from malus.reports.source import Source
from malus.reports.tables import sample

Draw = Callable[[pd.DataFrame, str], Figure]
FIGURES: list[Draw] = [figure5, figure5_by_light, figure_angles, figure9]


def many_methods(count: int) -> pd.DataFrame:
    table = sample.coloured()
    eq8 = table[table["method"] == "eq8"]
    others = [
        eq8.assign(method=f"my_method_{k}", value=eq8["value"] * (1 + k)) for k in range(count)
    ]
    return pd.concat([table, *others], ignore_index=True)


def many_scenes(count: int) -> pd.DataFrame:
    """Scenes drawn at random: a light, a material and a roughness of its own each."""
    table, kinds = sample.coloured(), ("distant", "area", "sky")
    template = table[table["scene"] == f"{6:016x}"]
    scenes = []
    for k in range(count):
        alpha, eta = 0.1 + 0.3 * (k * 0.618 % 1), 1.3 + 0.4 * (k * 0.414 % 1)
        scenes.append(
            template.assign(
                scene=f"{k:016x}", light=f"{kinds[k % 3]} {k}° azimuth {k}°", alpha=alpha, eta=eta,
                surface=f"alpha {alpha:.6g}", material=f"eta {eta:.6g}",
            )
        )  # fmt: skip
    return pd.concat(scenes, ignore_index=True)


@pytest.mark.parametrize("draw", FIGURES)
def test_methods_at_one_x_stay_clear_of_the_next(
    draw: Callable[[pd.DataFrame, str], Figure],
) -> None:
    """Thirty methods were moved sideways beyond the neighbouring materials and angles."""
    table = many_methods(30)
    table["angle_deg"] = table["angle_deg"].replace(90.0, 15.0)
    figure = draw(table, "unpolarised")
    for ax in figure.axes:
        x = [np.asarray(line.get_xdata(), float) for line in ax.get_lines()[:33]]
        drawn = [values for values in x if values.size > 1 and np.ptp(values) > 1e-3]
        places = np.stack([values for values in drawn if len(values) == len(drawn[0])])
        gaps = np.diff(places.mean(axis=0))
        assert np.ptp(places, axis=0).max() < 0.5 * gaps.min()


@pytest.mark.parametrize("draw", FIGURES)
def test_a_long_legend_makes_the_figure_higher(draw: Draw) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        plain, figure = (
            draw(sample.coloured(), "unpolarised"),
            draw(many_methods(30), "unpolarised"),
        )
        svg(plain), svg(figure)
    heights = [ax.get_position().height * fig.get_figheight() for fig in (plain, figure)
               for ax in fig.axes[:1]]  # fmt: skip
    assert heights[1] > 0.9 * heights[0]
    legend = figure.legends[0].get_window_extent()
    for ax in figure.axes:
        assert ax.get_window_extent().y0 > legend.y1


def test_a_figure_without_room_warns_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("malus.reports.figures.figure5._make_room", lambda *_: None)
    svg(figure_angles(many_methods(30), "unpolarised"))  # warnings are errors here


def test_few_of_those_below_a_panel_are_named() -> None:
    table = many_methods(30)
    mine = table["method"].str.startswith("my_")
    table["value"] = table["value"].mask(mine & (table["metric"] == "nmse"), 1e-12)
    ax = figure5(table, "unpolarised").axes[0]
    named = [text.get_text() for text in ax.texts if text.get_text().startswith("▼")]
    assert len(named) == 5
    assert named[-1] == "▼ 26 more methods"


def test_names_of_many_materials_and_surfaces_are_left_out() -> None:
    few, many = figure5(many_scenes(9), "unpolarised"), figure5(many_scenes(30), "unpolarised")
    named = [[t.get_text() for t in fig.axes[0].texts if "eta" in t.get_text()]
             for fig in (few, many)]  # fmt: skip
    assert [len(names) for names in named] == [9, 0]
    ticks = [[t.get_text() for t in fig.axes[1].get_xticklabels()] for fig in (few, many)]
    assert "alpha" in ticks[0][0]  # of the others those that would touch are left out
    assert not any("alpha" in tick for tick in ticks[1])


def test_many_lights_are_shown_by_their_kind(tmp_path: Path) -> None:
    """A panel a light took minutes and was wider than any screen."""
    table = many_scenes(40)
    by_light = next(d for d in drawings(table) if d.name == "figure5_by_light")
    assert [ax.get_title("left") for ax in by_light.draw().axes][:3] == ["distant", "area", "sky"]
    assert set(by_light.numbers["light"]) == {"distant", "area", "sky"}
    wanted = table[(table["metric"] == "nmse") & table["angle_deg"].isna()]
    assert by_light.numbers["scenes"].sum() == 2 * len(wanted)  # every scene, in both panels
    told = "There are 40 lights, too many to show: those of a kind are taken together."
    for drawing in drawings(table):
        assert (told in drawing.caption) == (drawing.name != "figure5")
    assert not any("too many" in drawing.caption for drawing in drawings(sample.coloured()))
    (skills,) = (s for s in of_run(Source(table, sample.run(), tmp_path, ())) if s.name == "skill")
    assert told in skills.content
    assert "There are 40 surfaces, too many to show" in skills.content
    assert skills.content.count('<th scope="row">sky</th>') == 2  # a map a method
    assert skills.content.count('<th scope="col">all surfaces</th>') == 2


def test_long_names_of_lights_do_not_run_into_the_next_panel() -> None:
    table = sample.coloured()
    name = "area 60.1234° azimuth 120.123° half angle 15.1234°"
    table["light"] = table["light"].replace("uniform", name)
    for draw in FIGURES[1:]:
        figure = draw(table, "unpolarised")
        figure.canvas.draw()
        texts = [part for part in figure.axes[0].get_children() if isinstance(part, Text)]
        (title,) = (text for text in texts if text.get_text().startswith("area"))
        assert title.get_window_extent().x1 < figure.axes[1].get_window_extent().x0


def test_the_legend_says_why_a_method_has_no_curve() -> None:
    table = sample.coloured()
    broken = (table["method"] == "eq8") & (table["metric"] == "nmse")
    table["value"] = table["value"].mask(broken, math.nan)
    figure = figure5(table, "unpolarised")
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "eq8: not finite" in labels
