"""What changed between runs, of one suite or of several, beyond what chance does."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd

from malus.reports.tables.metric_definitions import MetricDefinition, definition_of
from malus.reports.tables.other_images import (
    TOLERANCES,
    noise_width,
    same_images,
    signals,
    weighted_means,
)
from malus.reports.tables.paired import LEAST_SCENES, PairedDifference, student_width
from malus.reports.tables.paper_table import default_metrics, number_with_error
from malus.reports.tables.rows import TRIVIAL, ResultsLike, complete_mean, distinct, overall_rows
from malus.reports.tables.text_tables import TextTable
from malus.scenes.core.arrays import Float64Array

FALSE_ALARM = 0.05
"""Probability that chance alone makes any line of a comparison a change."""

KEYS = ["method", "body", "light"]
"""Scenes are compared in groups: a method under one kind of light on one kind of body."""

Outcome = Literal["better", "worse", "changed", "same", "not told"]


@dataclass(frozen=True)
class Change:
    """A metric of a method, body and light in two runs.

    Attributes
    ----------
    before, after, difference, half_width : float
        Means over the scenes that are compared, after − before, and half the width of its
        interval.
    paired : bool
        Whether both runs have the same scenes; else different ones of the group are compared.
    told : bool
        Whether anything tells what chance does to the difference: not where the same scenes were
        rendered with other random numbers, and the metric does not tell its noise.
    """

    run: str
    key: tuple[str, ...]
    metric: MetricDefinition
    before: float
    after: float
    difference: float
    half_width: float
    scenes: int
    paired: bool
    told: bool = True

    @property
    def outcome(self) -> Outcome:
        """Better or worse where the interval leaves out zero and the metric has a direction.

        An estimate that is not finite has no number: it is worse than any other. An infinite
        mean, such as the PSNR of a perfect estimate, is a value, without an interval.
        """
        if math.isnan(self.before) != math.isnan(self.after):
            return "better" if math.isnan(self.before) else "worse"
        infinite = math.isinf(self.before) or math.isinf(self.after)
        if not (self.told or infinite or self.difference == 0):
            return "not told"
        if not (infinite and self.before != self.after) and (
            self.difference == 0 or not abs(self.difference) > self.half_width
        ):
            return "same"
        if not self.metric.better:
            return "changed"
        before, after = (self.metric.goodness(value) for value in (self.before, self.after))
        if math.isnan(before):  # and after: the difference is of the scenes that are finite in both
            before, after = 0.0, self.metric.goodness(self.difference)
        return "better" if after > before else "worse"


def compared(names: Sequence[str], runs: Sequence[ResultsLike]) -> list[Change]:
    """Compare every run with the first, for all methods, bodies, lights and metrics of both.

    Scenes of both are paired; where a group shares none, its means are compared (Welch's t). Scenes
    of both that were rendered with other random numbers are compared by the metrics that tell their
    noise (`other_images`); of the others their change is no evidence. Groups of fewer than three
    scenes are left out: nothing tells their chance. The intervals together raise a false alarm in
    one comparison of twenty (Bonferroni).
    """
    first = _groups(runs[0].table)
    pairs = [
        _Pair(name, key, before, after)
        for name, run in zip(names[1:], runs[1:], strict=True)
        for key, before, after in _shared(first, _groups(run.table))
    ]
    pairs = [pair for pair in pairs if pair.is_other or pair.key[0] not in TOLERANCES]
    confidence = 1.0 - FALSE_ALARM / max(sum(pair.told for pair in pairs), 1)
    return [pair.change(confidence) for pair in pairs]


_Groups = dict[tuple[str, ...], pd.DataFrame]


def _groups(table: pd.DataFrame) -> _Groups:
    """Value, noise and signal by scene of every metric, method, body and light."""
    signal, groups = signals(table), _Groups()
    for metric in dict.fromkeys([*default_metrics(table), *TOLERANCES]):
        rows = overall_rows(table, metric)
        for key, part in rows.groupby(KEYS, sort=False, observed=True):
            own = part.drop_duplicates("scene").set_index("scene")
            own = own.reindex(columns=["value", "noise"]).astype(float)
            own["signal"] = [signal.get((key[0], scene), math.nan) for scene in own.index]
            if metric != "nmse":  # of which the estimates that are not finite have none
                own = own.dropna(subset="value")
            groups[metric, *map(str, key)] = own
    return groups


def _shared(
    before: _Groups, after: _Groups
) -> Iterator[tuple[tuple[str, ...], pd.DataFrame, pd.DataFrame]]:
    for key in filter(after.__contains__, before):  # in the order of the first
        a, b = before[key], after[key]
        same = a.index.intersection(b.index)
        if len(same):
            a, b = a.loc[same], b.loc[same]
        if min(len(a), len(b)) >= LEAST_SCENES:
            yield key, a, b


class _Pair(NamedTuple):
    """A metric of a method, body and light in the first run and in another."""

    run: str
    key: tuple[str, ...]
    before: pd.DataFrame
    after: pd.DataFrame

    @property
    def is_paired(self) -> bool:
        """Whether both have the same scenes."""
        return self.before.index.equals(self.after.index)

    @property
    def is_other(self) -> bool:
        """Whether the same scenes were rendered with other random numbers."""
        return self.is_paired and not same_images(self.before["signal"], self.after["signal"])

    @property
    def told(self) -> bool:
        """Whether anything tells what chance does to the difference."""
        return self.key[0] in TOLERANCES or not self.is_other

    def change(self, confidence: float) -> Change:
        """The difference and its interval."""
        metric = replace(definition_of(self.key[0]), name=self.key[0])
        a, b = (rows["value"].to_numpy(np.float64) for rows in (self.before, self.after))
        means = float(a.mean()), float(b.mean())
        difference, width = means[1] - means[0], math.nan
        if not self.is_paired:
            width = _welch(a, b, confidence)
        elif not self.is_other:
            pair = PairedDifference.of(b, a, metric, confidence)
            difference, width = pair.difference, pair.half_width
        elif self.told:
            means, width = self._pooled(confidence)
            difference = means[1] - means[0]
        count, paired = min(len(a), len(b)), self.is_paired
        return Change(
            self.run, self.key[1:], metric, *means, difference, width, count, paired, self.told
        )

    def _pooled(self, confidence: float) -> tuple[tuple[float, float], float]:
        """Means by polarised energy, and the largest difference that noise explains."""
        columns = [rows[name] for name in ("value", "noise") for rows in (self.before, self.after)]
        weight = self.before["signal"].to_numpy(np.float64)
        a, b, noise_a, noise_b = weighted_means(np.stack(columns), weight).tolist()
        quantile = NormalDist().inv_cdf(0.5 + confidence / 2)
        return (a, b), noise_width(self.key[0], noise_a, noise_b, quantile)


def _welch(a: Float64Array, b: Float64Array, confidence: float) -> float:
    """Half the width of the interval of the difference of two means."""
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        return math.nan
    parts = [values.var(ddof=1) / len(values) for values in (a, b)]
    total = float(sum(parts))
    if total == 0.0 or not math.isfinite(total):
        return 0.0 if total == 0.0 else math.nan
    free = total**2 / sum(p**2 / (len(v) - 1) for p, v in zip(parts, (a, b), strict=True))
    return student_width(confidence, free) * math.sqrt(total)


@dataclass(frozen=True)
class RunComparison:
    """Finished runs beside the first of them.

    Attributes
    ----------
    names : tuple of str
    changes : tuple of Change
        One a run, method, body, light and metric that both have.
    differing, means, changed : TextTable
        Facts that differ between the runs; error and skill of every method; changes beyond chance.
    lost : tuple of Lost
        Scenes of both runs that a method of both is scored on in the first only.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> from malus.reports.tables import sample
    >>> run = SimpleNamespace(table=sample.table(), run=sample.run())
    >>> RunComparison.of(("before", "after"), (run, run)).headline
    'nothing changed beyond chance: 10 compared, 0 better, 0 worse, 0 changed'
    """

    names: tuple[str, ...]
    changes: tuple[Change, ...]
    differing: TextTable
    means: TextTable
    changed: TextTable
    lost: tuple[Lost, ...] = ()

    @classmethod
    def of(cls, names: Sequence[str], runs: Sequence[ResultsLike]) -> RunComparison:
        """Compare runs; their names tell them apart in tables."""
        changes = compared(names, runs)
        tables = differing(names, runs), means_table(names, runs), changes_table(changes)
        return cls(tuple(names), tuple(changes), *tables, tuple(no_longer_scored(names, runs)))

    @property
    def headline(self) -> str:
        """The outcome in one line."""
        counts = Counter(change.outcome for change in self.changes)
        verdict = "changes beyond chance" if self.changed else "nothing changed beyond chance"
        parts = (f"{counts[name]} {name}" for name in ("better", "worse", "changed"))
        compared = len(self.changes) - counts["not told"]
        told = f"{verdict}: {compared} compared, {', '.join(parts)}"
        return "; ".join((told, *self._not_told(), *map(str, self.lost)))

    def _not_told(self) -> Iterator[str]:
        """What is not told, and why, as a sentence without a stop."""
        untold = [change for change in self.changes if change.outcome == "not told"]
        if untold:
            metrics = ", ".join(dict.fromkeys(change.metric.name for change in untold))
            yield (
                f"{len(untold)} not told ({metrics}): the images of both runs differ, and these "
                "metrics tell no noise; with one seed and as many samples images are the same, "
                "unless the renderer changed"
            )

    def numbers(self) -> list[dict[str, Any]]:
        """Every comparison as plain values, then what was lost.

        None stands where there is no number, "Infinity" or "-Infinity" for an infinite one.
        """
        changes = [
            {
                "run": change.run, "metric": change.metric.name,
                **dict(zip(KEYS, change.key, strict=True)),
                "before": _plain(change.before), "after": _plain(change.after),
                "difference": _plain(change.difference), "half_width": _plain(change.half_width),
                "scenes": change.scenes, "paired": change.paired, "outcome": change.outcome,
            }
            for change in self.changes
        ]  # fmt: skip
        return [*changes, *(lost.numbers() for lost in self.lost)]


class Lost(NamedTuple):
    """How many scenes of both runs a method is scored on in the first of them only."""

    run: str
    method: str
    scenes: int
    before: int
    """Scenes of both runs that it is scored on in the first."""

    def __str__(self) -> str:
        """As a sentence without a stop."""
        return f"{self.method}: {self.scenes} of {self.before} scenes are not scored in {self.run}"

    def numbers(self) -> dict[str, Any]:
        """As a line of `RunComparison.numbers`, of which it has no body, light or value."""
        none = dict.fromkeys(("body", "light", "before", "after", "difference", "half_width"))
        scenes = {"scenes": self.scenes, "paired": True, "outcome": "not scored"}
        return {"run": self.run, "metric": "nmse", "method": self.method, **none, **scenes}


def no_longer_scored(names: Sequence[str], runs: Sequence[ResultsLike]) -> Iterator[Lost]:
    """Methods that the first run scores on more of the scenes of both runs."""
    scenes = [_scored(run.table) for run in runs]
    for name, run, scored in zip(names[1:], runs[1:], scenes[1:], strict=True):
        there = set(run.table["scene"])
        for method in filter(scored.__contains__, scenes[0]):
            before = scenes[0][method] & there
            lost = len(before - scored[method])
            if lost:
                yield Lost(name, method, lost, len(before))


def _scored(table: pd.DataFrame) -> dict[str, set[str]]:
    """Scenes on which each method has an error; of one that failed on all there are none."""
    rows = overall_rows(table, "nmse")
    scored = {str(name): set(part) for name, part in rows.groupby("method", observed=True)["scene"]}
    return {str(method): scored.get(str(method), set()) for method in distinct(table["method"])}


def _plain(value: float) -> float | str | None:
    """A number for JSON, which has none that are not finite."""
    if math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    return None if math.isnan(value) else value


def changes_table(changes: Sequence[Change]) -> TextTable:
    """What changed, the worse first; without what stayed the same."""
    order = {"worse": 0, "changed": 1, "better": 2}
    listed = sorted((c for c in changes if c.outcome in order), key=lambda c: order[c.outcome])
    lines = [
        [
            change.outcome, change.run, change.metric.name, *change.key,
            number_with_error(change.before, math.nan), number_with_error(change.after, math.nan),
            number_with_error(change.difference, change.half_width),
            f"{change.scenes} {'the same' if change.paired else 'others'}",
        ]
        for change in listed
    ]  # fmt: skip
    heads = ("", "run", "metric", *KEYS, "before", "after", "difference", "scenes")
    return TextTable(heads, lines)


def means_table(names: Sequence[str], runs: Sequence[ResultsLike]) -> TextTable:
    """NMSE and median skill of every method over all scenes of each run: a line a method and run.

    How many have a skill is told where the noise leaves some without one.
    """
    methods = dict.fromkeys(m for run in runs for m in distinct(run.table["method"]))
    lines = [
        [method, name, *_means(run.table[run.table["method"] == method], method)]
        for method in methods
        for name, run in zip(names, runs, strict=True)
    ]
    return TextTable(("method", "run", "NMSE", "skill", "scenes"), lines)


def _means(rows: pd.DataFrame, method: str) -> list[str]:
    nmse, skill = (overall_rows(rows, name)["value"] for name in ("nmse", "skill"))
    finite, told = not nmse.isna().any(), int(skill.notna().sum())
    partly = method != TRIVIAL and told < len(nmse)
    mean = number_with_error(complete_mean(nmse), math.nan)
    return [
        mean if finite else "not finite",
        number_with_error(float(skill.median()) if finite else math.nan, math.nan),
        f"{len(nmse)}, {told} with a skill" if partly else str(len(nmse)),
    ]


def differing(names: Sequence[str], runs: Sequence[ResultsLike]) -> TextTable:
    """Suite, seed, variant, samples and versions, where they differ between the runs."""
    facts = [_facts(run.run) for run in runs]
    known = dict.fromkeys(fact for each in facts for fact in each)
    lines = [
        [fact, *(each.get(fact, "none") for each in facts)]
        for fact in known
        if len({each.get(fact) for each in facts}) > 1
    ]
    return TextTable(("", *names), lines)


def _facts(run: dict[str, Any]) -> dict[str, str]:
    suite = run.get("suite", {})
    sampling = suite.get("sampling", {})
    facts = {
        "suite": suite.get("name", "none"),
        "seed": sampling.get("seed"),
        "samples": sampling.get("samples"),
        "resolution": suite.get("camera", {}).get("resolution"),
        "variant": run.get("variant", {}).get("name"),
        **{f"version of {name}": value for name, value in run.get("versions", {}).items()},
    }
    return {name: str(value) for name, value in facts.items() if value is not None}
