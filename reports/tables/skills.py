"""Where a method is better than no model, where worse, and where nobody can say."""

from __future__ import annotations

import pandas as pd

from malus.reports.tables.rows import distinct, overall_rows

_PLACE = ["body", "light", "method"]


def by_light_and_body(table: pd.DataFrame) -> pd.DataFrame:
    """NMSE and skill of every method per light and body.

    Returns
    -------
    DataFrame
        One row a body × light × method, in the table's order: scenes, inapplicable (scenes on
        which the method could not work), nmse_mean, nmse_max, noise (mean expected Monte Carlo
        part of NMSE), skill_median, skill_min, negative and unreported (numbers of scenes whose
        skill is below zero, and whose trivial guess is inside the noise).

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> by_light_and_body(table()).query("method == 'eq8'")[["light", "skill_min"]].values.tolist()
    [['uniform', 0.95], ['distant 60°', 0.95]]
    """
    every = table.drop_duplicates(["scene", "method"]).groupby(_PLACE, sort=False)
    nmse = overall_rows(table, "nmse").groupby(_PLACE, sort=False)
    skill = overall_rows(table, "skill").groupby(_PLACE, sort=False)["value"]
    inapplicable = (
        overall_rows(table, "inapplicable").groupby(_PLACE, sort=False)["scene"].nunique()
    )
    result = pd.DataFrame({"scenes": every["scene"].nunique()})
    result["inapplicable"] = inapplicable.reindex(result.index, fill_value=0)
    result["nmse_mean"] = nmse["value"].mean()
    result["nmse_max"] = nmse["value"].max()
    result["noise"] = nmse["noise"].mean()
    result["skill_median"] = skill.median()
    result["skill_min"] = skill.min()
    result["negative"] = skill.apply(lambda values: int((values < 0).sum()))
    result["unreported"] = skill.apply(lambda values: int(values.isna().sum()))
    counts = ["negative", "unreported"]
    result[counts] = result[counts].fillna(0).astype(int)
    return result.reset_index()


def negative_skills(table: pd.DataFrame, method: str) -> pd.DataFrame:
    """Light × surface × body where a method's skill is below zero.

    Returns
    -------
    DataFrame
        Columns light, surface, alpha, body, negative and scenes (those with a skill), worst
        (smallest skill), material and shape (of the worst scene); the worst places first.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> len(negative_skills(table(), "eq8"))
    0
    """
    rows = _skills(table, method).dropna(subset="value")
    place = ["light", "surface", "alpha", "body"]
    groups = rows.groupby(place, sort=False)["value"]
    worst = rows.loc[groups.idxmin()].set_index(place)
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
    """Light × surface × body where the trivial guess is inside the noise: no skill to report.

    Returns
    -------
    DataFrame
        Columns light, surface, body, unreported (number of scenes) and scenes (all of them).
    """
    rows = _skills(table, method)
    groups = rows.groupby(["light", "surface", "body"], sort=False)["value"]
    result = pd.DataFrame(
        {
            "unreported": groups.apply(lambda values: int(values.isna().sum())),
            "scenes": groups.size(),
        }
    )
    return result[result["unreported"] > 0].reset_index()


def skill_map(table: pd.DataFrame, method: str, body: str) -> pd.DataFrame:
    """Median skill over shapes and materials: one row a light, one column a surface.

    The columns are ordered by roughness. NaN where no scene of the place has a skill, also where
    the method could not work.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> skill_map(table(), "half_vector", "unpolarised")["carbon"].tolist()
    [nan, 0.999]
    """
    rows = _skills(table, method)
    rows = rows[rows["body"] == body]
    medians = rows.groupby(["light", "surface"], sort=False)["value"].median().unstack()
    every = table[table["body"] == body]
    surfaces = every.sort_values("alpha", kind="stable")["surface"]
    return medians.reindex(index=distinct(every["light"]), columns=distinct(surfaces))


def _skills(table: pd.DataFrame, method: str) -> pd.DataFrame:
    rows = overall_rows(table, "skill")
    return rows[rows["method"] == method]
