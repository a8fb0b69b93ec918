"""Tables of real captures: errors by group and by capture, objects, and how the pictures fit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pandas as pd

from malus.reports.tables.formats import NO_NUMBER, error_text, listed, scientific, skill_text
from malus.reports.tables.rows import (
    TRIVIAL,
    complete_mean,
    not_finite,
    overall_rows,
    scored_methods,
)
from malus.reports.tables.text_tables import TextTable
from malus.scenes.core.errors import counted


def by_group(table: pd.DataFrame) -> TextTable:
    """Errors and skill of every group and method: means, and the median and worst skill.

    Examples
    --------
    >>> from malus.reports.tables.sample import captured
    >>> by_group(captured()).lines[1][:4]
    ['indoor', 'eq8', '3 of 3', '7.4e-5 (1.5e-3)']
    """
    captures = table.groupby("light", sort=False)["scene"].nunique()
    lines = []
    for group, count in captures.items():
        for method in scored_methods(table):
            rows = table[(table["light"] == group) & (table["method"] == method)]
            nmse = _values(rows, "nmse")
            scenes = overall_rows(rows, "nmse")["scene"]
            guess = table[(table["method"] == TRIVIAL) & table["scene"].isin(scenes)]
            if len(nmse):
                means = [error_text(complete_mean(_values(part, "nmse"))) for part in (rows, guess)]
                lines.append([
                    str(group), method, f"{len(nmse)} of {count}", f"{means[0]} ({means[1]})",
                    *_skills(method, rows),
                    *(_colours(rows, guess, name) for name in ("i_max", "i_min")),
                ])  # fmt: skip
    heads = (
        "group", "method", "captures", "NMSE (of the guess there)", "skill median", "skill worst",
        "skill at the best scale, median", "ΔE76 of I_max (guess)", "ΔE76 of I_min (guess)",
    )  # fmt: skip
    return TextTable(heads, lines)


def _skills(method: str, rows: pd.DataFrame) -> list[str]:
    """Median and worst skill, and the median at the best scale; the guess has none.

    Neither has a method with an estimate that is not finite.
    """
    if method == TRIVIAL or not_finite(rows, overall_rows(rows, "skill")).any():
        return [NO_NUMBER] * 3
    skill, scaled = _values(rows, "skill"), _values(rows, "scaled_skill")
    return [skill_text(value) for value in (skill.median(), skill.min(), scaled.median())]


def _colours(rows: pd.DataFrame, guess: pd.DataFrame, name: str) -> str:
    """Mean ΔE76 of a method, and of the guess; a dash where the channels have no colour."""
    means = [complete_mean(_values(part, f"delta_e76_{name}")) for part in (rows, guess)]
    return NO_NUMBER if pd.isna(means[0]) else f"{means[0]:.2f} ({means[1]:.2f})"


def by_capture(table: pd.DataFrame) -> TextTable:
    """NMSE, skill, slope, rotation and scale of every method on every capture.

    Examples
    --------
    >>> from malus.reports.tables.sample import captured
    >>> by_capture(captured()).lines[1][:5]
    ['water', 'indoor', 'eq8', '6.7e-5', '1.0e-7']
    """
    heads = (
        "capture", "group", "method", "NMSE", "noise in it", "skill", "gain", "rotation",
        "best scale", "skill at it", "converged", "error² over stated",
    )  # fmt: skip
    lines = []
    for (name, group), captured in table.groupby(["surface", "light"], sort=False):
        for method in scored_methods(table):
            rows = captured[captured["method"] == method]
            nmse = overall_rows(rows, "nmse")
            if len(nmse):
                error, noise = (float(nmse[key].iloc[0]) for key in ("value", "noise"))
                errors = error_text(error), scientific(noise)
                lines.append([str(name), str(group), method, *errors, *_agreement(method, rows)])
    return TextTable(heads, lines)


def _agreement(method: str, rows: pd.DataFrame) -> list[str]:
    if method == TRIVIAL:
        return [NO_NUMBER] * 7
    first = {name: _values(rows, name) for name in _AGREEMENT}
    texts = [
        _AGREEMENT[name](float(v.iloc[0])) if len(v) else NO_NUMBER for name, v in first.items()
    ]
    converged = _values(rows, "converged")
    told = {0.0: "no", 1.0: "yes"}.get(float(converged.iloc[0]), "") if len(converged) else ""
    stated = _values(rows, "calibration")
    honest = f"{stated.iloc[0]:.2g}" if len(stated) else NO_NUMBER
    return [*texts, told or NO_NUMBER, honest]


def _slope(value: float) -> str:
    return NO_NUMBER if pd.isna(value) else f"{value:.2f}".replace("-", "−")


_AGREEMENT = {
    "skill": skill_text, "gain": _slope, "rotation": _slope, "scale": _slope,
    "scaled_skill": skill_text,
}  # fmt: skip
"""Metrics that say how an estimated field agrees with the true one, and how they are told."""


def by_object(table: pd.DataFrame) -> TextTable:
    """Skill of every method on every object of captures of several."""
    named = table[table["metric"].str.fullmatch(r"skill_object_\d+") & (table["method"] != TRIVIAL)]
    lines = []
    for (name, number), rows in named.groupby(["surface", "metric"], sort=False):
        values = dict(zip(rows["method"], rows["value"], strict=True))
        cells = [skill_text(values[m]) if m in values else NO_NUMBER for m in _guessing(table)]
        lines.append([str(name), str(number).rpartition("_")[2], *cells])
    return TextTable(("capture", "object", *_guessing(table)), lines)


def _guessing(table: pd.DataFrame) -> list[str]:
    return [method for method in scored_methods(table) if method != TRIVIAL]


def agreements(table: pd.DataFrame) -> Iterator[str]:
    """A sentence for every capture and method but the guess, the worst skill first: what made it.

    A skill just above 0 may come of a field that is right, or of one that is scaled to nothing.
    With the slope g of the estimate against the truth and the scale c that fits it best, the
    estimate's rms over the true one's is √(g / c), and their correlation √(g c) with the sign of g.
    """
    rows = overall_rows(table, "skill").sort_values("value")
    for row in rows[rows["method"] != TRIVIAL].to_dict("records"):
        told = f"{row['method']} on {row['surface']}: skill {skill_text(row['value'])}"
        same = table[(table["scene"] == row["scene"]) & (table["method"] == row["method"])]
        gain, scale = (float(_values(same, name).mean()) for name in ("gain", "scale"))
        if gain * scale > 0:
            size, correlation = (
                math.sqrt(gain / scale),
                math.copysign(math.sqrt(gain * scale), gain),
            )
            told += (
                f": its polarised light is {size:.2g} times the true one (rms), and correlates with"
                f" it by {_slope(correlation)}"
            )
        yield f"{told}."


def notes(table: pd.DataFrame) -> Iterator[str]:
    """A sentence for every capture on which a method could not work, or not on every object."""
    noted = table[table["note"] != ""].drop_duplicates(["scene", "method"])
    for row in noted.to_dict("records"):
        verb = "could not work on" if row["metric"] == "inapplicable" else "worked on a part of"
        yield f"{row['method']} {verb} {row['surface']}: {row['note']}."


def fits(run: dict[str, Any]) -> TextTable:
    """How well the sinusoid fits each capture's pictures, and what was taken for granted."""
    heads = (
        "capture", "group", "pictures", "residual", "clipped", "DoLP median, whole picture",
        "objects", "pixels scored", "values",
    )  # fmt: skip
    lines = []
    for capture in run["captures"]:
        fit, objects = capture["fit"], capture["objects"]
        lines.append([
            capture["name"], capture["group"], str(fit["pictures"]),
            f"{fit['relative_residual']:.2%}", f"{fit['clipped_share']:.2%}",
            f"{fit['median_dolp']:.3f}", str(len(objects)), f"{sum(objects):,}",
            fit["assumption"],
        ])  # fmt: skip
    return TextTable(heads, lines)


def conventions(run: dict[str, Any]) -> Iterator[str]:
    """Captures whose angles seem to be counted otherwise, in a sentence each."""
    for capture in run["captures"]:
        if doubt := capture.get("convention"):  # runs of earlier versions lack it
            yield f"{capture['name']}: {doubt}."


def fit_warnings(run: dict[str, Any]) -> Iterator[str]:
    """Why fits may be wrong, in a sentence each."""
    for capture in run["captures"]:
        for warning in capture["fit"]["warnings"]:
            yield f"{capture['name']}: {warning}."


def doubts(run: dict[str, Any]) -> Iterator[str]:
    """Hints and warnings of the fits, and captures that failed, in a sentence each."""
    yield from conventions(run)
    for capture in run["captures"]:
        for doubt in (*capture["fit"]["warnings"], *capture["fit"]["hints"]):
            yield f"{capture['name']}: {doubt}."
    for failure in run["failures"]:
        yield f"Left out, {failure}."


def what_was_run(run: dict[str, Any]) -> Iterator[str]:
    """Sentences on how many captures were scored, and with what."""
    groups = list(dict.fromkeys(capture["group"] for capture in run["captures"]))
    yield (
        f"{counted(len(run['captures']), 'capture')} in {counted(len(groups), 'group')}"
        f" ({listed(groups)}); {run['captures_failed']} left out."
    )
    versions = listed([f"{name} {version}" for name, version in run["versions"].items()])
    yield f"Finished {run['finished']}; {versions}."


def _values(rows: pd.DataFrame, metric: str) -> pd.Series[float]:
    return overall_rows(rows, metric)["value"]
