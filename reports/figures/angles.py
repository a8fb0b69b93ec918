"""Error against the polariser's angle, for every light."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from malus.reports.figures.figure5 import FigureContent, legend
from malus.reports.figures.panels import (
    bars,
    name_paper,
    shade_paper,
    share_height,
    side_step,
    title,
)
from malus.reports.figures.style import style
from malus.reports.tables.figure_numbers import angle_numbers
from malus.reports.tables.rows import distinct, scored_methods

_SHIFT_DEG = 1.2
"""Distance between the methods' error bars at one angle, where there is room."""


def figure_angles(table: pd.DataFrame, body: str) -> Figure:
    """NMSE over the polariser angle, a panel a light, a line a method."""
    content = FigureContent.of(table, body)
    values = angle_numbers(content.rows)
    step = side_step(values["x"], len(content.methods), _SHIFT_DEG)
    lights = distinct(content.rows["light"])
    with style():
        size = (max(1.4 + 1.9 * len(lights), 6.5), 3.4)
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(1, len(lights), sharey=True, squeeze=False)[0]
        for ax, light in zip(axes, lights, strict=True):
            ax.set_yscale("log")
            shade_paper(ax)
            for number, (method, method_style) in enumerate(content.methods.items()):
                rows = values[(values["light"] == light) & (values["method"] == method)]
                shift = (number - (len(content.methods) - 1) / 2) * step
                bars(ax, rows.assign(x=rows["x"] + shift), method_style)
            title(ax, light)
            ax.set_xlabel("polariser angle ϑ (°)")
            ax.set_xticks(sorted(values["x"].unique()))
        axes[0].set_ylabel("normalised mean squared error")
        share_height(list(axes), content.methods)
        name_paper(list(axes))
        labels = scored_methods(content.rows)
        legend(figure, axes[0], content, labels)
    return figure
