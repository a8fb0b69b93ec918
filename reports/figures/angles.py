"""Error, and colour difference as in the paper's Figure 9, against the polariser's angle."""

from __future__ import annotations

from collections.abc import Callable

import pandas as pd
from matplotlib.axes import Axes
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
from malus.reports.figures.style import SOFT, MethodStyle, style
from malus.reports.tables.colour_errors import figure9_numbers
from malus.reports.tables.figure_numbers import angle_numbers
from malus.reports.tables.rows import distinct, scored_methods
from malus.scenes.colour import JUST_NOTICEABLE

_SHIFT_DEG = 1.2
"""Distance between the methods' error bars at one angle, where there is room."""


def figure_angles(table: pd.DataFrame, body: str) -> Figure:
    """NMSE over the polariser angle, a panel a light, a line a method."""
    content = FigureContent.of(table, body)
    with style():
        figure, axes = _empty_panels(distinct(content.rows["light"]))
        for ax in axes.values():
            ax.set_yscale("log")
            shade_paper(ax)
        _draw(axes, angle_numbers(content.rows), content, bars)
        first, *_ = axes.values()
        first.set_ylabel("normalised mean squared error")
        share_height(list(axes.values()), content.methods)
        name_paper(list(axes.values()))
        legend(figure, first, content, scored_methods(content.rows))
    return figure


def figure9(table: pd.DataFrame, body: str) -> Figure:
    """ΔE76 over the polariser angle, a panel a light, a line a method."""
    content = FigureContent.of(table, body)
    values = figure9_numbers(content.rows)
    with style():
        figure, axes = _empty_panels(distinct(values["light"]))
        _draw(axes, values, content, _error_bars)
        for ax in axes.values():
            ax.axhline(JUST_NOTICEABLE, color=SOFT, lw=0.8, ls="--")
        first, last = next(iter(axes.values())), next(reversed(axes.values()))
        first.set_ylim(bottom=0.0)  # of all panels, once everything is drawn
        first.set_ylabel("ΔE76, mean ± std over pixels")
        last.annotate(  # beside the panel: inside, some curve runs through it
            "1 JND", (1.0, JUST_NOTICEABLE), (2, 0), xycoords=("axes fraction", "data"),
            textcoords="offset points", va="center", fontsize=6.5, color=SOFT,
        )  # fmt: skip
        methods = scored_methods(content.rows)
        legend(figure, first, content, methods, note="", over="the pixels of ")
    return figure


def _empty_panels(lights: list[str]) -> tuple[Figure, dict[str, Axes]]:
    """A figure with a panel for each light."""
    size = (max(1.4 + 1.9 * len(lights), 6.5), 3.4)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(1, len(lights), sharey=True, squeeze=False)[0]
    return figure, dict(zip(lights, axes, strict=True))


def _draw(
    axes: dict[str, Axes],
    values: pd.DataFrame,
    content: FigureContent,
    draw: Callable[[Axes, pd.DataFrame, MethodStyle], None],
) -> None:
    """Draw every method's line into the panel of each light, and name the panels."""
    step = side_step(values["x"], len(content.methods), _SHIFT_DEG)
    for light, ax in axes.items():
        for number, (method, method_style) in enumerate(content.methods.items()):
            rows = values[(values["light"] == light) & (values["method"] == method)]
            shift = (number - (len(content.methods) - 1) / 2) * step
            draw(ax, rows.assign(x=rows["x"] + shift), method_style)
        title(ax, light)
        ax.set_xlabel("polariser angle ϑ (°)")
        ax.set_xticks(sorted(values["x"].unique()))


def _error_bars(ax: Axes, rows: pd.DataFrame, method_style: MethodStyle) -> None:
    ax.errorbar(
        rows["x"], rows["mean"], rows["std"],
        fmt=method_style.marker + method_style.line,
        color=method_style.colour, markerfacecolor=method_style.face, elinewidth=0.8,
    )  # fmt: skip
