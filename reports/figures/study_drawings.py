"""The figures of studies, with their captions and the numbers behind them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import pandas as pd

from malus.reports.figures.drawings import Drawing
from malus.reports.tables.formats import counted
from malus.reports.tables.prices import price_cells, prices
from malus.reports.tables.readings import by_dataset, reading_cells
from malus.reports.tables.separation import by_colour, separation_cells
from malus.reports.tables.text_tables import points

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def precision_drawing(table: pd.DataFrame) -> Drawing:
    """Work-precision diagrams of the study `precision`."""
    return Drawing(
        "precision",
        "Work-precision diagrams",
        "Error against seconds, both logarithmic; filled: on the Pareto front.",
        table,
        points(table),
        partial(_draw_precision, table),
    )


def readings_drawing(table: pd.DataFrame) -> Drawing:
    """Every reading of the paper's "normalised", of the study `paper`."""
    materials = counted(table.loc[table["panel"] == "eta", "name"].nunique(), "material")
    return Drawing(
        "readings",
        "Figure 5 of the paper, for every meaning of “normalised”",
        f"A panel a meaning; spheres of {materials} on 5 surfaces, lit from all around or by one"
        " distant lamp so far from the viewer. Where the wide and the thin bar both lie in the"
        " shaded band, the errors are as high and as flat as the paper's.",
        table,
        reading_cells(by_dataset(table)),
        partial(_draw_readings, table),
    )


def prices_drawing(table: pd.DataFrame) -> Drawing:
    """The price of every assumption, of the study `mismatch`."""
    numbers = prices(table)
    method = str(table["method"].iloc[0])
    return Drawing(
        "prices",
        "The price of each assumption",
        f"Skill that {method} loses where an assumption does not hold, mean over pairs of scenes;"
        " lines are 95 % intervals. It has all of the renderer's other physics, and skill 1 where"
        " everything holds; a bar that names another method is that one's. Rungs of the ladder"
        " follow one another: each adds to those before. A pair whose trivial guess is as good as"
        " the noise has no skill, and does not count.",
        numbers,
        price_cells(numbers),
        partial(_draw_prices, numbers, method),
    )


def separation_drawing(table: pd.DataFrame) -> Drawing:
    """Error of the specular lobe by each separation, of the study `separation`."""
    return Drawing(
        "separation_errors",
        "Error of the separated specular light",
        "Root mean square error of I_s over its largest value, against the exact lobe of the"
        " render; a point a scene, a bar the median.",
        by_colour(table),
        separation_cells(table),
        partial(_draw_separation, table),
    )


def _draw_precision(table: pd.DataFrame) -> Figure:
    from malus.reports.figures.precision import figure_precision

    return figure_precision(table)


def _draw_readings(table: pd.DataFrame) -> Figure:
    from malus.reports.figures.readings import figure_readings

    return figure_readings(table)


def _draw_prices(numbers: pd.DataFrame, method: str) -> Figure:
    from malus.reports.figures.prices import figure_prices

    return figure_prices(numbers, method)


def _draw_separation(table: pd.DataFrame) -> Figure:
    from malus.reports.figures.separation import figure_separation

    return figure_separation(table)
