"""A part of a page, and the figure with the numbers behind it that several parts show."""

from __future__ import annotations

from dataclasses import dataclass

from malus.reports.figures.drawings import Drawing
from malus.reports.figures.inline import inlined
from malus.reports.html import Markup, folded, scrolling, table, tag


@dataclass(frozen=True)
class Section:
    """A part of the page: the name in its address, a title and what it shows."""

    name: str
    title: str
    content: Markup


def figure(drawing: Drawing) -> Markup:
    """A drawing with its caption and its numbers to open."""
    label = f"{drawing.title}: {drawing.caption}"
    picture = scrolling(inlined(drawing.svg, drawing.name, label), drawing.title)
    return tag(
        "figure",
        tag("h3", drawing.title),
        picture,
        tag("figcaption", drawing.caption),
        folded("Numbers behind the figure", table(drawing.cells, f"{drawing.name}.csv")),
        class_="drawing",
    )
