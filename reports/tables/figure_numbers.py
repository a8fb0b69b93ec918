"""The numbers behind the figures, without what draws them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import pandas as pd

from malus.reports.tables.rows import (
    KNOWLEDGE,
    PAPER_METHOD,
    complete_mean,
    distinct,
    overall_rows,
    overall_rows_at_every_rung,
    rows_by_angle,
    scored_methods,
)

X_ETA, X_ALPHA = "eta", "alpha"
OWN_RANGE = "nmse_own_range"
"""Metric of the second curve: the likeliest other meaning of the paper's "normalised"."""
OWN_RANGE_LABEL = "each image to [0, 1] by its own range"
NOISE, MODEL = "Monte Carlo noise", "model form"
_GIVEN, _ESTIMATED = " given", " estimated"
"""Ends of the names of rungs on which one thing more is given, and of what estimating it costs."""
_COLUMNS = {X_ETA: "material", X_ALPHA: "surface"}


def numbers(
    table: pd.DataFrame, x: str, by_light: bool = False, metric: str = "nmse"
) -> pd.DataFrame:
    """Mean and standard deviation of NMSE over the dataset at every x.

    Parameters
    ----------
    table : DataFrame
        Of a run.
    x : "eta" or "alpha"
    by_light : bool
        Every light for itself instead of all together.
    metric : str

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
    rows = overall_rows(table, metric)
    if not by_light:
        rows = rows.assign(light="all")
    groups = rows.groupby(["light", "method", _COLUMNS[x], x], sort=False)
    result = _of_groups(groups).reset_index()
    order = {name: number for number, name in enumerate(scored_methods(table))}
    result = result.rename(columns={_COLUMNS[x]: "name", x: "x"})
    result = result.assign(panel=x, order=result["method"].map(order))
    columns = ["panel", "light", "method", "name", "x", "mean", "std", "noise", "scenes"]
    return result.sort_values(["light", "order", "x"], kind="stable")[columns]


def _of_groups(groups: Any) -> pd.DataFrame:
    """Mean, standard deviation of the population, mean noise, and number of each group's values."""
    values = groups["value"]
    spread = values.agg(lambda group: group.std(ddof=0, skipna=False))
    columns = {"mean": values.agg(complete_mean), "std": spread}
    return pd.DataFrame(columns | {"noise": groups["noise"].mean(), "scenes": values.size()})


def own_range(table: pd.DataFrame, x: str, by_light: bool = False) -> pd.DataFrame:
    """The same numbers with each image scaled by its own range, of the paper's method alone.

    Empty where a run did not measure them.
    """
    values = numbers(table[table["method"] == PAPER_METHOD], x, by_light, OWN_RANGE)
    return values.assign(method=f"{PAPER_METHOD}, {OWN_RANGE_LABEL}")


def both_panels(table: pd.DataFrame, by_light: bool = False) -> pd.DataFrame:
    """The numbers behind both panels of Figure 5, as one table; last those of the second curve."""
    made = [make(table, x, by_light) for make in (numbers, own_range) for x in (X_ETA, X_ALPHA)]
    return pd.concat([rows for rows in made if len(rows)])


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
    return _of_groups(groups).reset_index().rename(columns={"angle_deg": "x"})


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
