"""What the paper's "normalised" may mean: every reading, light and albedo beside its Figure 5."""

from __future__ import annotations

import textwrap

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from malus.reports.figures.panels import shade_paper
from malus.reports.figures.style import INK, PALETTE, SOFT, drawable, power_of_ten, style
from malus.reports.tables.readings import by_dataset
from malus.reports.tables.rows import PAPER_RANGE, distinct
from malus.scenes.core.errors import counted

FLOOR, CEILING = 1e-7, 3.0
"""Errors below the floor are drawn on it, as triangles: they are zero but for rounding."""
_COLUMNS = 5
_STEP = 0.19
"""Distance between the albedos of a light; lights are 1 apart."""


def figure_readings(table: pd.DataFrame) -> Figure:
    """Errors of `eq8`, the paper's chain and the guess by light and albedo, a panel a reading.

    Wide bars run over the means of all indices, thin ones over those of all roughnesses: where both
    lie in the shaded band, the paper's height and flatness are reached.
    """
    datasets = by_dataset(table)
    readings = distinct(datasets["reading"])
    rows = -(-len(readings) // _COLUMNS)
    with style():
        figure = Figure(figsize=(12.0, 1.0 + 3.5 * rows), layout="constrained")
        grid = figure.subplots(rows, _COLUMNS, sharey=True, squeeze=False)
        for spare in grid.flat[len(readings) :]:
            spare.set_visible(False)
        for ax, reading in zip(grid.flat, readings, strict=False):
            _panel(ax, datasets[datasets["reading"] == reading])
            ax.set_title("\n".join(map(drawable, textwrap.wrap(reading, 30))), fontsize=9)
        for line in grid:
            line[0].set_ylabel("mean squared error, normalised so")
        indices = table.loc[table["panel"] == "eta", "x"].nunique()
        _legend(figure, grid[0, 0], list(datasets["albedo"].unique()), indices)
    return figure


def _panel(ax: Axes, datasets: pd.DataFrame) -> None:
    ax.set_yscale("log")
    shade_paper(ax)
    lights, albedos = distinct(datasets["light"]), list(datasets["albedo"].unique())
    for row in datasets.itertuples():
        number = albedos.index(row.albedo)
        x = lights.index(row.light) + _STEP * (number - (len(albedos) - 1) / 2)
        colour = PALETTE[number % len(PALETTE)]
        ax.vlines(x, *_drawn(row.alpha_low, row.alpha_high), color=colour, lw=1.0, zorder=2)
        ax.vlines(x, *_drawn(row.eta_low, row.eta_high), color=colour, lw=4.5, zorder=3)
        _mark(ax, x, row.chain, "D", colour, "white")
        _mark(ax, x, row.guess, "_", SOFT, SOFT)
    ax.set_ylim(FLOOR / 1.6, CEILING)
    ax.set_xlim(-0.5, len(lights) - 0.5)
    ax.set_xticks(range(len(lights)), [_short(light) for light in lights], fontsize=7)
    ax.yaxis.set_major_locator(LogLocator(numticks=12))
    ax.yaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
    ax.grid(axis="x", visible=False)


def _drawn(low: float, high: float) -> tuple[float, float]:
    """Both ends of a bar inside the panel, and apart enough to be seen."""
    low = float(np.clip(low, FLOOR, CEILING))
    return low, max(float(np.clip(high, FLOOR, CEILING)), 1.06 * low)


def _mark(ax: Axes, x: float, value: float, marker: str, colour: str, face: str) -> None:
    if not np.isfinite(value):
        return
    marker = marker if value > FLOOR else "v"
    ax.plot(
        [x], [float(np.clip(value, FLOOR, CEILING))], marker, color=colour, markerfacecolor=face,
        markersize=6 if marker == "_" else 4, markeredgewidth=1.4 if marker == "_" else 0.9,
        zorder=4,
    )  # fmt: skip


def _short(light: str) -> str:
    return "all\naround" if light == "uniform" else f"lamp\n{drawable(light.split()[-1])}"


def _legend(figure: Figure, ax: Axes, albedos: list[float], indices: int) -> None:
    handles = [ax.vlines([], 0, 1, color=PALETTE[k], lw=4.5) for k in range(len(albedos))]
    labels = [f"body's albedo {albedo:g}" for albedo in albedos]
    more = {
        f"eq8, all inputs true: means over {counted(indices, 'index', 'indices')}": ax.vlines(
            [], 0, 1, color=INK, lw=4.5
        ),
        "eq8: means over the 5 roughnesses": ax.vlines([], 0, 1, color=INK, lw=1.0),
        "the paper's whole chain, from the picture alone": ax.plot(
            [], [], "D", color=INK, markerfacecolor="white", markersize=4
        )[0],
        "the guess “unpolarised”, which knows nothing": ax.plot(
            [], [], "_", color=SOFT, markersize=8, markeredgewidth=1.6
        )[0],
        f"the paper's Figure 5: {PAPER_RANGE}, whatever the index and roughness": ax.axhspan(
            np.nan, np.nan, color="#f0e3b8"
        ),
        "below the panel: zero but for rounding": ax.plot([], [], "v", color=INK, markersize=4)[0],
    }
    figure.legend([*handles, *more.values()], [*labels, *more], loc="outside lower center", ncols=3)
