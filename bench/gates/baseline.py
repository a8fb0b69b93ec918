"""A baseline: what a run measured when somebody reviewed it, and how far a later run may drift.

The file is TOML. Its rules are written by people: metric, tolerance and the reason for it, for
the methods, bodies, lights and surfaces that match their patterns; the last rule that matches
holds. Its measured values are written by `malus gate --update`, one line each.
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
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import write_whole
from malus.scenes.core.model import Model, content_id

GatedMetric = Literal["gain", "rotation", "facing_skill"]
"""Metrics whose standard error is measured with them; the others cannot tell noise from change."""

KEYS = ("method", "knowledge", "body", "light", "surface")
"""What a measured value belongs to; scenes that differ only in shape and material are pooled."""

_HEADER = """\
# What was measured when this baseline was reviewed. People write the rules; `malus gate --update`
# writes the rest, and its difference is what there is to review.
"""


class Rule(Model):
    """How far a metric may drift beyond the noise, and why that much; patterns as in a shell.

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

    def matches(self, measured: Measured) -> bool:
        """Whether this rule is about that value."""
        return self.metric == measured.metric and all(
            fnmatchcase(getattr(measured, key), getattr(self, key)) for key in KEYS
        )


class Measured(Model):
    """A metric of one method on the scenes of one body, light and surface.

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
        """What must be equal for two values to be compared."""
        return (self.metric, *(getattr(self, key) for key in KEYS))


class Origin(Model):
    """The run that was measured; `scenes` is a hash of the suite without seed and methods."""

    suite: str
    scenes: str
    seed: int
    variant: str

    @classmethod
    def of(cls, results: Results) -> Origin:
        """Where results come from.

        Raises
        ------
        InputError
            If they do not say so.
        """
        try:
            suite, variant = dict(results.run["suite"]), results.run["variant"]["name"]
            sampling = dict(suite["sampling"])
            name, seed = suite["name"], sampling.pop("seed")
        except (KeyError, TypeError) as error:
            raise InputError(
                "results, run.json", "suite, seed and variant", f"no {error}", "run the suite again"
            ) from None
        # A method more or another description leaves the scenes as they are.
        content = {k: v for k, v in suite.items() if k not in ("name", "description", "methods")}
        scenes = content_id(content | {"sampling": sampling})
        return cls(suite=name, scenes=scenes, seed=seed, variant=variant)


class Baseline(Model):
    """Rules and measured values.

    Examples
    --------
    >>> value = Measured(metric="gain", method="eq8", body="polarised", light="uniform",
    ...                  surface="rust", value=0.9, noise=0.001, signal=0.1, scenes=1)
    >>> origin = Origin(suite="gate", scenes="0", seed=1, variant="scalar")
    >>> Baseline(origin=origin, rules=DEFAULT_RULES, values=(value,)).rule(value).tolerance
    0.005
    """

    origin: Origin
    rules: tuple[Rule, ...] = Field(min_length=1)
    values: tuple[Measured, ...] = ()

    def rule(self, measured: Measured) -> Rule | None:
        """The last rule that matches, or None: then the value is not gated."""
        return next((rule for rule in reversed(self.rules) if rule.matches(measured)), None)


DEFAULT_RULES = (
    Rule(metric="gain", tolerance=0.005, reason="a quarter of the 2 % that must never pass"),
    Rule(metric="rotation", tolerance=0.005, reason="a mean angle of 0.14 degrees at gain 1"),
    Rule(
        metric="facing_skill", tolerance=0.01, reason="a hundredth of the way to the trivial guess"
    ),
)
"""Rules of a new baseline."""


def measure(results: Results) -> Iterator[Measured | tuple[str, ...]]:
    """Gated metrics pooled over the scenes of a body, light and surface.

    Scenes are weighted by their true polarised energy, which makes the pooled gain the slope over
    all their pixels. Their noises are added as they stand: scenes of one seed share their random
    numbers, so that their errors need not cancel.

    Yields
    ------
    Measured, or its key where the method gave values that are not finite.

    Raises
    ------
    InputError
        If the results hold none of these metrics.
    """
    table = results.headlines
    scene = ["scene", *KEYS]
    signal = table[table.metric == "signal"][[*scene, "value"]].rename(columns={"value": "signal"})
    gated = table[table.metric.isin(get_args(GatedMetric))]
    gated = gated.merge(signal[signal.signal > 0], on=scene)
    # No pixel faces the viewer, or the truth there is all noise: nothing to compare with. A method
    # that is not finite still shows in its gain.
    gated = gated[(gated.metric != "facing_skill") | gated.value.notna()]
    if gated.empty:
        raise InputError(
            "results",
            f"{', '.join(get_args(GatedMetric))} and signal",
            "none",
            "run the suite again",
        )
    for key, part in gated.groupby(["metric", *KEYS], sort=False):
        yield _pooled(tuple(str(name) for name in key), part)


def _pooled(key: tuple[str, ...], part: pd.DataFrame) -> Measured | tuple[str, ...]:
    weights = part.signal**2 / (part.signal**2).sum()
    value = float((weights * part.value).sum(skipna=False))
    noise = float((weights * part.noise).sum(skipna=False))
    if not (math.isfinite(value) and math.isfinite(noise)):
        return key
    names: dict[str, Any] = dict(zip(("metric", *KEYS), key, strict=True))
    signal = float((part.signal**2).mean() ** 0.5)
    return Measured(**names, value=value, noise=noise, signal=signal, scenes=len(part))


def read_baseline(path: Path) -> Baseline:
    """Read and validate a baseline.

    Raises
    ------
    InputError
        Unreadable or malformed file, wrong key or value.
    """
    hint = "`malus gate RESULTS --baseline FILE --update` writes one"
    try:
        data = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"baseline {path}", "a readable file", reason, hint) from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"baseline {path}", "a TOML file", str(error), hint) from None
    return Baseline.parse(data, f"baseline {path}")


def write_baseline(path: Path, baseline: Baseline) -> None:
    """Write a baseline that `read_baseline` reads; the same content gives the same bytes."""
    lines = [_HEADER, "values = ["]
    lines += [f"    {_inline(v.model_dump())}," for v in sorted(baseline.values, key=_order)]
    lines += ["]", "", "[origin]", *_pairs(baseline.origin.model_dump())]
    for rule in baseline.rules:
        chosen = {k: v for k, v in rule.model_dump().items() if v != "*"}
        lines += ["", "[[rules]]", *_pairs(chosen)]
    text = "\n".join(lines) + "\n"
    write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def _order(value: Measured) -> tuple[str, ...]:
    return value.key


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
