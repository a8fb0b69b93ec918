"""Table I and Figure 9 of the paper: colour differences and NMSE of I_max, I_min and I(ϑ)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import pandas as pd

from malus.reports.tables.formats import NO_NUMBER, scientific
from malus.reports.tables.rows import (
    complete_mean,
    distinct,
    is_of_captures,
    overall_rows,
    rows_by_angle,
    scored_methods,
)
from malus.reports.tables.text_tables import TextTable

PAPER_TABLE1 = {
    "the paper, Indoor": {
        ("ΔE76", "I_max"): "2.09 ± 0.64", ("ΔE76", "I_min"): "1.24 ± 0.31",
        ("NMSE", "I_max"): "0.008 ± 0.0011", ("NMSE", "I_min"): "0.0040 ± 0.0011",
    },
    "the paper, Outdoor": {
        ("ΔE76", "I_max"): "4.40 ± 1.95", ("ΔE76", "I_min"): "4.44 ± 2.26",
        ("NMSE", "I_max"): "0.0716 ± 0.0473", ("NMSE", "I_min"): "0.0406 ± 0.0418",
    },
}  # fmt: skip
"""The paper's Table I as printed, by formula and image."""

_IMAGES = {"_i_max": "I_max", "_i_min": "I_min", "": "I(ϑ)"}
_COLOURS = {"delta_e76": "ΔE76", "delta_e2000": "ΔE2000"}
_ERROR = "NMSE"
_COLUMNS = ["method", "formula", "image", "mean", "std", "scene_std", "noise", "scenes"]
_PAPER_GROUPS = {"the paper, Indoor": "indoor", "the paper, Outdoor": "outdoor"}


def table1(table: pd.DataFrame) -> pd.DataFrame:
    """Colour differences and squared errors of every body and method over all scenes.

    Of captures, every group stands for itself in place of the body.

    Returns
    -------
    DataFrame
        One row a body × method × formula × image, columns body (of captures: group), method,
        formula (ΔE76, ΔE2000 or NMSE), image, mean, std (over the pixels of all scenes, each scene
        counted alike; missing for NMSE), scene_std (of the scenes' means), noise (mean of a perfect
        method) and scenes. Empty where the run did not ask for colour differences.

    Examples
    --------
    >>> from malus.reports.tables.sample import coloured
    >>> errors = table1(coloured())
    >>> errors[["method", "formula", "image", "mean", "std", "scene_std"]].values.tolist()[0]
    ['unpolarised', 'ΔE76', 'I_max', 3.0, 1.0, 0.0]
    """
    part, source = ("group", "light") if is_of_captures(table) else ("body", "body")
    differences = {name + ending for name in _COLOURS for ending in _IMAGES}
    if not table["metric"].isin(differences).any():
        return pd.DataFrame(columns=[part, *_COLUMNS])
    errors = pd.concat(
        _pooled(table, overall_rows, name + ending, [source, "method"])
        .rename(columns={source: part})
        .assign(formula=formula, image=image)
        for name, formula in (*_COLOURS.items(), ("nmse", _ERROR))
        for ending, image in _IMAGES.items()
    )
    order = {name: number for number, name in enumerate(scored_methods(table))}
    errors = errors.assign(order=errors["method"].map(order))
    errors = errors.sort_values([part, "order"], kind="stable", ignore_index=True)
    return errors[[part, *_COLUMNS]]


def figure9_numbers(table: pd.DataFrame) -> pd.DataFrame:
    """ΔE76 at every polariser angle, for every light.

    Returns
    -------
    DataFrame
        Columns light, method, x (degrees from the vertical), mean, std, scene_std, noise and
        scenes.
    """
    errors = _pooled(table, rows_by_angle, "delta_e76", ["light", "method", "angle_deg"])
    return errors.rename(columns={"angle_deg": "x"})


def _pooled(
    table: pd.DataFrame,
    select: Callable[[pd.DataFrame, str], pd.DataFrame],
    metric: str,
    keys: Sequence[str],
) -> pd.DataFrame:
    """Mean and standard deviation over the pixels of several scenes, each counted alike.

    The variance is the mean of the scenes' variances plus the variance of their means.
    """
    columns = ["scene", *keys]
    rows = select(table, metric)[[*columns, "value", "noise"]]
    spread = select(table, f"{metric}_std")[[*columns, "value"]]
    both = rows.merge(spread, on=columns, how="left", suffixes=("", "_std"))
    both = both.assign(variance=both["value_std"] ** 2)
    groups = both.groupby(list(keys), sort=False)
    result = groups.agg(
        mean=("value", complete_mean),
        variance=("variance", complete_mean),
        scene_std=("value", lambda values: values.std(ddof=0, skipna=False)),
        noise=("noise", "mean"),
        scenes=("value", "size"),
    ).reset_index()
    std = (result["variance"] + result["scene_std"] ** 2) ** 0.5
    return result.assign(std=std).drop(columns="variance")


def table1_text(errors: pd.DataFrame) -> TextTable:
    """`table1` as text, with the paper's numbers; without a line where no colour was scored.

    Those of the paper's two datasets stand below a group of captures of that name, or come last.
    """
    part = str(errors.columns[0])
    pairs = list(dict.fromkeys(zip(errors["formula"], errors["image"], strict=True)))
    counted = "captures" if part == "group" else "scenes"
    heads = (part, "method", counted, *(f"{formula} of {image}" for formula, image in pairs))
    lines = []
    for (name, method), rows in errors.groupby([part, "method"], sort=False):
        cells = {(row.formula, row.image): _cell(row) for row in rows.itertuples()}
        texts = [cells.get(pair, NO_NUMBER) for pair in pairs]
        lines.append([str(name), str(method), str(rows["scenes"].max()), *texts])
    for source, printed in PAPER_TABLE1.items() if lines else ():
        texts = [printed.get(pair, NO_NUMBER) for pair in pairs]
        group = _PAPER_GROUPS[source] if part == "group" else NO_NUMBER
        lines.append([group, source, NO_NUMBER, *texts])
    groups = [name.lower() for name in distinct(errors[part])] if part == "group" else []
    lines.sort(key=lambda line: _place(line[0].lower(), groups))
    return TextTable(heads, lines)


def _place(name: str, groups: Sequence[str]) -> int:
    """Place of a group, after all of them where there is none of that name."""
    return groups.index(name) if name in groups else len(groups)


def _cell(row: Any) -> str:
    """Mean ± standard deviation over pixels (that over scenes)."""
    if not math.isfinite(row.mean):
        return "not finite"
    if row.formula == _ERROR:
        return f"{scientific(row.mean)} ({scientific(row.scene_std)})"
    return f"{row.mean:.2f} ± {row.std:.2f} ({row.scene_std:.2f})"
