"""The error budget: what a method's error grows by with each input that is estimated for it."""

from __future__ import annotations

from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from malus.reports.figures.style import INK, PALETTE, SOFT, drawable, style
from malus.reports.tables.formats import scientific
from malus.reports.tables.rows import distinct, rows_of_body
from malus.scenes.materials.surface import body_text


def figure_ladder(numbers: pd.DataFrame) -> Figure:
    """Stacked bars of the parts of each mean NMSE, a tick at their sum, one panel a body.

    Parameters
    ----------
    numbers : DataFrame
        As `ladder_numbers` returns it, with at least one row.
    """
    bodies = [rows_of_body(numbers, body) for body in distinct(numbers["body"])]
    sources = distinct(numbers["source"])
    colours = dict(zip(sources, (SOFT, *_cycled(len(sources) - 1)), strict=True))
    heights = [0.8 + 0.42 * rows["method"].nunique() for rows in bodies]
    with style():
        figure = Figure(figsize=(7.1, 0.7 + sum(heights)), layout="constrained")
        grid = figure.subplots(len(bodies), squeeze=False, height_ratios=heights)
        for ax, rows in zip(grid[:, 0], bodies, strict=True):
            _panel(ax, rows, colours)
        grid[-1, 0].set_xlabel("normalised mean squared error")
        handles: list[Any] = [grid[0, 0].barh(0, 0, color=colours[name]) for name in sources]
        labels = [drawable(source) for source in sources]
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _panel(ax: Axes, rows: pd.DataFrame, colours: dict[str, str]) -> None:
    methods = distinct(rows["method"])
    for y, method in enumerate(methods):
        _bar(ax, y, rows[rows["method"] == method], colours)
    ax.set_title(body_text(rows["body"].iloc[0]), loc="left")
    ax.set_yticks(range(len(methods)), [drawable(name) for name in _labels(rows)])
    ax.invert_yaxis()
    ax.axvline(0.0, color=INK, lw=0.7)
    ax.use_sticky_edges = False
    ax.margins(x=0.12)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: scientific(value)))
    ax.grid(axis="y", visible=False)


def _labels(rows: pd.DataFrame) -> list[str]:
    """Names of the methods, with their numbers of scenes where these differ: no bars to compare."""
    scenes = rows.groupby("method", sort=False)["scenes"].first()
    if scenes.nunique() == 1:
        return [str(method) for method in scenes.index]
    return [f"{method}, {count} scenes" for method, count in scenes.items()]


def _cycled(count: int) -> list[str]:
    return [PALETTE[k % len(PALETTE)] for k in range(count)]


def _bar(ax: Axes, y: int, rows: pd.DataFrame, colours: dict[str, str]) -> None:
    right = left = 0.0
    for row in rows.itertuples():
        start = right if row.increment >= 0 else left
        ax.barh(
            y, row.increment, 0.62, left=start, color=colours[row.source],
            edgecolor="white", lw=0.6, zorder=2,
        )  # fmt: skip
        right += max(row.increment, 0.0)
        left += min(row.increment, 0.0)
    total = float(rows["nmse"].iloc[-1])
    ax.plot([total, total], [y - 0.4, y + 0.4], color=INK, lw=1.4, zorder=3)
    ax.annotate(
        scientific(total), (max(right, total), y), (4, 0), textcoords="offset points",
        va="center", fontsize=7, color=INK,
    )  # fmt: skip
