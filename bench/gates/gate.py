"""Whether accuracy got worse by more than noise and tolerance, and what could have been seen.

A value is compared with the baseline's for the same method, body, light and surface. Their
difference d is judged against

    limit = tolerance + z · error(d),

with z so large that all comparisons of a run together raise a false alarm once in a thousand
runs. Where both runs rendered the very same images, d holds no noise of the renders: the
comparison is paired and its error nearly nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

from malus.bench.gates.baseline import Baseline, Measured, Origin, Rule, measure
from malus.bench.running.results import Results
from malus.scenes.core.errors import InputError

FALSE_ALARM = 1e-3
"""Probability that noise alone turns a whole run red."""

UNSEEN = 1.6
"""Factor on standard errors measured from halves of the samples. The halves share the pixels'
mean normals and the mask, whose noise they cannot show: over 24 seeds the spread of gains was up
to 1.6 times the measured error (distant light, roughness 0.4), usually 0.7 to 1.2 times."""

PAIRED_NOISE = 0.01
"""Part of the noise that is left in a difference over the same images: rounding, which may differ
between machines."""

SAME_SIGNAL = 1e-5
"""Relative difference of true polarised intensities up to which renders are the same images."""

SEEN = 2.0
"""Standard deviations beyond the limit at which a change is seen 98 times in 100."""

Outcome = Literal["same", "better", "worse", "changed", "missing", "not finite", "new"]
FAILURES: tuple[Outcome, ...] = ("worse", "changed", "missing", "not finite")
_IDEAL = {"gain": 1.0, "rotation": 0.0}


@dataclass(frozen=True)
class Verdict:
    """One comparison.

    Attributes
    ----------
    key : metric, method, knowledge, body, light, surface
    outcome : str
        `worse` and `changed` are beyond the limit. A gain or rotation that moved towards its
        ideal is `changed` and fails as well: unless somebody meant it, it is an accident that
        hides another. A skill that rose is `better` and passes.
    before, after : float
        Values of the baseline and the run, NaN where there is none.
    error : float
        Standard error of their difference.
    limit, visible : float
        Difference beyond which it fails, and the smallest that would have been seen.
    paired : bool
        Both runs rendered the same images.
    reason : str
        Of the tolerance.
    """

    key: tuple[str, ...]
    outcome: Outcome
    before: float = math.nan
    after: float = math.nan
    error: float = math.nan
    limit: float = math.nan
    visible: float = math.nan
    paired: bool = False
    reason: str = ""

    @property
    def change(self) -> float:
        """After minus before."""
        return self.after - self.before

    @property
    def failed(self) -> bool:
        """Whether this turns the gate red."""
        return self.outcome in FAILURES


def gate(results: Results, baseline: Baseline) -> list[Verdict]:
    """Compare a run with a baseline, in the order of the baseline.

    Raises
    ------
    InputError
        If the run rendered other scenes than the baseline's.
    """
    origin = Origin.of(results)
    _require_same_scenes(origin, baseline.origin)
    found = {m.key if isinstance(m, Measured) else m: m for m in measure(results)}
    gated = [(value, rule) for value in baseline.values if (rule := baseline.rule(value))]
    same_run = (origin.seed, origin.variant) == (baseline.origin.seed, baseline.origin.variant)
    z = _quantile(len(gated))
    verdicts = [_compare(value, found.get(value.key), rule, same_run, z) for value, rule in gated]
    return verdicts + list(_new(found.values(), baseline))


def passed(verdicts: Sequence[Verdict]) -> bool:
    """Whether nothing failed."""
    return not any(verdict.failed for verdict in verdicts)


def _require_same_scenes(origin: Origin, expected: Origin) -> None:
    if origin.scenes != expected.scenes:
        raise InputError(
            "results",
            f"the scenes and samples of the baseline, suite {expected.suite} ({expected.scenes})",
            f"suite {origin.suite} ({origin.scenes})",
            "run the baseline's suite, or write a new baseline with --update",
        )


def _quantile(comparisons: int) -> float:
    """Two-sided normal quantile of FALSE_ALARM shared by all comparisons (Bonferroni)."""
    return NormalDist().inv_cdf(1.0 - 0.5 * FALSE_ALARM / max(comparisons, 1))


def _compare(
    before: Measured, after: Measured | tuple[str, ...] | None, rule: Rule, same_run: bool, z: float
) -> Verdict:
    if not isinstance(after, Measured):
        outcome: Outcome = "missing" if after is None else "not finite"
        return Verdict(before.key, outcome, before=before.value, reason=rule.reason)
    paired = same_run and math.isclose(before.signal, after.signal, rel_tol=SAME_SIGNAL)
    error = math.hypot(before.noise, after.noise) * (PAIRED_NOISE if paired else UNSEEN)
    limit = rule.tolerance + z * error
    return Verdict(
        key=before.key,
        outcome=_outcome(before, after, limit),
        before=before.value,
        after=after.value,
        error=error,
        limit=limit,
        visible=limit + SEEN * error,
        paired=paired,
        reason=rule.reason,
    )


def _outcome(before: Measured, after: Measured, limit: float) -> Outcome:
    if abs(after.value - before.value) <= limit:
        return "same"
    ideal = _IDEAL.get(before.metric)
    if ideal is None:
        return "better" if after.value > before.value else "worse"
    nearer = abs(after.value - ideal) < abs(before.value - ideal)
    return "changed" if nearer else "worse"


def _new(found: Iterable[Measured | tuple[str, ...]], baseline: Baseline) -> Iterator[Verdict]:
    known = {value.key for value in baseline.values}
    for value in found:
        if isinstance(value, Measured) and value.key not in known and baseline.rule(value):
            yield Verdict(value.key, "new", after=value.value)


def updated(results: Results, baseline: Baseline | None, rules: tuple[Rule, ...]) -> Baseline:
    """A baseline of this run, with the rules of the old one.

    Raises
    ------
    InputError
        If a method gave values that are not finite: nothing to hold anybody to.
    """
    fresh = Baseline(origin=Origin.of(results), rules=baseline.rules if baseline else rules)
    values = []
    for value in measure(results):
        if not isinstance(value, Measured):
            where = ", ".join(value)
            raise InputError("results", "finite values", f"none for {where}", "mend the method")
        if fresh.rule(value):
            values.append(value)
    return fresh.model_copy(update={"values": tuple(values)})
