"""Gate: compare the accuracy of a run with a baseline, beyond noise and tolerance.

A value is compared with the baseline's for the same method, body, light and surface. Their
difference d is judged against

    limit = tolerance + z · error(d),

with z so large that all comparisons of a run together raise a false alarm once in a thousand
runs. Where both runs rendered the very same images, d holds no noise of the renders: the
comparison is paired and its error nearly nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

from malus.bench.gates.baseline import Baseline, PooledMetric, RunIdentity, ToleranceRule, measure
from malus.bench.running.results import Results
from malus.reports.tables.other_images import HIDDEN_NOISE, SAME_SIGNAL
from malus.scenes.core.errors import InputError

FALSE_ALARM = 1e-3
"""Probability that noise alone turns a whole run red."""

PAIRED_NOISE = 0.01
"""Fraction of the noise that is left in a difference over the same images: rounding, which may
differ between machines."""

DETECTED = 2.0
"""Standard errors beyond the limit at which a change is detected 98 times in 100."""

Outcome = Literal["same", "better", "worse", "changed", "missing", "not finite", "not told", "new"]
FAILURES: tuple[Outcome, ...] = ("worse", "changed", "missing", "not finite")
_IDEAL = {"gain": 1.0, "rotation": 0.0}


@dataclass(frozen=True)
class Comparison:
    """A value of a run compared with the baseline's.

    Attributes
    ----------
    key : metric, method, knowledge, body, light, surface
    outcome : str
        `worse` and `changed` are beyond the limit. A gain or rotation that moved towards its
        ideal is `changed` and fails as well: unless it is intended, it may hide an error. So is a
        value of more scenes than the baseline's. A skill that rose is `better` and passes, and so
        does one that the noise of another seed leaves `not told`.
    before, after : float
        Values of the baseline and the run, NaN where there is none.
    error : float
        Standard error of their difference.
    limit, visible : float
        Difference beyond which it fails, and the smallest that is detected almost surely.
    paired : bool
        Whether both runs rendered the same images.
    reason : str
        The reason for the tolerance; without a limit, why nothing could be compared.
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


def gate(results: Results, baseline: Baseline) -> list[Comparison]:
    """Compare the values of a run with those of a baseline, in the baseline's order.

    Raises
    ------
    InputError
        If the run rendered other scenes than the baseline's, or nothing of it is gated.
    """
    origin = RunIdentity.of(results)
    _require_same_scenes(results, origin, baseline.origin)
    measured = dict(
        (v.key, v) if isinstance(v, PooledMetric) else (v, None) for v in measure(results)
    )
    gated = [(value, rule) for value in baseline.values if (rule := baseline.rule(value))]
    if not gated:
        expected, hint = "values that one of its rules gates", "write them with `update`"
        raise InputError("baseline", expected, "none: nothing would be compared", hint)
    same_run = (origin.seed, origin.variant) == (baseline.origin.seed, baseline.origin.variant)
    z = _quantile(len(gated))
    comparisons = [
        _not_compared(value, measured, same_run)
        or _compare(value, measured[value.key], rule, same_run, z)
        for value, rule in gated
    ]
    return comparisons + list(_new(measured.values(), baseline))


def passed(comparisons: Sequence[Comparison]) -> bool:
    """Whether no comparison failed."""
    return not any(comparison.failed for comparison in comparisons)


def _require_same_scenes(results: Results, origin: RunIdentity, expected: RunIdentity) -> None:
    if not expected.is_of(results):
        raise InputError(
            "results",
            f"the scenes and samples of the baseline, suite {expected.suite} ({expected.scenes})",
            f"suite {origin.suite} ({origin.scenes})",
            "run the baseline's suite, or write a new baseline with `update`",
        )


def _quantile(comparisons: int) -> float:
    """Two-sided normal quantile of FALSE_ALARM shared by all comparisons (Bonferroni)."""
    return NormalDist().inv_cdf(1.0 - 0.5 * FALSE_ALARM / max(comparisons, 1))


_Measured = Mapping[tuple[str, ...], PooledMetric | None]
"""Values of a run by key; None where one is not finite."""


def _not_compared(before: PooledMetric, measured: _Measured, same_run: bool) -> Comparison | None:
    """Say why a value is not compared; None where it is: over the same scenes."""
    # Whether a render's noise leaves a skill to tell may differ with its seed.
    may_differ = not same_run and before.metric == "facing_skill"
    after = measured.get(before.key)
    outcome: Outcome = "missing"
    if after is None:
        reason = "no scene has it"
        if before.key in measured:
            outcome, reason = "not finite", "a scene's value is not finite"
        elif may_differ and measured.get(("gain", *before.key[1:])) is not None:
            outcome, reason = "not told", "the noise of this seed hides the guess's error"
        return Comparison(before.key, outcome, before.value, reason=reason)
    if after.scenes == before.scenes or may_differ:
        return None
    found = f"{after.scenes} of {before.scenes} scenes have it"
    if after.scenes > before.scenes:
        outcome, found = "changed", f"of {after.scenes} scenes, in the baseline of {before.scenes}"
    return Comparison(before.key, outcome, before.value, after.value, reason=found)


def _compare(
    before: PooledMetric,
    after: PooledMetric | None,
    rule: ToleranceRule,
    same_run: bool,
    z: float,
) -> Comparison:
    """Compare two values."""
    assert after is not None  # of which `_not_compared` tells
    paired = same_run and math.isclose(before.signal, after.signal, rel_tol=SAME_SIGNAL)
    error = math.hypot(before.noise, after.noise) * (PAIRED_NOISE if paired else HIDDEN_NOISE)
    limit = rule.tolerance + z * error
    return Comparison(
        key=before.key,
        outcome=_outcome(before, after, limit),
        before=before.value,
        after=after.value,
        error=error,
        limit=limit,
        visible=limit + DETECTED * error,
        paired=paired,
        reason=rule.reason,
    )


def _outcome(before: PooledMetric, after: PooledMetric, limit: float) -> Outcome:
    """Outcome of a comparison of two finite values."""
    if abs(after.value - before.value) <= limit:
        return "same"
    ideal = _IDEAL.get(before.metric)
    if ideal is None:
        return "better" if after.value > before.value else "worse"
    nearer = abs(after.value - ideal) < abs(before.value - ideal)
    return "changed" if nearer else "worse"


def _new(measured: Iterable[PooledMetric | None], baseline: Baseline) -> Iterator[Comparison]:
    """Values of the run that a rule matches and the baseline does not have."""
    reviewed = {value.key for value in baseline.values}
    for value in measured:
        if value is not None and value.key not in reviewed and baseline.rule(value):
            yield Comparison(value.key, "new", after=value.value)


def updated(
    results: Results, baseline: Baseline | None, rules: tuple[ToleranceRule, ...]
) -> Baseline:
    """Baseline with the values of this run and the rules of the old baseline.

    Raises
    ------
    InputError
        If a method gave values that are not finite.
    """
    new = Baseline(origin=RunIdentity.of(results), rules=baseline.rules if baseline else rules)
    values = []
    for value in measure(results):
        if not isinstance(value, PooledMetric):
            where = ", ".join(value)
            raise InputError("results", "finite values", f"none for {where}", "mend the method")
        if new.rule(value):
            values.append(value)
    return new.model_copy(update={"values": tuple(values)})
