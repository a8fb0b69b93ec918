"""Baseline of the gate: reviewed values of a run, and the tolerances of later runs.

The file is TOML. Its rules are written by people: metric, tolerance and the reason for it, for
the methods, bodies, lights and surfaces that match their patterns; the last rule that matches
holds. Its measured values are written by `malus.update_baseline`, one line each.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal, get_args

import pandas as pd
from pydantic import Field

from malus.bench.running.results import Results
from malus.reports.tables.other_images import TOLERANCES
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.files import write_text
from malus.scenes.core.model import Model, content_id

GatedMetric = Literal["gain", "rotation", "facing_skill", "skill"]
"""Metrics whose standard error is known; in the others noise looks like a change. The plain skill
is gated only on captures, whose pictures stay the same."""

CAPTURES = "captures"
"""Key of the record of results of real captures, and what stands for their variant."""

KEYS = ("method", "knowledge", "body", "light", "surface")
"""Columns that identify a measured value; scenes of other shapes and materials are pooled."""

_HEADER = """\
# What was measured when this baseline was reviewed. People write the rules; `malus gate` writes the
# rest when it updates them, and the difference is what there is to review.
"""


class ToleranceRule(Model):
    """Largest change of a metric beyond the noise, and the reason for it; patterns as in a shell.

    A tolerance cannot be zero: it also stands for noise far below it that the halves of the samples
    do not show (for a perfect method, whose measured error is nearly nothing).
    """

    metric: GatedMetric
    tolerance: float = Field(gt=0)
    reason: str = Field(min_length=1)
    method: str = "*"
    knowledge: str = "*"
    body: str = "*"
    light: str = "*"
    surface: str = "*"

    def matches(self, value: PooledMetric) -> bool:
        """Whether this rule holds for that value."""
        return self.metric == value.metric and all(
            fnmatchcase(getattr(value, key), getattr(self, key)) for key in KEYS
        )


class PooledMetric(Model):
    """Value of a metric for one method, pooled over the scenes of one body, light and surface.

    `noise` is the standard error of `value`, `signal` the true polarised intensity over the peak
    (root mean square), by which scenes are weighted and renders are recognised.
    """

    metric: GatedMetric
    method: str
    knowledge: str = "everything"
    body: str
    light: str
    surface: str
    value: float
    noise: float = Field(ge=0)
    signal: float = Field(gt=0)
    scenes: int = Field(ge=1)

    @property
    def key(self) -> tuple[str, ...]:
        """Metric, method, knowledge, body, light and surface: equal where values are compared."""
        return (self.metric, *(getattr(self, key) for key in KEYS))


_OF_NO_SCENE = ("name", "description", "methods", "maps", "licence")
"""Keys of a suite that change neither its scenes nor their samples; metrics do not, either."""


class RunIdentity(Model):
    """Suite, seed and variant of a run; `scenes` hashes the suite without seed and methods."""

    suite: str
    scenes: str
    seed: int
    variant: str

    @classmethod
    def of(cls, results: Results) -> RunIdentity:
        """Identify the run that results come from.

        Raises
        ------
        InputError
            If their record does not name it.
        """
        if CAPTURES in results.run:
            read = content_id(sorted(capture["scene"] for capture in results.run[CAPTURES]))
            name = results.run["suite"]["name"]
            return cls(suite=name, scenes=read, seed=0, variant=CAPTURES)
        try:
            suite, variant = dict(results.run["suite"]), results.run["variant"]["name"]
            sampling = dict(suite["sampling"])
            name, seed = suite["name"], sampling.pop("seed")
        except (KeyError, TypeError) as error:
            raise InputError(
                "results, run.json", "suite, seed and variant", f"no {error}", "run the suite again"
            ) from None
        content = {key: value for key, value in suite.items() if key not in _OF_NO_SCENE}
        # Without metrics the hash is that of earlier versions, where most runs had none.
        scenes = content_id(content | {"metrics": [], "sampling": sampling})
        return cls(suite=name, scenes=scenes, seed=seed, variant=variant)

    def is_of(self, results: Results) -> bool:
        """Whether results are of the same scenes at as many samples."""
        if self.scenes == RunIdentity.of(results).scenes:
            return True
        if CAPTURES in results.run:
            return False
        # Earlier versions counted metrics, maps and licence among what decides the scenes.
        suite = dict(results.run["suite"])
        sampling = {key: value for key, value in suite["sampling"].items() if key != "seed"}
        content = {k: v for k, v in suite.items() if k not in ("name", "description", "methods")}
        return self.scenes == content_id(content | {"sampling": sampling})


class Baseline(Model):
    """Rules and measured values of a reviewed run.

    Examples
    --------
    >>> value = PooledMetric(metric="gain", method="eq8", body="polarised", light="uniform",
    ...                  surface="rust", value=0.9, noise=0.001, signal=0.1, scenes=1)
    >>> origin = RunIdentity(suite="gate", scenes="0", seed=1, variant="scalar")
    >>> Baseline(origin=origin, rules=DEFAULT_RULES, values=(value,)).rule(value).tolerance
    0.005
    """

    origin: RunIdentity
    rules: tuple[ToleranceRule, ...] = Field(min_length=1)
    values: tuple[PooledMetric, ...] = ()

    def rule(self, value: PooledMetric) -> ToleranceRule | None:
        """The last rule that matches a value, or None: then the value is not gated."""
        return next((rule for rule in reversed(self.rules) if rule.matches(value)), None)


DEFAULT_RULES = (
    ToleranceRule(
        metric="gain",
        tolerance=TOLERANCES["gain"],
        reason="a quarter of the 2 % that must never pass",
    ),
    ToleranceRule(
        metric="rotation",
        tolerance=TOLERANCES["rotation"],
        reason="a turn by 0.14 degrees at equal strength",
    ),
    ToleranceRule(
        metric="facing_skill",
        tolerance=TOLERANCES["facing_skill"],
        reason="a hundredth of the way to the trivial guess",
    ),
)
"""Rules of a new baseline."""

CAPTURE_RULES = (
    *DEFAULT_RULES[:2],
    ToleranceRule(metric="skill", tolerance=0.01, reason="a hundredth of the way to the guess"),
)
"""Rules of a new baseline of captures."""


def default_rules(results: Results) -> tuple[ToleranceRule, ...]:
    """Rules of a new baseline of these results."""
    return CAPTURE_RULES if CAPTURES in results.run else DEFAULT_RULES


def _gated(results: Results) -> tuple[str, ...]:
    """Metrics that are compared on these results."""
    left_out = "facing_skill" if CAPTURES in results.run else "skill"
    return tuple(metric for metric in get_args(GatedMetric) if metric != left_out)


def measure(results: Results) -> Iterator[PooledMetric | tuple[str, ...]]:
    """Pool the gated metrics over the scenes of each body, light and surface.

    Scenes are weighted by their true polarised energy, which makes the pooled gain the slope over
    all their pixels. Their noises are added as they stand: scenes of one seed share their random
    numbers, so that their errors need not cancel.

    Yields
    ------
    PooledMetric, or its key where a value of the method is not finite.

    Raises
    ------
    InputError
        If the results hold none of these metrics.
    """
    table = results.headlines
    keys = ["scene", *KEYS]
    signal = table[table.metric == "signal"][[*keys, "value"]].rename(columns={"value": "signal"})
    gated = table[table.metric.isin(_gated(results))]
    gated = gated.merge(signal[signal.signal > 0], on=keys)
    # Without a value the truth has no polarisation, or noise alone, or no pixel faces the camera:
    # nothing to compare with. Where the estimate is not finite its error is no number either.
    errors = table[table.metric == "nmse"][[*keys, "value"]].rename(columns={"value": "nmse"})
    gated = gated.merge(errors, on=keys, how="left")
    gated = gated[gated.value.notna() | gated.nmse.isna()]
    if gated.empty:
        raise InputError(
            "results",
            f"{', '.join(_gated(results))} and signal",
            "none",
            "run the suite again",
        )
    for key, rows in gated.groupby(["metric", *KEYS], sort=False):
        yield _pooled(tuple(str(name) for name in key), rows)


def _pooled(key: tuple[str, ...], rows: pd.DataFrame) -> PooledMetric | tuple[str, ...]:
    """Mean of the rows of one key, weighted by true polarised energy."""
    weights = rows.signal**2 / (rows.signal**2).sum()
    value = float((weights * rows.value).sum(skipna=False))
    noise = float((weights * rows.noise).sum(skipna=False))
    if not (math.isfinite(value) and math.isfinite(noise)):
        return key
    names: dict[str, Any] = dict(zip(("metric", *KEYS), key, strict=True))
    signal = float((rows.signal**2).mean() ** 0.5)
    return PooledMetric(**names, value=value, noise=noise, signal=signal, scenes=len(rows))


def read_baseline(path: Path) -> Baseline:
    """Read and validate a baseline.

    Raises
    ------
    InputError
        Unreadable or malformed file, wrong key or value.
    """
    where = f"baseline {path}"
    hint = "`malus gate` with `update` writes one"
    with reading(where, "a readable file", hint):
        content = path.read_bytes()
    with reading(where, "a TOML file", hint):
        data = tomllib.loads(content.decode())
    return Baseline.parse(data, where)


def write_baseline(path: Path, baseline: Baseline) -> None:
    """Write a baseline that `read_baseline` reads; the same content gives the same bytes.

    Values stand on one line each, for review as a difference; tomli-w needs eleven.
    """
    lines = [_HEADER, "values = ["]
    values = sorted(baseline.values, key=lambda value: value.key)
    lines += [f"    {_inline(value.model_dump())}," for value in values]
    lines += ["]", "", "[origin]", *_pairs(baseline.origin.model_dump())]
    for rule in baseline.rules:
        given = {k: v for k, v in rule.model_dump().items() if v != "*"}
        lines += ["", "[[rules]]", *_pairs(given)]
    text = "\n".join(lines) + "\n"
    write_text(path, text)


def _inline(content: dict[str, Any]) -> str:
    return "{ " + ", ".join(_pairs(content)) + " }"


def _pairs(content: dict[str, Any]) -> list[str]:
    return [f"{name} = {_toml(value)}" for name, value in content.items()]


def _toml(value: Any) -> str:
    if isinstance(value, float):
        # Seven digits: more than float32 renders hold, few enough to be read.
        text = f"{value:.7g}"
        return text if set(text) & set(".e") else f"{text}.0"
    # A JSON string without surrogate escapes is a TOML basic string, and so is a JSON integer.
    return json.dumps(value, ensure_ascii=False)
