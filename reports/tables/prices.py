"""The price of every assumption: loss of skill where it does not hold, with its error."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from malus.reports.tables.formats import skill_text
from malus.reports.tables.paired import half_width
from malus.reports.tables.paper_table import number_with_error
from malus.reports.tables.text_tables import TextTable


def prices(table: pd.DataFrame) -> pd.DataFrame:
    """Means over scenes of the table of the study `mismatch`.

    Returns
    -------
    DataFrame
        Columns assumption, kind, method, pairs (scenes that count), all_pairs, holds, broken (mean
        skills), price (their difference), half_width (half a 95 % interval of it, Student's t),
        worst. Scenes count where both have a skill to report; without any, numbers are NaN. Several
        wrong inputs of one scene, such as both signs, are one pair: their mean.

    Examples
    --------
    >>> pairs = {"first": 0.5, "second": 0.6, "third": 0.7}
    >>> rows = [("a", "truth", scene, "eq8", 0.9, broken) for scene, broken in pairs.items()]
    >>> columns = ["assumption", "kind", "scene", "method", "holds", "broken"]
    >>> round(prices(pd.DataFrame(rows, columns=columns)).price.item(), 6)
    0.3
    """
    rows = []
    for (assumption, kind, method), every in table.groupby(
        ["assumption", "kind", "method"], sort=False
    ):
        both = every.dropna(subset=["holds", "broken"])
        part = both.groupby("scene", sort=False)[["holds", "broken"]].mean()
        lost = (part["holds"] - part["broken"]).to_numpy(np.float64)
        rows.append(
            {
                "assumption": assumption,
                "kind": kind,
                "method": method,
                "pairs": len(lost),
                "all_pairs": every["scene"].nunique(),
                "holds": float(part["holds"].mean()),
                "broken": float(part["broken"].mean()),
                "price": float(lost.mean()) if len(lost) else math.nan,
                "half_width": half_width(lost),
                "worst": float((both["holds"] - both["broken"]).max()),
            }
        )
    return pd.DataFrame(rows)


def price_cells(numbers: pd.DataFrame) -> TextTable:
    """Prices as text, a line an assumption and method."""
    lines = [
        [
            str(row.assumption), str(row.method), skill_text(row.holds), skill_text(row.broken),
            number_with_error(row.price, row.half_width), number_with_error(row.worst, math.nan),
            str(row.pairs) if row.pairs == row.all_pairs else f"{row.pairs} of {row.all_pairs}",
        ]
        for row in numbers.itertuples()
    ]  # fmt: skip
    heads = ("assumption", "method", "skill with it", "without", "price", "worst", "pairs")
    return TextTable(heads, lines)
