"""The error budget: what a method's error grows by with each input that is estimated for it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from malus.reports.figures.style import INK, PALETTE, SOFT, drawable, style
from malus.reports.tables.formats import scientific
from malus.reports.tables.rows import KNOWLEDGE, distinct, overall_rows_at_every_rung, rows_of_body

NOISE, MODEL = "Monte Carlo noise", "model form"
_GIVEN, _ESTIMATED = " given", " estimated"
"""Ends of the names of rungs on which one thing more is given, and of what estimating it costs."""


def ladder_numbers(table: pd.DataFrame) -> pd.DataFrame:
    """The error of every method in parts that add up to it.

    The first part is the noise of the truth, the second what is left with everything known, and
    every further one is what the mean NMSE grows by (or shrinks, then below zero) with the next
    rung: the levels of knowledge in the order of the table, from the best informed. Only scenes on
    which a method has an error at all of its rungs count.

    Returns
    -------
    DataFrame
        Columns body, method, source, increment, nmse (the sum so far) and scenes; empty where the
        run has one level of knowledge.

    Examples
    --------
    >>> from malus.reports.tables.sample import laddered
    >>> parts = ladder_numbers(laddered())
    >>> parts[["source", "increment"]].round(4).values.tolist()[:3]
    [['Monte Carlo noise', 0.0], ['model form', 0.001], ['lobes estimated', 0.002]]
    """
    rows = overall_rows_at_every_rung(table, "nmse")
    # Of the whole table: where a method does not apply it has no error, but its rungs in order.
    rungs = sorted(distinct(table["knowledge"]), key=lambda name: name != KNOWLEDGE)
    parts: list[dict[str, Any]] = []
    for body in distinct(rows["body"]):
        for method in distinct(rows["method"]):
            own = rows[(rows["body"] == body) & (rows["method"] == method)]
            parts += _parts(own, rungs, body, method)
    columns = ["body", "method", "source", "increment", "nmse", "scenes"]
    return pd.DataFrame(parts, columns=columns)


def _parts(
    rows: pd.DataFrame, rungs: list[str], body: str, method: str
) -> Iterator[dict[str, Any]]:
    errors = rows.pivot(index="scene", columns="knowledge", values="value")
    levels = [name for name in rungs if name in errors]
    if any(name.endswith(_GIVEN) for name in levels):
        levels.reverse()  # a chain that climbs from the picture alone: the best informed first
    errors = errors.dropna()
    if len(levels) < 2 or KNOWLEDGE not in levels or errors.empty:
        return
    best = rows[rows["knowledge"] == levels[0]].set_index("scene")
    noise = float(best.loc[errors.index, "noise"].mean())
    means = [noise, *(float(errors[name].mean()) for name in levels)]
    sources = [NOISE, MODEL, *_estimated(levels)]
    for source, before, after in zip(sources, [0.0, *means], means, strict=False):
        yield {
            "body": body, "method": method, "source": source,
            "increment": after - before, "nmse": after, "scenes": len(errors),
        }  # fmt: skip


def _estimated(levels: list[str]) -> list[str]:
    """What is estimated at each level but the first: what the one before it was given last."""
    return [
        before.replace(_GIVEN, _ESTIMATED) if before.endswith(_GIVEN) else level
        for before, level in pairwise(levels)
    ]


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
    ax.set_title(f"{rows['body'].iloc[0]} body", loc="left")
    ax.set_yticks(range(len(methods)), [drawable(name) for name in methods])
    ax.invert_yaxis()
    ax.axvline(0.0, color=INK, lw=0.7)
    ax.use_sticky_edges = False
    ax.margins(x=0.12)
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: scientific(value)))
    ax.grid(axis="y", visible=False)


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
