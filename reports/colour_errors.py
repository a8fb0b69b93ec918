"""The paper's Table I and Figure 9: colour differences of I_max, I_min and I(ϑ)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import pandas as pd

from malus.reports.listing import Listing
from malus.reports.tables import by_angle, in_order, methods_of, whole
from malus.reports.text import NOTHING

PAPER_TABLE1 = (
    ("the paper, Indoor", "2.09 ± 0.64", "1.24 ± 0.31"),
    ("the paper, Outdoor", "4.40 ± 1.95", "4.44 ± 2.26"),
)
"""ΔE76 of I_max and of I_min in the paper's Table I."""

_IMAGES = {"_i_max": "I_max", "_i_min": "I_min", "": "I(ϑ)"}
_FORMULAS = {"delta_e76": "ΔE76", "delta_e2000": "ΔE2000"}


def table1(table: pd.DataFrame) -> pd.DataFrame:
    """Colour differences of every body and method over all scenes.

    Returns
    -------
    DataFrame
        One row a body × method × formula × image, columns body, method, formula, image, mean,
        std (over the pixels of all scenes, each scene counted alike), noise (mean of a perfect
        method) and scenes. Empty where the run did not ask for these metrics.

    Examples
    --------
    >>> from malus.reports.sample import coloured
    >>> table1(coloured())[["method", "formula", "image", "mean", "std"]].values.tolist()[0]
    ['unpolarised', 'ΔE76', 'I_max', 3.0, 1.0]
    """
    found = pd.concat(
        _pooled(table, whole, name + ending, ["body", "method"]).assign(
            formula=formula, image=image
        )
        for name, formula in _FORMULAS.items()
        for ending, image in _IMAGES.items()
    )
    order = {name: place for place, name in enumerate(methods_of(table))}
    found = found.assign(order=found["method"].map(order))
    found = found.sort_values(["body", "order"], kind="stable", ignore_index=True)
    columns = ["body", "method", "formula", "image", "mean", "std", "noise", "scenes"]
    return found[columns]


def figure9_numbers(table: pd.DataFrame) -> pd.DataFrame:
    """ΔE76 at every polariser angle, for every light.

    Returns
    -------
    DataFrame
        Columns light, method, x (degrees from the vertical), mean, std, noise and scenes.
    """
    found = _pooled(table, by_angle, "delta_e76", ["light", "method", "angle_deg"])
    return found.rename(columns={"angle_deg": "x"})


def _pooled(
    table: pd.DataFrame,
    select: Callable[[pd.DataFrame, str], pd.DataFrame],
    metric: str,
    keys: Sequence[str],
) -> pd.DataFrame:
    """Mean and standard deviation over the pixels of several scenes, each counted alike."""
    columns = ["scene", *keys]
    rows = select(table, metric)[[*columns, "value", "noise"]]
    spread = select(table, f"{metric}_std")[[*columns, "value"]]
    both = rows.merge(spread, on=columns, suffixes=("", "_std"))
    both = both.assign(square=both["value"] ** 2 + both["value_std"] ** 2)
    groups = both.groupby(list(keys), sort=False)
    result = groups.agg(
        mean=("value", "mean"),
        square=("square", "mean"),
        noise=("noise", "mean"),
        scenes=("value", "size"),
    ).reset_index()
    variance = (result["square"] - result["mean"] ** 2).clip(lower=0.0)
    return result.assign(std=variance**0.5).drop(columns="square")


def table1_listing(table: pd.DataFrame) -> Listing:
    """Table I as cells, the paper's own lines last; no line without the metrics."""
    found = table1(table)
    asked = in_order(found["formula"])
    pairs = [(formula, image) for formula in asked for image in _IMAGES.values()]
    heads = ("body", "method", "scenes", *(f"{formula} of {image}" for formula, image in pairs))
    lines = []
    for (body, method), rows in found.groupby(["body", "method"], sort=False):
        cells = {(row.formula, row.image): row for row in rows.itertuples()}
        texts = [
            _mean_and_std(cells[pair].mean, cells[pair].std) if pair in cells else NOTHING
            for pair in pairs
        ]
        lines.append([str(body), str(method), str(rows["scenes"].max()), *texts])
    if lines:
        empty = [NOTHING] * (len(pairs) - 2)
        lines += [
            [NOTHING, who, NOTHING, i_max, i_min, *empty] for who, i_max, i_min in PAPER_TABLE1
        ]
    return Listing(heads, lines)


def _mean_and_std(mean: float, std: float) -> str:
    return f"{mean:.2f} ± {std:.2f}" if math.isfinite(mean) else "not finite"
