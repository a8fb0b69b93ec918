"""The study of separations in numbers: error of I_s by body colour and separation."""

from __future__ import annotations

import pandas as pd

from malus.reports.tables.formats import NO_NUMBER, scientific
from malus.reports.tables.rows import distinct
from malus.reports.tables.text_tables import TextTable

EVERY_COLOUR = "all"


def by_colour(table: pd.DataFrame) -> pd.DataFrame:
    """Median, nine in ten, and worst error of every separation, by body colour and over all.

    Returns
    -------
    DataFrame
        Columns colour, separation, median, ninth (nine in ten scenes are below), worst, scenes and
        failed (scenes that could not be separated).

    Examples
    --------
    >>> sample = pd.DataFrame({"colour": ["red", "red"], "separation": ["suv", "suv"],
    ...                        "rmse": [0.1, 0.3], "why": ["", ""]})
    >>> by_colour(sample)[["colour", "median", "scenes"]].values.tolist()
    [['red', 0.2, 2], ['all', 0.2, 2]]
    """
    groups = [
        *((colour, table[table["colour"] == colour]) for colour in distinct(table["colour"])),
        (EVERY_COLOUR, table),
    ]
    lines = [
        {
            "colour": colour,
            "separation": separation,
            "median": own.median(),
            "ninth": own.quantile(0.9),
            "worst": own.max(),
            "scenes": len(own),
            "failed": int(own.isna().sum()),
        }
        for colour, rows in groups
        for separation in distinct(rows["separation"])
        for own in (rows.loc[rows["separation"] == separation, "rmse"],)
    ]
    return pd.DataFrame(lines)


def separation_cells(table: pd.DataFrame) -> TextTable:
    """The same as people read it: a line a colour, the median and the worst of every separation."""
    numbers = by_colour(table)
    names = distinct(numbers["separation"])
    lines = []
    for colour, rows in numbers.groupby("colour", sort=False):
        by_name = rows.set_index("separation")
        cells = [_cell(by_name.loc[name]) for name in names]
        lines.append([str(colour), str(int(rows["scenes"].max())), *cells])
    heads = [f"{name}: median (worst)" for name in names]
    return TextTable(("body colour", "scenes", *heads), lines)


def _cell(row: pd.Series) -> str:
    if row["median"] != row["median"]:
        return NO_NUMBER
    failed = f", {row['failed']} failed" if row["failed"] else ""
    return f"{scientific(row['median'])} ({scientific(row['worst'])}{failed})"
