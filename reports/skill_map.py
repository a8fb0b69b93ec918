"""The skill map: lights × surfaces, one map a method and body, colour and number."""

from __future__ import annotations

import math

import pandas as pd

from malus.reports.html import Markup, scrolling, tag
from malus.reports.tables.formats import NO_NUMBER, skill_text
from malus.reports.tables.rows import TRIVIAL, distinct, scored_methods
from malus.reports.tables.skills import skill_map

Places = dict[tuple[str, str, str], str]


def maps(table: pd.DataFrame, scenes: Places) -> list[Markup]:
    """One map for every body and method.

    Parameters
    ----------
    table : DataFrame
    scenes : dict
        Scene that the viewer shows for a (light, surface, body), where it shows one.
    """
    return [
        _map(skill_map(table, method, body), method, body, scenes)
        for body in distinct(table["body"])
        for method in scored_methods(table)
        if method != TRIVIAL
    ]


def _map(values: pd.DataFrame, method: str, body: str, scenes: Places) -> Markup:
    caption = f"{method}, {body} body"
    surfaces = [str(name) for name in values.columns]
    heads = tag("tr", tag("td", ""), *(tag("th", name, scope="col") for name in surfaces))
    lines = [
        tag(
            "tr",
            tag("th", light, scope="row"),
            *(
                _cell(float(value), scenes.get((light, surface, body)), method)
                for surface, value in zip(surfaces, row, strict=True)
            ),
        )
        for light, row in zip(map(str, values.index), values.to_numpy(float), strict=True)
    ]
    content = tag("table", tag("caption", caption), tag("thead", heads), tag("tbody", *lines))
    return scrolling(tag("div", content, class_="heat"), caption)


def _cell(value: float, scene: str | None, method: str) -> Markup:
    text = skill_text(value)
    style = "" if text == NO_NUMBER else f"--share:{strength(value):.2f}"
    side = "none" if text == NO_NUMBER else "good" if value >= 0 else "bad"
    content: str = text
    if scene and text != NO_NUMBER:
        label = f"skill {text}, show an example"
        content = tag(
            "button", text, type="button", data_scene=scene, data_method=method, aria_label=label
        )
    return tag("td", content, class_=side, style=style)


def strength(value: float) -> float:
    """How strong a cell's colour is, 0 to 1: linear to 1 above zero, logarithmic below.

    Examples
    --------
    >>> strength(0.5), strength(-100.0)
    (0.5, 1.0)
    """
    return max(0.0, min(1.0, value if value >= 0 else math.log10(1.0 - value) / 2.0 + 0.15))
