"""The figures of studies, with their captions and the numbers behind them."""

from __future__ import annotations

from functools import partial

import pandas as pd

from malus.reports.figures.drawings import Drawing, drawn_by
from malus.reports.tables.prices import price_cells, prices
from malus.reports.tables.readings import by_dataset, reading_cells
from malus.reports.tables.separation import by_colour, separation_cells
from malus.reports.tables.text_tables import points
from malus.scenes.core.errors import counted


def precision_drawing(table: pd.DataFrame) -> Drawing:
    """Work-precision diagrams of the study `precision`."""
    return Drawing(
        "precision",
        "Work-precision diagrams",
        "Error against seconds, both logarithmic; filled: on the Pareto front.",
        table,
        points(table),
        partial(drawn_by, "precision.figure_precision", table),
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
        partial(drawn_by, "readings.figure_readings", table),
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
        partial(drawn_by, "prices.figure_prices", numbers, method),
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
        partial(drawn_by, "separation.figure_separation", table),
    )
