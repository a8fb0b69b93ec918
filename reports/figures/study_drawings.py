"""The figures of studies, with their captions and the numbers behind them."""

from __future__ import annotations

import pandas as pd

from malus.reports.figures.drawings import Drawing, drawing_of
from malus.reports.tables.prices import price_cells, prices
from malus.reports.tables.readings import by_dataset, reading_cells
from malus.reports.tables.separation import by_colour, separation_cells
from malus.reports.tables.text_tables import points


def precision_drawing(table: pd.DataFrame) -> Drawing:
    """Work-precision diagrams of the study `precision`."""
    from malus.reports.figures.precision import figure_precision

    return drawing_of(
        "precision",
        "Work-precision diagrams",
        "Error against seconds, both logarithmic; filled: on the Pareto front.",
        figure_precision(table),
        table,
        points(table),
    )


def readings_drawing(table: pd.DataFrame) -> Drawing:
    """Every reading of the paper's "normalised", of the study `paper`."""
    from malus.reports.figures.readings import figure_readings

    return drawing_of(
        "readings",
        "Figure 5 of the paper, for every meaning of “normalised”",
        "A panel a meaning; spheres of 24 materials on 5 surfaces, lit from all around or by one"
        " distant lamp so far from the viewer. Where the wide and the thin bar both lie in the"
        " shaded band, the errors are as high and as flat as the paper's.",
        figure_readings(table),
        table,
        reading_cells(by_dataset(table)),
    )


def prices_drawing(table: pd.DataFrame) -> Drawing:
    """The price of every assumption, of the study `mismatch`."""
    from malus.reports.figures.prices import figure_prices

    numbers = prices(table)
    method = str(table["method"].iloc[0])
    return drawing_of(
        "prices",
        "The price of each assumption",
        f"Skill that {method} loses where an assumption does not hold, mean over pairs of scenes;"
        " lines are 95 % intervals. It has all of the renderer's other physics, and skill 1 where"
        " everything holds. Rungs of the ladder follow one another: each adds to those before.",
        figure_prices(numbers, method),
        numbers,
        price_cells(numbers),
    )


def separation_drawing(table: pd.DataFrame) -> Drawing:
    """Error of the specular lobe by each separation, of the study `separation`."""
    from malus.reports.figures.separation import figure_separation

    return drawing_of(
        "separation_errors",
        "Error of the separated specular light",
        "Root mean square error of I_s over its largest value, against the exact lobe of the"
        " render; a point a scene, a bar the median.",
        figure_separation(table),
        by_colour(table),
        separation_cells(table),
    )
