"""Table I and Figure 9 of the paper: colour differences and NMSE of I_max, I_min and I(ϑ)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import pandas as pd

from malus.reports.tables.formats import NO_NUMBER, scientific
from malus.reports.tables.rows import overall_rows, rows_by_angle, scored_methods
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
_COLUMNS = ["body", "method", "formula", "image", "mean", "std", "scene_std", "noise", "scenes"]


def table1(table: pd.DataFrame) -> pd.DataFrame:
    """Colour differences and squared errors of every body and method over all scenes.

    Returns
    -------
    DataFrame
        One row a body × method × formula × image, columns body, method, formula (ΔE76, ΔE2000 or
        NMSE), image, mean, std (over the pixels of all scenes, each scene counted alike; missing
        for NMSE), scene_std (of the scenes' means), noise (mean of a perfect method) and scenes.
        Empty where the run did not ask for colour differences.

    Examples
    --------
    >>> from malus.reports.tables.sample import coloured
    >>> errors = table1(coloured())
    >>> errors[["method", "formula", "image", "mean", "std", "scene_std"]].values.tolist()[0]
    ['unpolarised', 'ΔE76', 'I_max', 3.0, 1.0, 0.0]
    """
    differences = {name + ending for name in _COLOURS for ending in _IMAGES}
    if not table["metric"].isin(differences).any():
        return pd.DataFrame(columns=_COLUMNS)
    errors = pd.concat(
        _pooled(table, overall_rows, name + ending, ["body", "method"]).assign(
            formula=formula, image=image
        )
        for name, formula in (*_COLOURS.items(), ("nmse", _ERROR))
        for ending, image in _IMAGES.items()
    )
    order = {name: number for number, name in enumerate(scored_methods(table))}
    errors = errors.assign(order=errors["method"].map(order))
    errors = errors.sort_values(["body", "order"], kind="stable", ignore_index=True)
    return errors[_COLUMNS]


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
        mean=("value", "mean"),
        variance=("variance", lambda values: values.mean(skipna=False)),
        scene_std=("value", lambda values: values.std(ddof=0)),
        noise=("noise", "mean"),
        scenes=("value", "size"),
    ).reset_index()
    std = (result["variance"] + result["scene_std"] ** 2) ** 0.5
    return result.assign(std=std).drop(columns="variance")


def table1_text(errors: pd.DataFrame) -> TextTable:
    """Table I as text, the paper's own numbers last; without a line where no colour was scored."""
    pairs = list(dict.fromkeys(zip(errors["formula"], errors["image"], strict=True)))
    heads = ("body", "method", "scenes", *(f"{formula} of {image}" for formula, image in pairs))
    lines = []
    for (body, method), rows in errors.groupby(["body", "method"], sort=False):
        cells = {(row.formula, row.image): _cell(row) for row in rows.itertuples()}
        texts = [cells.get(pair, NO_NUMBER) for pair in pairs]
        lines.append([str(body), str(method), str(rows["scenes"].max()), *texts])
    if lines:
        for source, printed in PAPER_TABLE1.items():
            texts = [printed.get(pair, NO_NUMBER) for pair in pairs]
            lines.append([NO_NUMBER, source, NO_NUMBER, *texts])
    return TextTable(heads, lines)


def _cell(row: Any) -> str:
    """Mean ± standard deviation over pixels (that over scenes)."""
    if not math.isfinite(row.mean):
        return "not finite"
    if row.formula == _ERROR:
        return f"{scientific(row.mean)} ({scientific(row.scene_std)})"
    return f"{row.mean:.2f} ± {row.std:.2f} ({row.scene_std:.2f})"
