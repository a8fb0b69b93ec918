"""The study of the paper's "normalised" in numbers: height and flatness of every data set."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from malus.reports.tables.formats import NO_NUMBER, scientific
from malus.reports.tables.rows import PAPER_METHOD, PAPER_NMSE, PAPER_RANGE, TRIVIAL, distinct
from malus.reports.tables.text_tables import TextTable

CHAIN = "paper"
"""The method that runs the paper's whole chain."""

FLAT = PAPER_NMSE[1] / PAPER_NMSE[0]
"""Largest over least of the paper's means: its Figure 5 is that flat in the index."""


def by_dataset(table: pd.DataFrame) -> pd.DataFrame:
    """Height and flatness of the errors of every reading, light and albedo.

    Returns
    -------
    DataFrame
        Columns reading, light, albedo; mean of `eq8`, its least and largest mean over materials
        (eta_low, eta_high) and over surfaces (alpha_low, alpha_high); guess and chain, the means of
        the trivial guess and of the paper's whole chain, failed, the objects of which the chain
        told nothing; height (mean in the paper's range), flat_eta and flat_alpha.

    Examples
    --------
    >>> sample = pd.DataFrame(
    ...     [("a", "uniform", 0.1, "eq8", "all", "", 0.0, 5e-3, 0.0, 2, 0)]
    ...     + [("a", "uniform", 0.1, "eq8", panel, "", x, mean, 0.0, 1, 0)
    ...        for panel in ("eta", "alpha") for x, mean in ((1.0, 4e-3), (2.0, 6e-3))],
    ...     columns=["reading", "light", "albedo", "method", "panel", "name", "x", "mean", "std",
    ...              "objects", "failed"])
    >>> by_dataset(sample)[["height", "flat_eta", "flat_alpha"]].values.tolist()
    [[True, True, True]]
    """
    keys = ["reading", "light", "albedo"]
    lines = [
        dict(zip(keys, key, strict=True)) | _dataset(rows)
        for key, rows in table.groupby(keys, sort=False)
    ]
    return pd.DataFrame(lines)


def _dataset(rows: pd.DataFrame) -> dict[str, Any]:
    oracle = rows[rows["method"] == PAPER_METHOD]
    means = {panel: part["mean"] for panel, part in oracle.groupby("panel")}
    mean = float(means["all"].iloc[0])
    eta, alpha = ((float(m.min()), float(m.max())) for m in (means["eta"], means["alpha"]))
    overall = rows[rows["panel"] == "all"].set_index("method")
    low, high = PAPER_NMSE
    return {
        "mean": mean,
        "eta_low": eta[0],
        "eta_high": eta[1],
        "alpha_low": alpha[0],
        "alpha_high": alpha[1],
        "guess": _of(overall, TRIVIAL, "mean"),
        "chain": _of(overall, CHAIN, "mean"),
        "failed": _of(overall, CHAIN, "failed"),
        "height": low <= mean <= high,
        # One index, of a reduced study, tells nothing of flatness.
        "flat_eta": len(means["eta"]) > 1 and eta[1] <= FLAT * eta[0],
        "flat_alpha": alpha[1] <= FLAT * alpha[0],
    }


def _of(overall: pd.DataFrame, method: str, column: str) -> float:
    return float(overall[column].get(method, float("nan")))


def reading_cells(datasets: pd.DataFrame) -> TextTable:
    """Height and flatness as people read them, a line a reading, light and albedo."""
    heads = (
        "reading", "light", "albedo", "eq8, mean", "by index", "by roughness", "trivial guess",
        "paper's chain", "like the paper's",
    )  # fmt: skip
    return TextTable(heads, [_line(row) for row in datasets.to_dict("records")])


def _line(row: dict[str, Any]) -> list[str]:
    alike = {"height": "height", "flat_eta": "flat in index", "flat_alpha": "flat in roughness"}
    ranges = [
        f"{scientific(row[f'{panel}_low'])} … {scientific(row[f'{panel}_high'])}"
        for panel in ("eta", "alpha")
    ]
    chain = NO_NUMBER if row["chain"] != row["chain"] else scientific(row["chain"])
    said = ", ".join(words for name, words in alike.items() if row[name]) or "nothing"
    return [
        str(row["reading"]), str(row["light"]), f"{row['albedo']:g}", scientific(row["mean"]),
        *ranges, scientific(row["guess"]), chain, said,
    ]  # fmt: skip


def verdicts(datasets: pd.DataFrame) -> list[str]:
    """Which readings and scenes reach the paper's height and flatness, in words."""
    whole = datasets[datasets["height"] & datasets["flat_eta"] & datasets["flat_alpha"]]
    lines = [
        f"The paper: {PAPER_RANGE} over the index, and no more change over the roughness. Of"
        f" {len(datasets)} data sets (reading, light and albedo), eq8's mean is in that range in"
        f" {int(datasets['height'].sum())}; it is as flat over the index in"
        f" {int((datasets['height'] & datasets['flat_eta']).sum())} of these, and over the"
        f" roughness too in {len(whole)}."
    ]
    lines += [f"Reached: {_where(row)}." for row in whole.to_dict("records")]
    if whole.empty:
        ratio = datasets["alpha_high"] / datasets["alpha_low"]
        nearest = datasets.assign(ratio=ratio)[datasets["height"] & datasets["flat_eta"]]
        lines += [
            f"Nearest: {_where(row)}; over the roughness the largest is {row['ratio']:.0f} times"
            " the least."
            for row in nearest.sort_values("ratio").head(3).to_dict("records")
        ]
    better = datasets[(datasets["guess"] > datasets["mean"]) & datasets["flat_eta"]]
    off = np.abs(np.log(better["mean"] / math.sqrt(PAPER_NMSE[0] * PAPER_NMSE[1])))
    lines += [
        f"Nearest in height where eq8 beats the guess and is as flat over the index: {_where(row)}."
        for row in better.assign(off=off)
        .sort_values("off", kind="stable")
        .head(1)
        .to_dict("records")
    ]
    chain = datasets[datasets["chain"].between(*PAPER_NMSE)]
    scenes = [
        f"{row['reading']}, {row['light']}, albedo {row['albedo']:g} ({scientific(row['chain'])},"
        f" the guess {scientific(row['guess'])})"
        for row in chain.to_dict("records")
    ]
    where = f": {'; '.join(scenes)}" if scenes else ""
    lines.append(f"The mean of the paper's whole chain is in the range in {len(chain)}{where}.")
    by_reading = datasets[datasets["height"]].groupby("reading").size()
    counted = [f"{name} ({by_reading[name]})" for name in distinct(datasets["reading"])
               if name in by_reading]  # fmt: skip
    return [*lines, f"Readings that have the height somewhere: {'; '.join(counted) or 'none'}."]


def _where(row: dict[str, Any]) -> str:
    return (
        f"{row['reading']}, {row['light']}, albedo {row['albedo']:g}: eq8 {scientific(row['mean'])}"
        f" ({scientific(row['eta_low'])} … {scientific(row['eta_high'])} by index,"
        f" {scientific(row['alpha_low'])} … {scientific(row['alpha_high'])} by roughness), the"
        f" guess {scientific(row['guess'])}, the paper's chain {scientific(row['chain'])}"
    )
