"""The numbers behind the figures, without what draws them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from malus.reports.tables.rows import (
    KNOWLEDGE,
    distinct,
    overall_rows,
    overall_rows_at_every_rung,
    rows_by_angle,
    scored_methods,
)

X_ETA, X_ALPHA = "eta", "alpha"
NOISE, MODEL = "Monte Carlo noise", "model form"
_COLUMNS = {X_ETA: "material", X_ALPHA: "surface"}


def numbers(table: pd.DataFrame, x: str, by_light: bool = False) -> pd.DataFrame:
    """Mean and standard deviation of NMSE over the dataset at every x.

    Parameters
    ----------
    table : DataFrame
        Of a run.
    x : "eta" or "alpha"
    by_light : bool
        Every light for itself instead of all together.

    Returns
    -------
    DataFrame
        One row a method and x: panel, light, method, name, x, mean, std (of the population),
        noise (expected Monte Carlo part of the mean) and scenes.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> numbers(table(), "alpha")[["method", "name", "scenes"]].values.tolist()[0]
    ['unpolarised', 'obsidian', 6]
    """
    rows = overall_rows(table, "nmse")
    if not by_light:
        rows = rows.assign(light="all")
    groups = rows.groupby(["light", "method", _COLUMNS[x], x], sort=False)
    result = groups.agg(
        mean=("value", "mean"),
        std=("value", _population_std),
        noise=("noise", "mean"),
        scenes=("value", "size"),
    ).reset_index()
    order = {name: number for number, name in enumerate(scored_methods(table))}
    result = result.rename(columns={_COLUMNS[x]: "name", x: "x"})
    result = result.assign(panel=x, order=result["method"].map(order))
    columns = ["panel", "light", "method", "name", "x", "mean", "std", "noise", "scenes"]
    return result.sort_values(["light", "order", "x"], kind="stable")[columns]


def _population_std(values: pd.Series[float]) -> float:
    return float(values.std(ddof=0))


def both_panels(table: pd.DataFrame, by_light: bool = False) -> pd.DataFrame:
    """The numbers behind both panels of Figure 5, as one table."""
    return pd.concat([numbers(table, x, by_light) for x in (X_ETA, X_ALPHA)])


def angle_numbers(table: pd.DataFrame) -> pd.DataFrame:
    """Mean and standard deviation of NMSE over the scenes of a light, at every polariser angle.

    Returns
    -------
    DataFrame
        Columns light, method, x (degrees from the vertical), mean, std, noise and scenes.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> angle_numbers(table())[["method", "x", "scenes"]].values.tolist()[0]
    ['unpolarised', 0.0, 6]
    """
    groups = rows_by_angle(table, "nmse").groupby(["light", "method", "angle_deg"], sort=False)
    result = groups.agg(
        mean=("value", "mean"),
        std=("value", lambda values: float(np.std(values))),
        noise=("noise", "mean"),
        scenes=("value", "size"),
    )
    return result.reset_index().rename(columns={"angle_deg": "x"})


def ladder_numbers(table: pd.DataFrame) -> pd.DataFrame:
    """The error of every method in parts that add up to it.

    The first part is the noise of the truth, the second what is left with everything known, and
    every further one is what the mean NMSE grows by (or shrinks, then below zero) with the next
    rung: the levels of knowledge in the order of the table. Only scenes on which a method has an
    error at all of its rungs count.

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
    rungs = sorted(distinct(rows["knowledge"]), key=lambda name: name != KNOWLEDGE)
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
    errors = errors.dropna()
    if len(levels) < 2 or KNOWLEDGE not in levels or errors.empty:
        return
    everything = rows[rows["knowledge"] == KNOWLEDGE].set_index("scene")
    noise = float(everything.loc[errors.index, "noise"].mean())
    means = [noise, *(float(errors[name].mean()) for name in levels)]
    sources = [NOISE, MODEL, *levels[1:]]
    for source, before, after in zip(sources, [0.0, *means], means, strict=False):
        yield {
            "body": body, "method": method, "source": source,
            "increment": after - before, "nmse": after, "scenes": len(errors),
        }  # fmt: skip
