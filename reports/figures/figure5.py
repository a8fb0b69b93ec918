"""The paper's Figure 5: error against refractive index, and against roughness."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from malus.reports.figures.panels import (
    bars,
    label_above,
    name_paper,
    shade_paper,
    share_height,
    side_step,
    title,
)
from malus.reports.figures.style import INK, MethodStyle, drawable, method_styles, style
from malus.reports.tables.figure_numbers import X_ALPHA, X_ETA, numbers, own_range
from malus.reports.tables.formats import scientific
from malus.reports.tables.rows import (
    PAPER_METHOD,
    TRIVIAL,
    Coverage,
    coverages,
    distinct,
    is_of_captures,
    overall_rows,
    rows_of_body,
    scored_methods,
    unverified_surfaces,
)
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import counted
from malus.scenes.materials.surface import body_text

_AXES = {
    X_ETA: "refractive index η, mean over the bands (relative to air)",
    X_ALPHA: "roughness α (of Beckmann facets the rms slope)",
}
_SHORT_AXES = {X_ETA: "refractive index η", X_ALPHA: "roughness α"}
_ERROR = "normalised mean squared error"
NOISE = "expected Monte Carlo noise, largest of any method"
ENDLESS = "\nA dotted bar has its lower end below zero, where a logarithmic axis has no place."
_LETTERS_AN_INCH = 15
"""Letters of a caption to an inch; DejaVu Sans at 7 points has 18 of middling width."""
_HANDLE_INCHES = 0.5
"""Width of a legend's line and its margins."""
_SHIFT = 0.008
"""Distance between the methods' error bars at one x, as a part of the axis' width, where there is
room."""
_LEGEND_INCHES = 1.1
"""Height of a legend and its caption that every figure has room for."""
_MOST_MATERIALS, _MOST_SURFACES = 25, 12
"""Names along an axis; where there are more they would run into each other."""


@dataclass(frozen=True)
class FigureContent:
    """What a figure shows: the table's rows of one body, and its methods with their looks."""

    rows: pd.DataFrame
    methods: dict[str, MethodStyle]

    @classmethod
    def of(cls, table: pd.DataFrame, body: str) -> FigureContent:
        """The rows of one body, and looks for its methods."""
        rows = rows_of_body(table, body)
        return cls(rows, method_styles(scored_methods(rows)))


def figure5(table: pd.DataFrame, body: str) -> Figure:
    """NMSE against η (top) and α (bottom), a line a method: means over all other parameters."""
    content = FigureContent.of(table, body)
    with style():
        figure = Figure(figsize=(7.1, 7.6), layout="constrained")
        axes: list[Axes] = list(figure.subplots(2, 1))
        second = {x: own_range(content.rows, x) for x in (X_ETA, X_ALPHA)}
        for ax, x in zip(axes, (X_ETA, X_ALPHA), strict=True):
            values = numbers(content.rows, x)
            _draw(ax, values, content)
            _draw_own_range(ax, second[x])
            ax.set_xlabel(_AXES[x] + _doubt(content.rows, x))
            ax.set_ylabel(_ERROR)
            label = _label_materials if x == X_ETA else _label_surfaces
            label(ax, values)
        share_height(axes, content.methods, _heights(second))
        name_paper(axes[:1])
        legend(figure, axes[0], content, _entries(content, second, axes))
    return figure


def figure5_by_light(table: pd.DataFrame, body: str) -> Figure:
    """NMSE against η and α for every light apart: lights as columns, one common scale."""
    content = FigureContent.of(table, body)
    lights = distinct(content.rows["light"])
    with style():
        size = (max(1.4 + 1.9 * len(lights), 6.5), 5.6)
        figure = Figure(figsize=size, layout="constrained")
        grid = figure.subplots(2, len(lights), sharey=True, sharex="row", squeeze=False)
        second = {x: own_range(content.rows, x, by_light=True) for x in (X_ETA, X_ALPHA)}
        for line, x in zip(grid, (X_ETA, X_ALPHA), strict=True):
            values = numbers(content.rows, x, by_light=True)
            line[0].set_ylabel(_ERROR)
            for ax, light in zip(line, lights, strict=True):
                _draw(ax, values[values["light"] == light], content)
                _draw_own_range(ax, second[x][second[x]["light"] == light])
                ax.set_xlabel(_SHORT_AXES[x])
        for ax, light in zip(grid[0], lights, strict=True):
            title(ax, light)
        share_height(list(grid.flat), content.methods, _heights(second))
        name_paper(list(grid[0]))
        legend(figure, grid[0, 0], content, _entries(content, second, list(grid.flat)))
    return figure


def _doubt(rows: pd.DataFrame, x: str) -> str:
    return "; values are unverified stand-ins" if x == X_ALPHA and unverified_surfaces(rows) else ""


def _draw(ax: Axes, values: pd.DataFrame, content: FigureContent) -> None:
    ax.set_yscale("log")
    shade_paper(ax)
    width = float(np.ptp(values["x"])) if len(values) else 0.0
    step = side_step(values["x"], len(content.methods), _SHIFT * width)
    middle = (len(content.methods) - 1) / 2
    for number, (method, method_style) in enumerate(content.methods.items()):
        rows = values[values["method"] == method]
        bars(ax, rows.assign(x=rows["x"] + (number - middle) * step), method_style)
    noise = values.groupby("x")["noise"].max()
    alone = "_" if len(noise) == 1 else ""  # a line of one point is none
    ax.plot(noise.index, noise.where(noise > 0), ":", marker=alone, color=INK, lw=0.9, zorder=1)


def _draw_own_range(ax: Axes, values: pd.DataFrame) -> None:
    """The second curve of the paper's method, where the run has its numbers."""
    if len(values):
        own = method_styles([PAPER_METHOD])[PAPER_METHOD]
        bars(ax, values, MethodStyle(own.colour, "*", "--", False))


def _heights(second: Mapping[str, pd.DataFrame]) -> list[float]:
    """Every mean of the second curve, from its numbers by axis."""
    return [float(mean) for values in second.values() for mean in values["mean"]]


def _entries(
    content: FigureContent, second: Mapping[str, pd.DataFrame], axes: Sequence[Axes]
) -> list[str]:
    """Entries of the legend, in the order in which the lines were drawn."""
    noise = np.concatenate([_noise_of(ax, content) for ax in axes])
    most = float(np.nanmax(noise, initial=0.0))
    seen = most >= axes[0].get_ylim()[0]
    where = f"below the panels: at most {scientific(most)}" if most else "none"
    noise_label = NOISE if seen else f"{NOISE}, {where}"
    return [*content.methods, noise_label, *distinct(second[X_ETA]["method"])]


def _noise_of(ax: Axes, content: FigureContent) -> Float64Array:
    """Heights of the line of noise, which is drawn after those of the methods."""
    return np.asarray(ax.get_lines()[len(content.methods)].get_ydata(), dtype=np.float64)


def _label_materials(ax: Axes, values: pd.DataFrame) -> None:
    names = values.drop_duplicates("name").sort_values("x")
    if len(names) > _MOST_MATERIALS:
        return
    labels = [_readable(name) for name in names["name"]]
    label_above(ax, names["x"].to_numpy(float), labels)


def _label_surfaces(ax: Axes, values: pd.DataFrame) -> None:
    pairs = values.drop_duplicates("name").groupby("x")["name"]
    names = {float(str(x)): [_readable(name) for name in surfaces] for x, surfaces in pairs}
    labels = ["\n".join([f"{x:g}", *surfaces]) for x, surfaces in names.items()]
    if sum(map(len, names.values())) <= _MOST_SURFACES:
        width = ax.get_figure(root=True).get_figwidth() / (1 + 2 * ax.margins()[0])
        ax.set_xticks(list(names), _apart(list(names), labels, width))


def _apart(places: Sequence[float], labels: Sequence[str], inches: float) -> list[str]:
    """Labels of ticks over so many inches, from the left; one that would touch the last is empty.

    Examples
    --------
    >>> _apart([0.1, 0.101, 0.5], ["0.1", "0.101", "0.5"], 6.0)
    ['0.1', '', '0.5']
    """
    scale, end, shown = inches / (float(np.ptp(places)) or 1.0), -np.inf, []
    for place, label in zip(places, labels, strict=True):
        half = 0.5 * max(map(len, label.splitlines())) / _LETTERS_AN_INCH
        fits = scale * place - half > end
        shown.append(label if fits else "")
        end = scale * place + half if fits else end
    return shown


def _readable(name: str) -> str:
    return drawable(name).replace("_", " ")


def legend(
    figure: Figure,
    ax: Axes,
    content: FigureContent,
    entries: Sequence[str],
    note: str = ENDLESS,
    over: str = "",
) -> None:
    """Put a legend below a figure; it names the lights where a method's mean lacks some.

    `over` is what means are over, such as "the pixels of ", in place of one value a scene.
    """
    column = int(_LETTERS_AN_INCH * (0.5 * figure.get_figwidth() - _HANDLE_INCHES))
    covered = coverages(content.rows)
    labels = [textwrap.fill(_legend_label(content, covered, entry), column) for entry in entries]
    # The caption is the legend's title, so that the layout keeps both apart from the panels.
    caption = textwrap.fill(
        _caption(content.rows, over), int(_LETTERS_AN_INCH * figure.get_figwidth())
    )
    _make_room(figure, labels, caption + note)
    figure.legend(
        ax.get_lines()[: len(labels)], labels, loc="outside lower center", ncols=2,
        title=caption + note, alignment="left",
    )  # fmt: skip


def _make_room(figure: Figure, labels: Sequence[str], title: str) -> None:
    """Make a figure higher by what its legend needs beyond the room that there is."""
    rows = -(-len(labels) // 2)
    columns = labels[:rows], labels[rows:]
    lines = max(sum(label.count("\n") + 1 for label in column) for column in columns)
    points = 8 * (1.2 * lines + 0.5 * rows) + 7 * 1.2 * (title.count("\n") + 1)
    figure.set_figheight(figure.get_figheight() + max(0.0, points / 72 - _LEGEND_INCHES))


def _legend_label(content: FigureContent, covered: Mapping[str, Coverage], method: str) -> str:
    if method not in covered:
        return method  # what is no method: the noise, and the second curve
    guess = " (trivial guess, I/2)" if method == TRIVIAL else ""
    errors = overall_rows(content.rows, "nmse")
    none = errors.loc[errors["method"] == method, "value"].isna().all()
    partial = "not finite" if none else str(covered[method])
    return drawable(f"{method}{guess}{f': {partial}' if partial else ''}")


def _few(column: pd.Series[str], noun: str) -> str:
    names = distinct(column)
    return f"{noun} {', '.join(names)}" if len(names) <= 6 else f"{len(names)} {noun}s"


def _caption(rows: pd.DataFrame, over: str) -> str:
    if is_of_captures(rows):
        captures = counted(rows["scene"].nunique(), "capture")
        names = distinct(rows["shape"])
        which = f": {', '.join(names)}" if len(names) <= 6 else ""
        of_what = f"{captures}{which}; {_few(rows['light'], 'group')}."
        return drawable(f"Mean ± standard deviation over {over}{of_what}")
    bodies = ", ".join(map(body_text, distinct(rows["body"])))
    return drawable(
        f"Mean ± standard deviation over {over}the scenes of each point,"
        f" {rows['scene'].nunique()} in all:"
        f" {_few(rows['shape'], 'shape')}; {_few(rows['light'], 'light')}; {bodies}."
    )
