"""The tables of a report as text, not escaped: Markdown and HTML each do that their own way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from malus.reports.tables.formats import NO_NUMBER, error_text, markdown, scientific, skill_text
from malus.reports.tables.kept import kept
from malus.reports.tables.rows import (
    PAPER_NMSE,
    TRIVIAL,
    complete_mean,
    distinct,
    overall_rows,
    scored_methods,
)
from malus.reports.tables.skills import by_light_and_body, negative_skills, unreported_skills


@dataclass(frozen=True)
class TextTable:
    """A table of text: heads, and lines of as many cells."""

    heads: tuple[str, ...]
    lines: list[list[str]]

    def __bool__(self) -> bool:
        """Whether there is a line."""
        return bool(self.lines)


def as_markdown(table: TextTable) -> str:
    """The table in Markdown, every cell escaped.

    Examples
    --------
    >>> as_markdown(TextTable(("a", "b"), [["1", "*"]])).splitlines()[-1]
    '| 1 | \\\\* |'
    """
    lines = [[markdown(cell) for cell in line] for line in (table.heads, *table.lines)]
    rows = [lines[0], ["---"] * len(table.heads), *lines[1:]]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def beside_paper(table: pd.DataFrame) -> TextTable:
    """NMSE of every method and body as the paper's Figure 5 averages it.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> beside_paper(table()).lines[1][:3]
    ['unpolarised', 'eq8', '6.7e-5 … 8.0e-5']
    """
    rows = overall_rows(table, "nmse")
    lines = []
    for body, method in product(distinct(rows["body"]), scored_methods(table)):
        scored = rows[(rows["method"] == method) & (rows["body"] == body)]
        if len(scored):
            largest = float(scored["value"].max(skipna=False))  # of what is not finite: no number
            ranges = [range_of_means(scored, by) for by in ("material", "surface")]
            below = "yes" if largest < PAPER_NMSE[0] else "no"
            lines.append([body, method, *ranges, error_text(largest), below])
    heads = ("body", "method", "mean by material", "mean by surface", "worst scene")
    return TextTable((*heads, f"every scene below {PAPER_NMSE[0]:g}"), lines)


def by_method(numbers: pd.DataFrame) -> TextTable:
    """Mean ± standard deviation behind a figure: a line an x of its axis, a column a method."""
    means, spreads = numbers["mean"].map(error_text), " ± " + numbers["std"].map(scientific)
    cells = means + spreads.where(np.isfinite(numbers["mean"]), "")
    keys = [name for name in ("panel", "light", "name", "x") if name in numbers]
    wide = numbers.assign(cell=cells).pivot(index=keys, columns="method", values="cell")
    methods = distinct(numbers["method"])
    wide = wide[methods].fillna("not applicable").reset_index()
    wide["x"] = wide["x"].map("{:.4g}".format)
    return TextTable((*keys, *methods), [[str(v) for v in line] for line in wide.to_numpy()])


def budget(numbers: pd.DataFrame) -> TextTable:
    """The error budget: a line a body and method, a column a part of its error."""
    sources = distinct(numbers["source"])
    lines = []
    for (body, method), rows in numbers.groupby(["body", "method"], sort=False):
        parts = dict(zip(rows["source"], rows["increment"], strict=True))
        cells = [scientific(parts[name]) if name in parts else NO_NUMBER for name in sources]
        last = rows.iloc[-1]
        lines.append([body, method, *cells, scientific(float(last["nmse"])), str(last["scenes"])])
    return TextTable(("body", "method", *sources, "sum", "scenes"), lines)


def points(numbers: pd.DataFrame) -> TextTable:
    """Seconds and error of every setting in the work-precision diagrams."""
    lines = [
        [
            row["diagram"], row["method"], row["setting"],
            f"{scientific(row['seconds'])} ± {scientific(row['spread'])}", row["unit"],
            scientific(row["error"]), "yes" if row["pareto"] else "no",
        ]
        for row in _records(numbers)
    ]  # fmt: skip
    heads = ("diagram", "method", "setting", "seconds", "for", "error", "on the front")
    return TextTable(heads, lines)


def range_of_means(rows: pd.DataFrame, by: str) -> str:
    """Smallest and largest mean of the groups of a column, as text."""
    means = rows.groupby(by)["value"].agg(complete_mean)
    if not np.isfinite(means).all():
        return error_text(math.nan)
    return f"{scientific(means.min(skipna=False))} … {scientific(means.max(skipna=False))}"


def errors(table: pd.DataFrame) -> TextTable:
    """NMSE and skill of every method per light and body."""
    heads = (
        "body", "light", "method", "scenes", "NMSE mean", "NMSE max", "noise in it",
        "skill median", "skill min", "unmixed median", "skill < 0", "no skill to report",
    )  # fmt: skip
    return TextTable(heads, [_error_line(row) for row in _records(by_light_and_body(table))])


_SKILLS = ("skill_median", "skill_min", "unmixed_median")


def _error_line(row: dict[str, Any]) -> list[str]:
    names = [str(row[name]) for name in ("body", "light", "method")]
    if row["inapplicable"] == row["scenes"]:
        return [*names, "0", "not applicable", *[NO_NUMBER] * 7]
    numbers = [error_text(row[name]) for name in ("nmse_mean", "nmse_max")]
    numbers.append(scientific(row["noise"]))
    skills = [skill_text(row[name]) for name in _SKILLS]
    if row["method"] == TRIVIAL:  # it is what skill is measured against
        skills = [NO_NUMBER] * len(_SKILLS)
    counts = [str(row[name]) for name in ("negative", "unreported")]
    return [*names, str(row["scenes"] - row["inapplicable"]), *numbers, *skills, *counts]


def circular(table: pd.DataFrame) -> TextTable:
    """Circular polarisation of the truths that have any, in the mean over scenes and at most.

    It does not depend on the method; a scene that several scored counts once.
    """
    rows = overall_rows(table, "s3_rmse").drop_duplicates("scene")
    groups = rows.groupby(["light", "material", "surface"], sort=False)
    lines = [
        [
            *map(str, names), str(len(group)), scientific(float(group["value"].mean())),
            scientific(float(group["value"].max())), scientific(float(group["noise"].mean())),
        ]
        for names, group in groups
    ]  # fmt: skip
    heads = ("light", "material", "surface", "scenes", "rms s3", "largest", "noise")
    return TextTable(heads, lines)


def left_out(table: pd.DataFrame) -> TextTable:
    """Methods that could not work on some scenes, and why."""
    groups = overall_rows(table, "inapplicable").groupby(["method", "note"], sort=False)["scene"]
    lines = [[str(method), str(note), str(scenes.nunique())] for (method, note), scenes in groups]
    return TextTable(("method", "reason", "scenes left out"), lines)


def negatives(table: pd.DataFrame, method: str) -> TextTable:
    """Lights, surfaces and bodies where a method's skill is below zero, the worst first."""
    heads = ("light", "surface (α)", "body", "scenes", "worst skill", "worst scene")
    lines = [
        [
            row["light"], f"{row['surface']} ({row['alpha']:g})", row["body"],
            f"{row['negative']} of {row['scenes']}", skill_text(row["worst"]),
            f"{row['material']}, {row['shape']}",
        ]
        for row in _records(negative_skills(table, method))
    ]  # fmt: skip
    return TextTable(heads, lines)


@kept
def without_skill(table: pd.DataFrame) -> TextTable:
    """Lights, surfaces and bodies with scenes on which a method has no skill to report."""
    lines = [
        [name, row["light"], row["surface"], row["body"], f"{row['unreported']} of {row['scenes']}"]
        for name in scored_methods(table)
        if name != TRIVIAL
        for row in _records(unreported_skills(table, name))
    ]
    return TextTable(("method", "light", "surface", "body", "scenes"), lines)


def savings(plan: dict[str, Any]) -> TextTable:
    """What the plan of a run left out, the largest saving first."""
    left_out = [part for part in plan["left_out"] if part["done"] < part["instead_of"]]
    lines = [
        [
            part["what"],
            f"{part['done']:,} of {part['instead_of']:,}",
            f"{part['renders']:,}" if part["renders"] else "only rays",
            part["why"],
        ]
        for part in sorted(left_out, key=lambda part: -part["renders"])
    ]
    return TextTable(("what", "done", "renders saved", "why nothing is lost"), lines)


def stages(run: dict[str, Any]) -> TextTable:
    """Seconds of every stage of a run."""
    lines = [[name, f"{value:.2f}"] for name, value in run["seconds"].items()]
    return TextTable(("stage", "seconds"), lines)


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    return [{str(key): value for key, value in row.items()} for row in table.to_dict("records")]


def stress_groups(cases: pd.DataFrame) -> TextTable:
    """Counts and extremes of every group of cases of the study `stress`."""
    lines = [
        [
            str(name), str(len(rows)), str(int((~rows["passed"]).sum())),
            scientific(float(rows["error"].max())), f"{rows['seconds'].max():.2g}",
        ]
        for name, rows in cases.groupby("group", sort=False)
    ]  # fmt: skip
    return TextTable(("group", "cases", "failed", "largest error", "longest, seconds"), lines)


def stress_cases(cases: pd.DataFrame) -> TextTable:
    """Cases of the study `stress`, one a line."""
    lines = [stress_cells(row) for _, row in cases.iterrows()]
    return TextTable(tuple(map(str, cases.columns)), lines)


def stress_cells(row: Any) -> list[str]:
    """A row of the table of the study `stress` as text."""
    number = {"seconds": "{:.4f}", "value": "{:.10g}", "error": "{:.1e}"}
    texts = []
    for name, value in row.items():
        if name == "passed":
            texts.append("ok" if value else "FAILED")
        elif name in number:
            texts.append("" if math.isnan(value) else number[name].format(value))
        else:
            texts.append(str(value))
    return texts
