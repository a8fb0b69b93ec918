"""Skill of the methods: by light and body, where it is negative, where there is none to report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from malus.reports.tables.formats import NO_NUMBER, skill_text
from malus.reports.tables.kept import kept
from malus.reports.tables.rows import (
    MOST_LIGHTS,
    TRIVIAL,
    by_kind_of_light,
    complete_mean,
    distinct,
    not_finite,
    overall_rows,
    scored_methods,
    told_of_groups,
)
from malus.scenes.materials.surface import body_text

_GROUP = ["body", "light", "method"]


@kept
def by_light_and_body(table: pd.DataFrame) -> pd.DataFrame:
    """NMSE and skill of every method per light and body.

    Returns
    -------
    DataFrame
        One row a body × light × method, in the table's order: scenes, inapplicable (scenes on
        which the method could not work), nmse_mean, nmse_max, noise (mean expected Monte Carlo
        part of NMSE), skill_median, skill_min, unmixed_median (of the skill over pixels of one
        normal; NaN where nobody measured which these are), negative and unreported (numbers of
        scenes whose skill is below zero, and which the noise leaves without one).

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> by_light_and_body(table()).query("method == 'eq8'")[["light", "skill_min"]].values.tolist()
    [['uniform', 0.95], ['distant 60°', 0.95]]
    """
    tried = table.drop_duplicates(["scene", "method"]).groupby(_GROUP, sort=False)
    nmse = overall_rows(table, "nmse").groupby(_GROUP, sort=False)
    skills = overall_rows(table, "skill")
    skill = skills.groupby(_GROUP, sort=False)["value"]
    inside_noise = skills["value"].isna() & ~not_finite(table, skills)
    inapplicable = (
        overall_rows(table, "inapplicable").groupby(_GROUP, sort=False)["scene"].nunique()
    )
    result = pd.DataFrame({"scenes": tried["scene"].nunique()})
    result["inapplicable"] = inapplicable.reindex(result.index, fill_value=0)
    # An estimate that is not finite has no error: without it a method would seem better.
    result["nmse_mean"] = nmse["value"].agg(complete_mean)
    result["nmse_max"] = nmse["value"].agg(lambda values: values.max(skipna=False))
    result["noise"] = nmse["noise"].mean()
    result["skill_median"] = skill.median()
    result["skill_min"] = skill.min()
    unmixed = overall_rows(table, "skill_unmixed").groupby(_GROUP, sort=False)["value"]
    result["unmixed_median"] = unmixed.median().reindex(result.index)
    result["negative"] = skill.apply(lambda values: int((values < 0).sum()))
    result["unreported"] = inside_noise.groupby([skills[key] for key in _GROUP]).sum()
    broken = result["inapplicable"].lt(result["scenes"]) & result["nmse_mean"].isna()
    result.loc[broken, ["skill_median", "skill_min", "unmixed_median"]] = math.nan
    counts = ["negative", "unreported"]
    result[counts] = result[counts].fillna(0).astype(int)
    return result.reset_index()


@kept
def negative_skills(table: pd.DataFrame, method: str) -> pd.DataFrame:
    """Light × surface × body where a method's skill is below zero.

    Returns
    -------
    DataFrame
        Columns light, surface, alpha, body, negative and scenes (those with a skill), worst
        (smallest skill), material and shape (of the worst scene); the worst first.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> len(negative_skills(table(), "eq8"))
    0
    """
    rows = _skills(table, method).dropna(subset="value")
    group = ["light", "surface", "alpha", "body"]
    groups = rows.groupby(group, sort=False)["value"]
    worst = rows.loc[groups.idxmin()].set_index(group)
    result = pd.DataFrame(
        {
            "negative": groups.apply(lambda values: int((values < 0).sum())),
            "scenes": groups.size(),
            "worst": worst["value"],
            "material": worst["material"],
            "shape": worst["shape"],
        }
    )
    return result[result["negative"] > 0].sort_values("worst", kind="stable").reset_index()


def unreported_skills(table: pd.DataFrame, method: str) -> pd.DataFrame:
    """Light × surface × body where the noise is too large to tell a skill.

    Returns
    -------
    DataFrame
        Columns light, surface, body, unreported (number of scenes) and scenes (all of them).
    """
    rows = _skills(table, method)
    rows = rows[~not_finite(table, rows)]
    groups = rows.groupby(["light", "surface", "body"], sort=False)["value"]
    result = pd.DataFrame(
        {
            "unreported": groups.apply(lambda values: int(values.isna().sum())),
            "scenes": groups.size(),
        }
    )
    return result[result["unreported"] > 0].reset_index()


def median_skills(table: pd.DataFrame, method: str, body: str) -> pd.DataFrame:
    """Median skill over shapes and materials: one row a light, one column a surface.

    The columns are ordered by roughness. NaN where no scene with that light and surface has a
    skill, also where the method could not work, and where an estimate of it is not finite.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> median_skills(table(), "half_vector", "unpolarised")["carbon"].tolist()
    [nan, 0.999]
    """
    rows = _skills(table, method)
    rows = rows[rows["body"] == body]
    cells = [rows["light"], rows["surface"]]
    broken = not_finite(table, rows).groupby(cells, sort=False).any()
    medians = rows["value"].groupby(cells, sort=False).median().mask(broken).unstack()
    scenes = table[table["body"] == body]
    surfaces = scenes.sort_values("alpha", kind="stable")["surface"]
    return medians.reindex(index=distinct(scenes["light"]), columns=distinct(surfaces))


@dataclass(frozen=True)
class SkillCell:
    """A cell of the skill map: a median skill and how the page shows it.

    `side` is "good", "bad" or "none" (no skill to report), `strength` that of the cell's colour,
    `scene` an example of it in the viewer, empty where there is none.
    """

    text: str
    side: str
    strength: float
    scene: str


@dataclass(frozen=True)
class SkillMap:
    """Median skills of a method on one body: a line a light, a cell a surface."""

    method: str
    body: str
    surfaces: list[str]
    lines: list[tuple[str, list[SkillCell]]]

    @property
    def caption(self) -> str:
        """Method and body."""
        return f"{self.method}, {body_text(self.body)}"


def mapped(table: pd.DataFrame) -> tuple[pd.DataFrame, str]:
    """The table as maps show it, and a sentence on lights and surfaces that they take together.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> mapped(table())[1]
    ''
    """
    told, grouped = told_of_groups(table), by_kind_of_light(table)
    surfaces = table["surface"].nunique()
    if surfaces > MOST_LIGHTS:
        told = f"{told} There are {surfaces} surfaces, too many to show: all are taken together."
        grouped = grouped.assign(surface="all surfaces")
    return grouped, told.strip()


def skill_maps(table: pd.DataFrame, examples: Mapping[tuple[str, str, str], str]) -> list[SkillMap]:
    """Maps of the median skill, one for every body and method.

    Parameters
    ----------
    table : DataFrame
    examples : mapping
        Scene that the viewer shows for a (light, surface, body), where it shows one.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> maps = skill_maps(table(), {})
    >>> maps[0].caption, maps[0].lines[0][0], maps[0].lines[0][1][0].text
    ('eq8, unpolarised body', 'uniform', '0.95')
    """
    return [
        _skill_map(table, method, body, examples)
        for body in distinct(table["body"])
        for method in scored_methods(table)
        if method != TRIVIAL
    ]


def _skill_map(
    table: pd.DataFrame, method: str, body: str, examples: Mapping[tuple[str, str, str], str]
) -> SkillMap:
    medians = median_skills(table, method, body)
    surfaces = [str(name) for name in medians.columns]
    lines = []
    for light, skills in zip(map(str, medians.index), medians.to_numpy(float), strict=True):
        scenes = [examples.get((light, surface, body), "") for surface in surfaces]
        cells = [_cell(float(skill), scene) for skill, scene in zip(skills, scenes, strict=True)]
        lines.append((light, cells))
    return SkillMap(method, body, surfaces, lines)


def _cell(skill: float, scene: str) -> SkillCell:
    text = skill_text(skill)
    if text == NO_NUMBER:
        return SkillCell(text, "none", 0.0, "")
    return SkillCell(text, "good" if skill >= 0 else "bad", strength(skill), scene)


def strength(skill: float) -> float:
    """Strength of a cell's colour, 0 to 1: linear in skill above zero, logarithmic below.

    Examples
    --------
    >>> strength(0.5), strength(-100.0)
    (0.5, 1.0)
    """
    return max(0.0, min(1.0, skill if skill >= 0 else math.log10(1.0 - skill) / 2.0 + 0.15))


def _skills(table: pd.DataFrame, method: str) -> pd.DataFrame:
    rows = overall_rows(table, "skill")
    return rows[rows["method"] == method]
