"""Parts of a panel with a logarithmic error axis."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from malus.reports.figures.style import BAND, SOFT, MethodStyle, drawable, power_of_ten
from malus.reports.tables.formats import scientific
from malus.reports.tables.rows import PAPER_NMSE, PAPER_RANGE
from malus.scenes.core.arrays import Float64Array

_MOST_OF_A_GAP = 0.3
"""Part of the distance between two x that the error bars at one of them may take."""

_TITLE_LETTERS = 23
"""Letters of a title in a line: panels are at least 1.9 inches wide."""

_MOST_BELOW = 5
"""Methods that are named at the foot of a panel; of more there is only the number."""

LOWEST = 1e-8
"""Errors below are rounding of 32-bit images; they are named at the foot of a panel, because an
axis that reached them would press everything else together."""

_PAPER_TEXT = "#7a6312"
_LABEL_HEIGHT = 1.045
"""Where labels above a panel begin, in heights of the panel."""


def bars(ax: Axes, rows: pd.DataFrame, method_style: MethodStyle) -> None:
    """Draw one method's line: markers at the means, bars of one standard deviation either way.

    A bar whose lower end is below zero has no end on a logarithmic axis: dotted, it runs off the
    panel.
    """
    x, mean, std = (rows[name].to_numpy(float) for name in ("x", "mean", "std"))
    positive = np.where(mean > 0, mean, np.nan)
    ax.plot(
        x, positive, method_style.line, color=method_style.colour, marker=method_style.marker,
        markerfacecolor=method_style.face, zorder=3,
    )  # fmt: skip
    ends = mean - std > 0
    bottom = np.where(ends, mean - std, positive)
    colour = method_style.colour
    _uprights(ax, x, bottom, mean + std, color=colour, lw=0.9, alpha=0.65, zorder=2)
    endless = x[~ends], np.full((~ends).sum(), 1e-30), positive[~ends]
    _uprights(ax, *endless, color=colour, lw=0.7, alpha=0.5, ls=(0, (1, 2)), zorder=1)


def _uprights(
    ax: Axes, x: Float64Array, bottom: Float64Array, top: Float64Array, **look: Any
) -> None:
    """Draw upright lines inside the panel's limits, which they do not change."""
    # Axes.vlines asks for units and new limits, which takes ten times as long.
    ends = np.stack([np.stack([x, bottom], -1), np.stack([x, top], -1)], axis=1)
    ax.add_collection(LineCollection(list(ends), **look), autolim=False)


def title(ax: Axes, light: str) -> None:
    """Name the light of a panel, in as many lines as its width asks for."""
    ax.set_title(textwrap.fill(drawable(light), _TITLE_LETTERS))


def side_step(x: pd.Series[float], methods: int, wanted: float) -> float:
    """Distance between the error bars of methods at one x, so that none comes near another x.

    All together take at most a part of the smallest distance between two x.

    Examples
    --------
    >>> side_step(pd.Series([0.0, 1.0, 3.0]), methods=2, wanted=0.5)
    0.3
    """
    gaps = np.diff(np.unique(x.to_numpy(float)))
    if methods < 2 or not len(gaps):
        return wanted
    return min(wanted, _MOST_OF_A_GAP * float(gaps.min()) / (methods - 1))


def share_height(
    axes: Sequence[Axes], methods: Mapping[str, MethodStyle], others: Sequence[float] = ()
) -> None:
    """Give all panels one range, with the paper's range and every error above `LOWEST` inside.

    The first lines of every panel are those of `methods`, in their order; `others` are errors of
    further lines.
    """
    lines = [line for ax in axes for line in ax.get_lines()[: len(methods)]]
    heights = [_heights(line.get_ydata()) for line in lines]
    errors = np.concatenate([*heights, PAPER_NMSE, others])
    errors = errors[np.isfinite(errors) & (errors > LOWEST)]
    low = 10.0 ** np.floor(np.log10(errors.min() / 1.5))
    high = 10.0 ** np.ceil(np.log10(errors.max() * 1.2))
    for ax in axes:
        ax.set_ylim(low, high)
        ax.yaxis.set_major_locator(LogLocator(numticks=12))
        ax.yaxis.set_minor_locator(NullLocator())
        ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
        _name_those_below(ax, methods, low)


def _heights(values: object) -> Float64Array:
    return np.asarray(values, dtype=np.float64)


def _name_those_below(ax: Axes, methods: Mapping[str, MethodStyle], low: float) -> None:
    """Write at the foot of a panel which methods have errors below it, and how small they are."""
    texts = []
    for (method, method_style), line in zip(methods.items(), ax.get_lines(), strict=False):
        y = _heights(line.get_ydata())
        below = y[np.isfinite(y) & (y < low)]
        if below.size:
            part = "" if below.size == np.isfinite(y).sum() else " in part"
            text = f"▼ {method}{part}: {scientific(below.min())} … {scientific(below.max())}"
            texts.append((text, method_style.colour))
    if len(texts) > _MOST_BELOW:
        texts[_MOST_BELOW - 1 :] = [(f"▼ {len(texts) - _MOST_BELOW + 1} more methods", SOFT)]
    for number, (text, colour) in enumerate(texts):
        ax.text(
            0.98, 0.03 + 0.08 * number, drawable(text), transform=ax.transAxes, ha="right",
            va="bottom", fontsize=7, color=colour, zorder=4, bbox=_PLATE,
        )  # fmt: skip


_PLATE = {"boxstyle": "square,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}


def shade_paper(ax: Axes) -> None:
    """Shade the range of the paper's Figure 5."""
    ax.axhspan(*PAPER_NMSE, color=BAND, lw=0, zorder=0)


def name_paper(axes: Sequence[Axes]) -> None:
    """Label the shaded band as the range of the paper's Figure 5, in the panel of most room."""
    ax = min(axes, key=_nearest_below_the_band)
    words = "range of the paper’s Figure 5" if len(axes) == 1 else "paper"
    ax.annotate(
        f"{words}: {PAPER_RANGE}", (0.012, PAPER_NMSE[0]), (0, -1.5),
        xycoords=("axes fraction", "data"), textcoords="offset points", va="top", fontsize=6.5,
        color=_PAPER_TEXT, zorder=4,
    )  # fmt: skip


def _nearest_below_the_band(ax: Axes) -> float:
    """The largest error of a panel that is not above the paper's range."""
    errors = np.concatenate([_heights(line.get_ydata()) for line in ax.get_lines()])
    below = errors[errors <= PAPER_NMSE[1]]
    return float(below.max(initial=0.0))


def label_above(ax: Axes, x: Float64Array, labels: Sequence[str]) -> None:
    """Write small upright labels along the top edge, pushed apart where their x lie close."""
    if not len(x):
        return
    low, high = ax.get_xlim()
    label_x = spread(x, (high - low) * 0.0185)
    transform = ax.get_xaxis_transform()
    for label, text_x in zip(labels, label_x, strict=True):
        ax.text(
            text_x, _LABEL_HEIGHT, label, transform=transform, rotation=90, ha="center",
            va="bottom", fontsize=6.2, color=SOFT,
        )  # fmt: skip
    pointers = [((a, 1.0), (b, _LABEL_HEIGHT)) for a, b in zip(x, label_x, strict=True)]
    lines = LineCollection(pointers, color=SOFT, lw=0.4, transform=transform, clip_on=False)
    lines.set_in_layout(False)  # all of them end at their labels
    ax.add_collection(lines, autolim=False)


def spread(positions: Float64Array, gap: float) -> Float64Array:
    """Increasing positions moved as little as possible until they are at least `gap` apart.

    Examples
    --------
    >>> spread(np.array([0.0, 0.0, 5.0]), 1.0).tolist()
    [-0.5, 0.5, 5.0]
    """
    if np.all(np.diff(positions) >= gap):
        return positions
    # Less their number times the gap, the positions only have to be in order.
    steps = gap * np.arange(len(positions))
    return _in_order(positions - steps) + steps


def _in_order(values: Float64Array) -> Float64Array:
    """The nearest values that do not decrease: neighbours that do are given their mean.

    Source: pool adjacent violators, Barlow et al., "Statistical Inference under Order Restrictions"
    (1972). scipy has it, at half a second of imports.
    """
    pools: list[tuple[float, int]] = []
    for value in values.tolist():
        mean, count = value, 1
        while pools and pools[-1][0] > mean:
            before, others = pools.pop()
            mean = (mean * count + before * others) / (count + others)
            count += others
        pools.append((mean, count))
    return np.repeat([mean for mean, _ in pools], [count for _, count in pools])
