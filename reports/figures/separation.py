"""Error of the specular lobe by each separation, by the colour of the body."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from malus.reports.figures.style import PALETTE, drawable, style
from malus.reports.tables.formats import scientific
from malus.reports.tables.rows import distinct

_STEP = 0.24
"""Distance between the separations of a colour; colours are 1 apart."""


def figure_separation(table: pd.DataFrame) -> Figure:
    """Points of all scenes and a bar at their median, a group a body colour, by separation."""
    colours, names = distinct(table["colour"]), distinct(table["separation"])
    with style():
        figure = Figure(figsize=(7.6, 3.8), layout="constrained")
        ax = figure.subplots()
        ax.set_yscale("log")
        for number, name in enumerate(names):
            shade = PALETTE[number % len(PALETTE)]
            for place, colour in enumerate(colours):
                own = table[(table["colour"] == colour) & (table["separation"] == name)]
                errors = own["rmse"].dropna().to_numpy(float)
                x = place + _STEP * (number - (len(names) - 1) / 2)
                spots = x + 0.07 * np.linspace(-1, 1, len(errors)) if len(errors) > 1 else [x]
                ax.plot(spots[: len(errors)], errors, ".", color=shade, markersize=3, alpha=0.55)
                if errors.size:
                    ax.hlines(np.median(errors), x - 0.1, x + 0.1, color=shade, lw=2.4, zorder=3)
            ax.plot([], [], color=shade, lw=2.4, label=drawable(name))
        ax.set_xticks(range(len(colours)), [drawable(c).replace("_", " ") for c in colours])
        ax.set_xlabel("colour of the body")
        ax.set_ylabel("rms error of I_s over its largest value")
        ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=30))
        ax.yaxis.set_minor_locator(NullLocator())
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: scientific(value)))
        ax.grid(axis="x", visible=False)
        figure.legend(loc="outside lower center", ncols=len(names))
    return figure
