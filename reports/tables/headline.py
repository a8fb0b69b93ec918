"""The numbers that a page shows first: answers to what a suite asks, by its axes and metrics.

A suite of several materials asks what the paper's Figure 5 does; one that scores colours asks for
Table I; one with a ladder of knowledge for what each estimated input costs.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from malus.reports.tables.colour_errors import PAPER_TABLE1, table1
from malus.reports.tables.figure_numbers import ladder_numbers
from malus.reports.tables.formats import scientific, skill_text
from malus.reports.tables.metric_definitions import definition_of
from malus.reports.tables.paper_table import number_with_error
from malus.reports.tables.prices import prices
from malus.reports.tables.rows import (
    PAPER_BODY,
    PAPER_METHOD,
    PAPER_RANGE,
    TRIVIAL,
    distinct,
    not_finite,
    overall_rows,
    rows_of_body,
)
from malus.reports.tables.text_tables import range_of_means

Tile = tuple[str, str]
"""A number, and what it is."""

_DEAREST = 4
"""Prices that are shown first."""

_ASKED = ("dolp_mae", "aolp_mae_deg")
"""Metrics of polarisation that are shown first where a suite asks for them."""


def headline_tiles(table: pd.DataFrame, colours: pd.DataFrame, suite: str) -> Iterator[Tile]:
    """What a suite asks, answered by the paper's method, the best one and the trivial guess.

    Parameters
    ----------
    table : DataFrame
        Of the results.
    colours : DataFrame
        Table I, empty where no colours were scored.
    suite : str
        Its name: the paper's numbers are shown beside those of a suite called like its dataset.

    Examples
    --------
    >>> from malus.reports.tables import sample
    >>> tiles = list(headline_tiles(sample.table(), pd.DataFrame(), "sample"))
    >>> tiles[0][1]
    'mean NMSE of eq8 by material. The paper: 4e-3 … 6e-3'
    """
    body = headline_body(table)
    rows = rows_of_body(table, body)
    best = best_method(rows)
    if table["knowledge"].nunique() > 1:
        yield from _ladder(ladder_numbers(rows), best)
    elif len(colours):
        shared, note = _scenes_of(rows, best)
        of_these = table1(shared) if note else colours
        yield from _table1(rows_of_body(of_these, body), best, suite, note)
    elif rows["material"].nunique() > 1:
        yield from _figure5(rows)
    yield from _polarisation(rows, best)
    yield from _skills(rows, best)


def _scenes_of(rows: pd.DataFrame, best: str) -> tuple[pd.DataFrame, str]:
    """Rows of the scenes on which the best method has an error, and a note where it lacks some.

    Means over other scenes do not compare: what a method left out may be hard, or easy.
    """
    errors = overall_rows(rows, "nmse")
    scenes = errors.loc[errors["method"] == best, "scene"].unique()
    count = rows["scene"].nunique()
    if len(scenes) == count:
        return rows, ""
    return rows[rows["scene"].isin(scenes)], f", on the {len(scenes)} of {count} scenes of {best}"


def headline_body(table: pd.DataFrame) -> str:
    """The body of the scenes that the headline is about: the paper's where the run has it."""
    bodies = distinct(table["body"])
    return PAPER_BODY if PAPER_BODY in bodies else bodies[0]


def best_method(rows: pd.DataFrame) -> str:
    """The method of the largest median skill among those that worked on most scenes.

    One that gave what is not finite is none of them.

    Examples
    --------
    >>> from malus.reports.tables import sample
    >>> best_method(sample.table())  # half_vector left scenes out
    'eq8'
    """
    skills = overall_rows(rows, "skill")
    skills = skills[~skills["method"].isin(skills.loc[not_finite(rows, skills), "method"])]
    groups = skills[skills["method"] != TRIVIAL].groupby("method", sort=False)["value"]
    if not len(groups):
        return TRIVIAL
    counts, medians = groups.size(), groups.median().fillna(-np.inf)
    return str(medians[counts == counts.max()].idxmax())


def _figure5(rows: pd.DataFrame) -> Iterator[Tile]:
    """Errors of the paper's method over materials and surfaces, beside the paper's."""
    errors = overall_rows(rows, "nmse")
    own, trivial = (errors[errors["method"] == name] for name in (PAPER_METHOD, TRIVIAL))
    if len(own):
        for by in ("material", "surface"):
            if own[by].nunique() == 1:
                continue  # its range is one number twice
            numbers = range_of_means(own, by)
            yield numbers, f"mean NMSE of {PAPER_METHOD} by {by}. The paper: {PAPER_RANGE}"
        yield scientific(float(own["noise"].mean())), "Monte Carlo noise in the mean NMSE"
    if len(trivial):
        label = "mean NMSE of the trivial guess I(ϑ) = I/2 by material"
        yield range_of_means(trivial, "material"), label


def _table1(colours: pd.DataFrame, best: str, suite: str, note: str) -> Iterator[Tile]:
    """Colour differences and errors of I_max and I_min, as in Table I.

    The paper's method stands beside the best one where it has an error on the same scenes.
    """
    paper = next((name for name in PAPER_TABLE1 if name.endswith(f", {suite.capitalize()}")), "")
    for formula in ("ΔE76", "NMSE"):
        for image in ("I_max", "I_min"):
            chosen = (colours["formula"] == formula) & (colours["image"] == image)
            own = colours[chosen].set_index("method")
            means, scenes = own["mean"], own["scenes"]
            if best not in means:
                continue
            others = [
                name
                for name in (PAPER_METHOD, TRIVIAL)
                if name != best and scenes.get(name) == scenes[best]
            ]
            beside = [f"{name}: {_error(means[name], formula)}" for name in others]
            if paper:
                beside.append(f"{paper}: {PAPER_TABLE1[paper][formula, image]}")
            label = "; ".join([f"mean {formula} of {image} by {best}", *beside])
            yield _error(means[best], formula), label + note


def _error(mean: float, formula: str) -> str:
    return scientific(mean) if formula == "NMSE" else f"{mean:.2f}"


def _ladder(parts: pd.DataFrame, best: str) -> Iterator[Tile]:
    """What the error grows by with each input that is estimated."""
    own = parts[parts["method"] == best]
    for row in own.itertuples():
        yield scientific(float(row.increment)), f"of the mean NMSE of {best}: {row.source}"


def _polarisation(rows: pd.DataFrame, best: str) -> Iterator[Tile]:
    rows, note = _scenes_of(rows, best)
    for metric in _ASKED:
        values = overall_rows(rows, metric).groupby("method")["value"].mean()
        if best in values:
            known = definition_of(metric)
            guess = values.get(TRIVIAL)
            beside = "" if guess is None else f"; of the trivial guess {guess:.2g}{known.unit}"
            yield f"{values[best]:.2g}{known.unit}", f"mean {known.label} of {best}{beside}{note}"


def _skills(rows: pd.DataFrame, best: str) -> Iterator[Tile]:
    skills = overall_rows(rows, "skill")
    for method in dict.fromkeys((PAPER_METHOD, best)):
        own = skills[skills["method"] == method]
        values = own["value"]
        if not len(values) or method == TRIVIAL:
            continue
        if broken := int(not_finite(rows, own).sum()):
            yield f"{broken} of {len(values)}", f"scenes on which {method} gave what is not finite"
            continue
        paper = method == PAPER_METHOD
        note = "; the paper reports none" if paper else ", the best that left out fewest scenes"
        yield skill_text(float(values.median())), f"median skill of {method}{note}"
        if paper or (values < 0).any():
            share = f"{int((values < 0).sum())} of {len(values)}"
            yield share, f"scenes with negative skill of {method}: worse than no model"
    inside = skills["value"].isna() & ~not_finite(rows, skills)
    without = int(inside[skills["method"] == best].sum())
    if without:
        yield str(without), "scenes without a skill: too much noise to tell it"


def price_tiles(mismatch: pd.DataFrame) -> Iterator[Tile]:
    """The dearest assumptions of the study `mismatch`: the skill that each costs.

    Examples
    --------
    >>> pairs = {"first": 0.5, "second": 0.6, "third": 0.7}
    >>> rows = [("a", "truth", scene, "eq8", 0.9, broken) for scene, broken in pairs.items()]
    >>> columns = ["assumption", "kind", "scene", "method", "holds", "broken"]
    >>> list(price_tiles(pd.DataFrame(rows, columns=columns)))
    [('0.30 ± 0.25', 'loss of skill: a (eq8)')]
    """
    numbers = prices(mismatch)
    first = numbers[numbers["pairs"] > 0].groupby("assumption", sort=False).head(1)
    for row in first.nlargest(_DEAREST, "price").itertuples():
        number = number_with_error(float(row.price), float(row.half_width))
        yield number, f"loss of skill: {row.assumption} ({row.method})"
