"""Work-precision diagrams: error against run time, with the Pareto front marked."""

from __future__ import annotations

from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from malus.reports.figures.style import INK, SOFT, drawable, method_styles, power_of_ten, style

TITLES = {"ratio": "ρ of one surface", "render": "rendering a family"}
LABELS = {"ratio": "largest |Δρ|", "render": "rms error / peak"}


def figure_precision(table: pd.DataFrame) -> Figure:
    """Error against seconds, both logarithmic: a panel for each diagram of `malus run precision`.

    Points on the Pareto front are filled and joined; the others are hollow.
    """
    diagrams = list(dict.fromkeys(table["diagram"]))
    with style():
        rows = (len(diagrams) + 1) // 2
        figure = Figure(figsize=(9.0, 3.6 * rows), layout="constrained")
        panels = figure.subplots(rows, 2, squeeze=False).ravel()
        for spare in panels[len(diagrams) :]:
            spare.set_visible(False)
        for axes, name in zip(panels, diagrams, strict=False):
            _panel(axes, table[table["diagram"] == name], name)
    return figure


def _panel(axes: Any, part: pd.DataFrame, name: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    front = part[part["pareto"]].sort_values("seconds")
    axes.plot(front["seconds"], front["error"], color=SOFT, linewidth=1.0, zorder=1)
    styles = method_styles(list(dict.fromkeys(part["method"])))
    for number, row in enumerate(part.sort_values(["error", "seconds"]).itertuples()):
        own = styles[row.method]
        axes.errorbar(
            row.seconds,
            row.error,
            xerr=min(row.spread, 0.9 * row.seconds),
            fmt=own.marker,
            color=own.colour,
            markerfacecolor=own.colour if row.pareto else "white",
            markersize=5,
            zorder=2,
        )
        text = {"textcoords": "offset points", "fontsize": 6.5, "color": INK}
        # Neighbours in error take turns above and below, so that their names stay apart.
        offset = (4, 5 if number % 2 else -9)
        axes.annotate(
            drawable(row.setting or row.method), (row.seconds, row.error), xytext=offset, **text
        )
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(power_of_ten)
        axis.set_minor_formatter("")
    axes.set_title(drawable(TITLES.get(name, name)))
    axes.set_xlabel(drawable(f"seconds, {part['unit'].iloc[0]}"))
    axes.set_ylabel(LABELS.get(name, "NMSE without noise"))
    axes.margins(x=0.35, y=0.15)
