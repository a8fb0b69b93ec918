"""The paper's Figure 9: colour difference against the polariser's angle."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from malus.reports.figures.figure5 import FigureContent, legend
from malus.reports.figures.panels import side_step, title
from malus.reports.figures.style import SOFT, style
from malus.reports.tables.colour_errors import figure9_numbers
from malus.reports.tables.rows import distinct, scored_methods
from malus.scenes.colour import JUST_NOTICEABLE

_SHIFT_DEG = 1.2
"""Distance between the methods' error bars at one angle, where there is room."""


def figure9(table: pd.DataFrame, body: str) -> Figure:
    """ΔE76 over the polariser angle, a panel a light, a line a method."""
    content = FigureContent.of(table, body)
    values = figure9_numbers(content.rows)
    step = side_step(values["x"], len(content.methods), _SHIFT_DEG)
    lights = distinct(values["light"])
    with style():
        size = (max(1.4 + 1.9 * len(lights), 6.5), 3.4)
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(1, len(lights), sharey=True, squeeze=False)[0]
        for ax, light in zip(axes, lights, strict=True):
            for number, (method, method_style) in enumerate(content.methods.items()):
                rows = values[(values["light"] == light) & (values["method"] == method)]
                shift = (number - (len(content.methods) - 1) / 2) * step
                ax.errorbar(
                    rows["x"] + shift, rows["mean"], rows["std"],
                    fmt=method_style.marker + method_style.line,
                    color=method_style.colour, markerfacecolor=method_style.face, elinewidth=0.8,
                )  # fmt: skip
            ax.axhline(JUST_NOTICEABLE, color=SOFT, lw=0.8, ls="--")
            title(ax, light)
            ax.set_xlabel("polariser angle ϑ (°)")
            ax.set_xticks(sorted(values["x"].unique()))
        axes[0].set_ylim(bottom=0.0)  # of all panels, once everything is drawn
        axes[0].set_ylabel("ΔE76, mean ± std over pixels")
        axes[-1].annotate(  # beside the panel: inside, some curve runs through it
            "1 JND", (1.0, JUST_NOTICEABLE), (2, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="center", fontsize=6.5, color=SOFT,
        )  # fmt: skip
        methods = scored_methods(content.rows)
        legend(figure, axes[0], content, methods, note="", over="the pixels of ")
    return figure
