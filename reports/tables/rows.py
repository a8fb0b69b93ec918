"""Rows of a results table, chosen by metric, body and angle, and what they cover."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import pandas as pd

from malus.scenes.materials.materials import materials, surfaces

KNOWLEDGE = "everything"
"""What a method is told in the paper's synthetic experiment."""

PAPER_NMSE = (4e-3, 6e-3)
"""Range of the paper's Figure 5 (its Section IV-A)."""

PAPER_RANGE = "4e-3 … 6e-3"

TRIVIAL = "unpolarised"
"""The method that guesses I(ϑ) = I/2."""

PAPER_METHOD = "eq8"
PAPER_BODY = "unpolarised"

CAPTURED = "captured"
"""Body of a real object, of which nothing is known; its group stands in the column `light`."""


class ResultsLike(Protocol):
    """The results of a run: a table, and a record of how it came about."""

    @property
    def table(self) -> pd.DataFrame:
        """One row a scene × method × knowledge × metric."""

    @property
    def run(self) -> dict[str, Any]:
        """Suite, versions, seeds, machine, seconds of every stage."""


def is_of_captures(table: pd.DataFrame) -> bool:
    """Whether the rows are of real captures.

    Examples
    --------
    >>> is_of_captures(pd.DataFrame({"body": ["captured", "captured"]}))
    True
    """
    return distinct(table["body"]) == [CAPTURED]


def overall_rows(table: pd.DataFrame, metric: str) -> pd.DataFrame:
    """Rows of a metric over all bands and angles, everything known to the method.

    Examples
    --------
    >>> table = pd.DataFrame({"metric": ["nmse", "nmse"], "band_nm": [None, 550.0],
    ...                       "angle_deg": [None, None], "knowledge": ["everything"] * 2})
    >>> len(overall_rows(table, "nmse"))
    1
    """
    rows = overall_rows_at_every_rung(table, metric)
    return rows[rows["knowledge"] == KNOWLEDGE]


def overall_rows_at_every_rung(table: pd.DataFrame, metric: str) -> pd.DataFrame:
    """Rows of a metric over all bands and angles, at every level of knowledge."""
    chosen = (table["metric"] == metric) & table["band_nm"].isna() & table["angle_deg"].isna()
    return table[chosen]


def not_finite(table: pd.DataFrame, rows: pd.DataFrame) -> pd.Series[bool]:
    """Whether each of `rows` is of an estimate that is not finite: its error is no number.

    Such an estimate has no skill either, as one that is lost in the noise; only
    there the method is not to blame.

    Examples
    --------
    >>> from malus.reports.tables.sample import table
    >>> not_finite(table(), overall_rows(table(), "skill")).any().item()
    False
    """
    errors = overall_rows(table, "nmse")
    broken = errors.loc[errors["value"].isna(), ["scene", "method"]]
    pairs = pd.MultiIndex.from_frame(rows[["scene", "method"]].astype(object))
    known = pairs.isin(pd.MultiIndex.from_frame(broken.astype(object)))
    return pd.Series(known, index=rows.index)


def complete_mean(values: pd.Series[float]) -> float:
    """Mean of values; no number where one of them is none, which would make it seem better."""
    return float(values.mean(skipna=False))


def rows_by_angle(table: pd.DataFrame, metric: str) -> pd.DataFrame:
    """Rows of a metric at one polariser angle, over all bands, everything known."""
    chosen = (table["metric"] == metric) & (table["knowledge"] == KNOWLEDGE)
    return table[chosen & table["band_nm"].isna() & table["angle_deg"].notna()]


def distinct(column: pd.Series[str]) -> list[str]:
    """Distinct values in the order in which they first come.

    Examples
    --------
    >>> distinct(pd.Series(["b", "a", "b"]))
    ['b', 'a']
    """
    return [str(value) for value in column.unique()]


def scored_methods(table: pd.DataFrame) -> list[str]:
    """Methods with an error on at least one scene, in the order of the suite."""
    scored = set(overall_rows(table, "nmse")["method"])
    return [method for method in distinct(table["method"]) if method in scored]


def unverified_surfaces(table: pd.DataFrame) -> list[str]:
    """Surfaces of the table whose roughness nobody compared with its printed source.

    Examples
    --------
    >>> unverified_surfaces(pd.DataFrame({"surface": ["carbon", "alpha 0.3"]}))
    ['carbon']
    """
    catalogue = surfaces()
    names = distinct(table["surface"])
    return [name for name in names if name in catalogue and catalogue[name].status != "verified"]


def extrapolated_materials(
    table: pd.DataFrame, bands_nm: Sequence[float]
) -> dict[str, list[float]]:
    """Materials of the table with the bands at which their index lies beyond its data.

    Examples
    --------
    >>> table = pd.DataFrame({"material": ["pmma", "water", "eta 1.5"]})
    >>> extrapolated_materials(table, [400.0, 550.0])
    {'pmma': [400.0]}
    """
    catalogue = materials()
    found = {}
    for name in distinct(table["material"]):
        if name in catalogue and (beyond := catalogue[name].extrapolated(bands_nm)).any():
            found[name] = [
                band for band, is_beyond in zip(bands_nm, beyond, strict=True) if is_beyond
            ]
    return found


def rows_of_body(table: pd.DataFrame, body: str) -> pd.DataFrame:
    """Rows of scenes with that body."""
    return table[table["body"] == body]


MOST_LIGHTS = 12
"""Lights, and surfaces, that figures and maps show one by one."""


def by_kind_of_light(table: pd.DataFrame) -> pd.DataFrame:
    """The table with the kinds of its lights for their names, where these are too many to show.

    Groups of captures have no kind: they become one.

    Examples
    --------
    >>> lights = [f"distant {angle}°" for angle in range(20)] + ["sky 45°"]
    >>> rows = pd.DataFrame({"light": lights, "body": "polarised"})
    >>> distinct(by_kind_of_light(rows)["light"]), distinct(by_kind_of_light(rows[:2])["light"])
    (['distant', 'sky'], ['distant 0°', 'distant 1°'])
    """
    if table["light"].nunique() <= MOST_LIGHTS:
        return table
    if is_of_captures(table):
        return table.assign(light="all groups")
    return table.assign(light=table["light"].astype(str).str.extract(r"^(\w+)")[0])


def told_of_groups(table: pd.DataFrame) -> str:
    """A sentence where `by_kind_of_light` changes a table; else empty."""
    lights = table["light"].nunique()
    if lights <= MOST_LIGHTS:
        return ""
    if is_of_captures(table):
        return f"There are {lights} groups, too many to show: all are taken together."
    return f"There are {lights} lights, too many to show: those of a kind are taken together."


@dataclass(frozen=True)
class Coverage:
    """Names of the lights on all, on some and on none of whose scenes a method could work."""

    complete_lights: tuple[str, ...]
    partial_lights: tuple[str, ...]
    missing_lights: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Whether the method worked on every scene."""
        return not self.partial_lights and not self.missing_lights

    def __str__(self) -> str:
        """In words, for a legend; empty where the coverage is complete."""
        if self.complete:
            return ""
        covered = [*self.complete_lights, *(f"part of {light}" for light in self.partial_lights)]
        return f"only {', '.join(covered)}" if covered else "no scene"


def coverages(table: pd.DataFrame) -> dict[str, Coverage]:
    """On which lights each method with an error has one, compared with all scenes of the table.

    Examples
    --------
    >>> table = pd.DataFrame({"metric": ["nmse", "inapplicable"], "light": ["distant", "uniform"],
    ...     "scene": ["a", "b"], "method": ["half_vector"] * 2, "knowledge": ["everything"] * 2,
    ...     "band_nm": [None] * 2, "angle_deg": [None] * 2})
    >>> {method: str(covered) for method, covered in coverages(table).items()}
    {'half_vector': 'only distant'}
    """
    scenes = table.groupby("light", sort=False)["scene"].nunique()
    errors = overall_rows(table, "nmse").groupby(["method", "light"])["scene"].nunique()
    return {
        method: _covered(scenes, errors[method].reindex(scenes.index, fill_value=0))
        for method in scored_methods(table)
    }


def _covered(scenes: pd.Series[int], scored: pd.Series[int]) -> Coverage:
    """Coverage from the numbers of scenes, and of those with an error, under each light."""
    return Coverage(
        complete_lights=tuple(map(str, scenes.index[scored == scenes])),
        partial_lights=tuple(map(str, scenes.index[(scored > 0) & (scored < scenes)])),
        missing_lights=tuple(map(str, scenes.index[scored == 0])),
    )
