"""Every figure of a report with its caption and the numbers behind it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import pandas as pd
from markupsafe import Markup

from malus.reports.figures.inline import inlined
from malus.reports.tables.colour_errors import figure9_numbers
from malus.reports.tables.figure_numbers import angle_numbers, both_panels, ladder_numbers
from malus.reports.tables.rows import (
    CAPTURED,
    PAPER_BODY,
    by_kind_of_light,
    distinct,
    overall_rows,
    rows_by_angle,
    rows_of_body,
    told_of_groups,
)
from malus.reports.tables.text_tables import TextTable, budget, by_method
from malus.scenes.materials.surface import body_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Picture(NamedTuple):
    """A figure as SVG text and, where it was asked for, as PNG with the same layout."""

    svg: str
    png: bytes | None


@dataclass(frozen=True)
class Drawing:
    """A figure: the stem of its files' names, a caption, and the numbers behind it.

    `cells` are the numbers as people read them. `draw` makes the figure, also in another process;
    `drawn` gives its picture where it is drawn elsewhere.
    """

    name: str
    title: str
    caption: str
    numbers: pd.DataFrame
    cells: TextTable
    draw: Callable[[], Figure]
    drawn: Callable[[], Picture] | None = None

    @cached_property
    def picture(self) -> Picture:
        """The figure, drawn when it is asked for first."""
        return self.drawn() if self.drawn else picture(self.draw)

    @property
    def element(self) -> Markup:
        """The figure as an element of a page."""
        return inlined(self.picture.svg, self.name, f"{self.title}: {self.caption}")


def picture(draw: Callable[[], Figure], with_png: bool = False) -> Picture:
    """Draw a figure."""
    # Matplotlib takes its time: it is loaded where there is something to draw.
    from malus.reports.figures.style import png, svg

    figure = draw()
    text = svg(figure)
    return Picture(text, png(figure) if with_png else None)


def drawn_by(name: str, *content: Any) -> Figure:
    """What a function of this folder, such as `ladder.figure_ladder`, draws of its content.

    It has a name here because it is loaded with Matplotlib, when there is something to draw.
    """
    module, function = name.split(".")
    figure: Figure = getattr(import_module(f"{__package__}.{module}"), function)(*content)
    return figure


def drawings(table: pd.DataFrame) -> Iterator[Drawing]:
    """Figure 5, Figure 5 by light, error over the polariser angle and Figure 9, for every body.

    Figure 5 needs several indices or roughnesses, Figure 9 colour differences. Where there are too
    many lights, those of a kind are taken together.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> [drawing.name for drawing in drawings(table())]
    ['figure5', 'figure5_by_light', 'angles']
    """
    for body in distinct(overall_rows(table, "nmse")["body"]):
        own = rows_of_body(table, body)
        told, rows = told_of_groups(own), by_kind_of_light(own)
        told = f"{told} " if told else ""
        if rows[["eta", "alpha"]].nunique().max() > 1:  # else a figure of one point
            yield from _figure5(rows[rows["angle_deg"].isna()], body, told)
        yield from _over_the_angle(rows, body, told)


def _figure5(rows: pd.DataFrame, body: str, told: str) -> Iterator[Drawing]:
    numbers = both_panels(rows)
    yield Drawing(
        f"figure5{_suffix(body)}",
        f"Figure 5{_title_end(body)}",
        "Error against refractive index (top) and roughness (bottom), mean and standard"
        f" deviation over the dataset. {_note(body)}",
        numbers,
        by_method(numbers),
        partial(drawn_by, "figure5.figure5", rows, body),
    )
    numbers = both_panels(rows, by_light=True)
    yield Drawing(
        f"figure5{_suffix(body)}_by_light",
        f"Figure 5 by light{_title_end(body)}",
        "The same for every light: no mean over lights hides where a method fails."
        f" {told}{_note(body)}",
        numbers,
        by_method(numbers),
        partial(drawn_by, "figure5.figure5_by_light", rows, body),
    )


def _over_the_angle(rows: pd.DataFrame, body: str, told: str) -> Iterator[Drawing]:
    numbers = angle_numbers(rows)
    yield Drawing(
        f"angles{_suffix(body)}",
        f"Error over the polariser angle{_title_end(body)}",
        f"Mean and standard deviation over the {_scenes(body)}. {told}{_note(body)}",
        numbers,
        by_method(numbers),
        partial(drawn_by, "angles.figure_angles", rows, body),
    )
    if len(rows_by_angle(rows, "delta_e76")):
        numbers = figure9_numbers(rows)
        yield Drawing(
            f"figure9{_suffix(body)}",
            f"Figure 9: colour difference over the polariser angle{_title_end(body)}",
            f"ΔE76, mean and standard deviation over the pixels of all {_scenes(body)};"
            f" dashed: one just noticeable difference. {told}{_note(body)}",
            numbers,
            by_method(numbers),
            partial(drawn_by, "angles.figure9", rows, body),
        )


_OF_OTHER_SCENES = (
    " Bars over other numbers of scenes do not compare: what a method left out may be hard, or"
    " easy."
)


def ladders(table: pd.DataFrame) -> Iterator[Drawing]:
    """The error budget of all bodies, where methods were told less than everything.

    Examples
    --------
    >>> from malus.reports.tables.sample import laddered, table
    >>> [drawing.name for drawing in ladders(laddered())], list(ladders(table()))
    (['ladder'], [])
    """
    if table["knowledge"].nunique() < 2:
        return
    numbers = ladder_numbers(table)
    if numbers.empty:
        return
    yield Drawing(
        "ladder",
        "Parts of the error",
        "Mean NMSE over the scenes on which a method has an error at every rung; what makes it"
        " smaller stands left of zero, the upright mark is the sum. Every body has its own scale."
        + _OF_OTHER_SCENES
        * bool(numbers.groupby("body")["scenes"].nunique().max() > 1),
        numbers,
        budget(numbers),
        partial(drawn_by, "ladder.figure_ladder", numbers),
    )


def _scenes(body: str) -> str:
    return "captures of a group" if body == CAPTURED else "scenes of a light"


def _suffix(body: str) -> str:
    return "" if body in (PAPER_BODY, CAPTURED) else f"_{body}_body"


def _title_end(body: str) -> str:
    return "" if body in (PAPER_BODY, CAPTURED) else f", {body_text(body)}"


def _note(body: str) -> str:
    if body == PAPER_BODY:
        return "The paper's assumption: the body is unpolarised."
    if body == CAPTURED:
        return "Real captures: their truth is the sinusoid that fits the pictures."
    return f"{body_text(body).capitalize()}."
