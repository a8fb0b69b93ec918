"""The price of every assumption as bars, the dearest first, with their errors."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from malus.reports.figures.style import INK, PALETTE, SOFT, drawable, style
from malus.reports.tables.paper_table import number_with_error

_KINDS = {
    "truth": "the scene is otherwise",
    "input": "the method is told something wrong",
    "ladder": "estimated from the picture",
}
CUT = 1.2
"""Longest bar: a skill that is lost whole is 1, and what is worse than the guess costs more."""


def figure_prices(numbers: pd.DataFrame, method: str) -> Figure:
    """Loss of skill where each assumption is broken, from `prices`.

    Of `method`, or of the first one where an assumption is another's; without those that no pair
    prices.
    """
    first = numbers.groupby("assumption", sort=False).head(1)
    own = first[first["pairs"] > 0].sort_values("price", ascending=True)
    names = own["assumption"].where(
        own["method"] == method, own["assumption"] + ", " + own["method"]
    )
    colours = dict(zip(_KINDS, PALETTE, strict=False))
    with style():
        figure = Figure(figsize=(7.6, 0.34 * len(own) + 1.3), layout="constrained")
        ax = figure.subplots()
        for place, row in enumerate(own.itertuples()):
            shown = min(max(row.price, 0.0), CUT)
            ax.barh(place, shown, color=colours[row.kind], height=0.62)
            if row.price == shown and row.half_width == row.half_width:
                ends = max(row.price - row.half_width, 0.0), min(row.price + row.half_width, CUT)
                ax.hlines(place, *ends, color=INK, lw=1.1)
            text = number_with_error(row.price, row.half_width)
            ax.text(CUT * 1.02, place, drawable(text), va="center", fontsize="small", color=INK)
        ax.set_yticks(range(len(own)), [drawable(name) for name in names])
        ax.set_xlim(0.0, CUT * 1.34)
        ax.set_xticks([0.0, 0.25, 0.5, 0.75, 1.0])
        ax.axvline(1.0, color=SOFT, lw=1.0, ls="--")
        ax.set_xlabel(f"loss of skill of {drawable(method)}; 1 is all of it")
        ax.grid(axis="y", visible=False)
        handles = [Patch(color=colours[kind], label=label) for kind, label in _KINDS.items()]
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure
