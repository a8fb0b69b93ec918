"""Every figure of a report with its caption and the numbers behind it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pandas as pd

from malus.reports.tables.listing import Listing, budget, by_method, points
from malus.reports.tables.tables import PAPER_BODY, by_angle, in_order, only_body, whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Drawing:
    """A figure: the stem of its files' names, a caption, both formats, and its numbers.

    `cells` are the numbers as people read them.
    """

    name: str
    title: str
    caption: str
    svg: str
    png: bytes
    numbers: pd.DataFrame
    cells: Listing


def drawings(table: pd.DataFrame) -> Iterator[Drawing]:
    """Figure 5, Figure 5 by light, error over the polariser angle and Figure 9, for every body.

    Figure 5 needs several indices or roughnesses, Figure 9 colour differences.

    Examples
    --------
    >>> from malus.reports.sample import table
    >>> [drawing.name for drawing in drawings(table())]
    ['figure5', 'figure5_by_light', 'angles']
    """
    # Matplotlib takes its time: it is loaded when there is something to draw.
    from malus.reports.figures.angles import angle_numbers, figure_angles
    from malus.reports.figures.figure5 import both_panels, figure5, figure5_by_light
    from malus.reports.figures.figure9 import figure9
    from malus.reports.tables.colour_errors import figure9_numbers

    for body in in_order(whole(table, "nmse")["body"]):
        end = "" if body == PAPER_BODY else f"_{body}_body"
        note = f" Body {body}." if end else " The paper's assumption: the body is unpolarised."
        rows = only_body(table, body)
        if rows[["eta", "alpha"]].nunique().max() > 1:  # else a figure of one point
            yield _drawing(
                f"figure5{end}", f"Figure 5{_of(body)}",
                "Error against refractive index (top) and roughness (bottom), mean and standard"
                " deviation over the dataset." + note,
                figure5, table, body, both_panels(rows),
            )  # fmt: skip
            yield _drawing(
                f"figure5{end}_by_light", f"Figure 5 by light{_of(body)}",
                "The same for every light: no mean over lights hides where a method fails."
                + note,
                figure5_by_light, table, body, both_panels(rows, by_light=True),
            )  # fmt: skip
        yield _drawing(
            f"angles{end}", f"Error over the polariser angle{_of(body)}",
            "Mean and standard deviation over the scenes of a light." + note,
            figure_angles, table, body, angle_numbers(rows),
        )  # fmt: skip
        if len(by_angle(rows, "delta_e76")):
            yield _drawing(
                f"figure9{end}", f"Figure 9: colour difference over the polariser angle{_of(body)}",
                "ΔE76, mean and standard deviation over the pixels of all scenes of a light;"
                " dashed: one just noticeable difference." + note,
                figure9, table, body, figure9_numbers(rows),
            )  # fmt: skip


def ladders(table: pd.DataFrame) -> Iterator[Drawing]:
    """The error budget of all bodies, where methods were told less than everything.

    Examples
    --------
    >>> from malus.reports.sample import laddered, table
    >>> [drawing.name for drawing in ladders(laddered())], list(ladders(table()))
    (['ladder'], [])
    """
    if table["knowledge"].nunique() < 2:
        return
    from malus.reports.figures.ladder import figure_ladder, ladder_numbers
    from malus.reports.figures.style import png, svg

    numbers = ladder_numbers(table)
    if numbers.empty:
        return
    figure = figure_ladder(numbers)
    caption = (
        "Mean NMSE over the scenes on which a method has an error at every rung; what makes it"
        " smaller stands left of zero, the upright mark is the sum. Every body has its own scale."
    )
    title = "Parts of the error"
    yield Drawing("ladder", title, caption, svg(figure), png(figure), numbers, budget(numbers))


def precision_drawing(table: pd.DataFrame) -> Drawing:
    """Work-precision diagrams of the study `precision`."""
    from malus.reports.figures.precision import figure_precision
    from malus.reports.figures.style import png, svg

    figure = figure_precision(table)
    caption = "Error against seconds, both logarithmic; filled: on the Pareto front."
    title = "Work-precision diagrams"
    return Drawing("precision", title, caption, svg(figure), png(figure), table, points(table))


def _of(body: str) -> str:
    return "" if body == PAPER_BODY else f", {body} body"


def _drawing(
    name: str,
    title: str,
    caption: str,
    draw: Callable[[pd.DataFrame, str], Figure],
    table: pd.DataFrame,
    body: str,
    numbers: pd.DataFrame,
) -> Drawing:
    from malus.reports.figures.style import png, svg

    figure = draw(table, body)
    return Drawing(name, title, caption, svg(figure), png(figure), numbers, by_method(numbers))
