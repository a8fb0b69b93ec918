"""Every figure of a report with its caption and the numbers behind it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import pandas as pd
from markupsafe import Markup

from malus.reports.figures.inline import inlined
from malus.reports.tables.rows import (
    CAPTURED,
    PAPER_BODY,
    distinct,
    overall_rows,
    rows_by_angle,
    rows_of_body,
)
from malus.reports.tables.text_tables import TextTable, budget, by_method

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Drawing:
    """A figure: the stem of its files' names, a caption, SVG text, and the numbers behind it.

    `cells` are the numbers as people read them.
    """

    name: str
    title: str
    caption: str
    figure: Figure
    svg: str
    numbers: pd.DataFrame
    cells: TextTable

    @cached_property
    def png(self) -> bytes:
        """The figure as PNG, with the layout of the SVG."""
        from malus.reports.figures.style import png

        return png(self.figure)

    @property
    def element(self) -> Markup:
        """The figure as an element of a page."""
        return inlined(self.svg, self.name, f"{self.title}: {self.caption}")


def drawings(table: pd.DataFrame) -> Iterator[Drawing]:
    """Figure 5, Figure 5 by light, error over the polariser angle and Figure 9, for every body.

    Figure 5 needs several indices or roughnesses, Figure 9 colour differences.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> [drawing.name for drawing in drawings(table())]
    ['figure5', 'figure5_by_light', 'angles']
    """
    for body in distinct(overall_rows(table, "nmse")["body"]):
        rows = rows_of_body(table, body)
        if rows[["eta", "alpha"]].nunique().max() > 1:  # else a figure of one point
            yield from _figure5(rows, body)
        yield from _over_the_angle(rows, body)


def _figure5(rows: pd.DataFrame, body: str) -> Iterator[Drawing]:
    # Matplotlib takes its time: it is loaded when there is something to draw.
    from malus.reports.figures.figure5 import both_panels, figure5, figure5_by_light

    numbers = both_panels(rows)
    yield drawing_of(
        f"figure5{_suffix(body)}",
        f"Figure 5{_title_end(body)}",
        "Error against refractive index (top) and roughness (bottom), mean and standard"
        f" deviation over the dataset. {_note(body)}",
        figure5(rows, body),
        numbers,
        by_method(numbers),
    )
    numbers = both_panels(rows, by_light=True)
    yield drawing_of(
        f"figure5{_suffix(body)}_by_light",
        f"Figure 5 by light{_title_end(body)}",
        f"The same for every light: no mean over lights hides where a method fails. {_note(body)}",
        figure5_by_light(rows, body),
        numbers,
        by_method(numbers),
    )


def _over_the_angle(rows: pd.DataFrame, body: str) -> Iterator[Drawing]:
    from malus.reports.figures.angles import angle_numbers, figure_angles
    from malus.reports.figures.figure9 import figure9
    from malus.reports.tables.colour_errors import figure9_numbers

    numbers = angle_numbers(rows)
    yield drawing_of(
        f"angles{_suffix(body)}",
        f"Error over the polariser angle{_title_end(body)}",
        f"Mean and standard deviation over the {_scenes(body)}. {_note(body)}",
        figure_angles(rows, body),
        numbers,
        by_method(numbers),
    )
    if len(rows_by_angle(rows, "delta_e76")):
        numbers = figure9_numbers(rows)
        yield drawing_of(
            f"figure9{_suffix(body)}",
            f"Figure 9: colour difference over the polariser angle{_title_end(body)}",
            f"ΔE76, mean and standard deviation over the pixels of all {_scenes(body)};"
            f" dashed: one just noticeable difference. {_note(body)}",
            figure9(rows, body),
            numbers,
            by_method(numbers),
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
    from malus.reports.figures.ladder import figure_ladder, ladder_numbers

    numbers = ladder_numbers(table)
    if numbers.empty:
        return
    yield drawing_of(
        "ladder",
        "Parts of the error",
        "Mean NMSE over the scenes on which a method has an error at every rung; what makes it"
        " smaller stands left of zero, the upright mark is the sum. Every body has its own scale.",
        figure_ladder(numbers),
        numbers,
        budget(numbers),
    )


def drawing_of(
    name: str, title: str, caption: str, figure: Figure, numbers: pd.DataFrame, cells: TextTable
) -> Drawing:
    """A drawing of a figure, with its SVG."""
    from malus.reports.figures.style import svg

    return Drawing(name, title, caption, figure, svg(figure), numbers, cells)


def _scenes(body: str) -> str:
    return "captures of a group" if body == CAPTURED else "scenes of a light"


def _suffix(body: str) -> str:
    return "" if body in (PAPER_BODY, CAPTURED) else f"_{body}_body"


def _title_end(body: str) -> str:
    return "" if body in (PAPER_BODY, CAPTURED) else f", {body} body"


def _note(body: str) -> str:
    if body == PAPER_BODY:
        return "The paper's assumption: the body is unpolarised."
    if body == CAPTURED:
        return "Real captures: their truth is the sinusoid that fits the pictures."
    return f"Body {body}."
