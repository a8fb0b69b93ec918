"""Scores of every method on the scenes of a family, together where their bands allow it."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from malus.bench.running.examples import write_example
from malus.bench.running.family_task import FamilyResult, raise_what_stops
from malus.bench.running.results import Record, describe, inapplicable, record
from malus.bench.running.truths import Renders
from malus.bench.scoring.family_scores import FamilyJudge, FamilyPixels, NotTogether
from malus.bench.scoring.judge import Judge, Metric, values_of
from malus.bench.scoring.knowledge_ladder import EVERYTHING, climbing, rungs
from malus.reconstruct import Inapplicable, Method, Observation
from malus.renderers.truth import Truth
from malus.scenes.scene import Scene


@dataclass(frozen=True)
class ScoringPlan:
    """How a scene is scored: methods, metrics, and whether on every rung of the ladder.

    `part` is the id of the part of the run that examples belong to.
    """

    methods: Sequence[Method]
    metrics: Sequence[Metric] = ()
    ladder: bool = False
    part: str = ""


@dataclass
class SceneResult:
    """Scores of every method on one scene; `outcome` has failures, examples and seconds."""

    scene: Scene
    records: list[Record] = field(default_factory=list)
    outcome: FamilyResult = field(default_factory=FamilyResult)
    interpolation_rms: float = 0.0
    samples: int | None = None

    def score(
        self,
        render_stage: str,
        truth_of: Callable[[Scene], Truth],
        plan: ScoringPlan,
        keep_example: bool,
    ) -> None:
        """Make the truth, score every method on it, and keep its images if they are wanted."""
        truth = None
        with self.outcome.guard(self.scene), self.outcome.stage(render_stage):
            truth = truth_of(self.scene)
        if truth is None:
            return
        self.samples = truth.samples
        self.interpolation_rms = truth.interpolation_error.get("rms", 0.0)
        with self.outcome.guard(self.scene):
            self._score_methods(truth, plan)
        if keep_example:
            self.keep_example(truth, plan)

    def keep_example(self, truth: Truth, plan: ScoringPlan) -> None:
        """Keep the images of the truth and of every method that worked."""
        with self.outcome.guard(self.scene), self.outcome.stage("write examples"):
            self.outcome.examples |= _example(truth, self.outcome.worked(plan.methods), plan.part)

    def _score_methods(self, truth: Truth, plan: ScoringPlan) -> None:
        with self.outcome.stage("score"):
            judge, columns = Judge(truth), describe(truth.scene)
        with self.outcome.stage("reconstruct"):
            rungs_below = list(rungs(judge.pixels)) if plan.ladder else []
        for method in plan.methods:
            # Methods that need a picture have rungs of their own: blind, blind-light, …
            below = rungs_below if method.per_pixel else []
            above = climbing(method) if plan.ladder else ()
            with self.outcome.guard(self.scene, method):
                for rung in [(EVERYTHING, judge.pixels.observation), *below]:
                    self._score_rung(judge, method, plan.metrics, columns, rung)
                for name, told_more in above:
                    rung = name, judge.pixels.observation
                    self._score_rung(judge, told_more, plan.metrics, columns, rung)

    def _score_rung(
        self,
        judge: Judge,
        method: Method,
        metrics: Sequence[Metric],
        columns: dict[str, Any],
        rung: tuple[str, Observation | Inapplicable],
    ) -> None:
        """Record the score of one method on one rung, or why there is none."""
        knowledge, observation = rung
        try:
            if isinstance(observation, Inapplicable):
                raise observation
            with self.outcome.stage("reconstruct"):
                estimate = judge.pixels.estimate(method, observation)
            with self.outcome.stage("score"):
                values = judge.score_estimate(estimate, metrics).values()
                self.records.append(record(columns, method.name, values, knowledge=knowledge))
        except Inapplicable as reason:
            self.records.append(inapplicable(columns, method.name, str(reason), knowledge))


def score_together(
    results: Sequence[SceneResult],
    renders: Renders,
    plan: ScoringPlan,
    examples: frozenset[str],
) -> bool:
    """Score the scenes of `results` in one pass, or return False where each needs its own."""
    apart = all(method.per_pixel and method.per_band for method in plan.methods)
    if renders.family is None or plan.metrics or plan.ladder or not apart:
        return False
    scenes = tuple(result.scene for result in results)
    outcome = results[0].outcome  # that of the first scene has the seconds of all
    try:
        with outcome.stage(renders.stage):
            pixels = FamilyPixels.of(renders.family, scenes, renders.first)
        with outcome.stage("score"):
            judge = FamilyJudge(pixels)
        columns = [describe(scene) for scene in scenes]
        records = [_records_of(method, pixels, judge, columns, outcome) for method in plan.methods]
    except NotTogether:
        return False
    except Exception as error:  # scored one by one, it costs its own scene and method only
        raise_what_stops(error)
        return False
    for number, result in enumerate(results):
        result.records += [of_method[number] for of_method in records]
        result.samples = pixels.first.samples
        result.interpolation_rms = pixels.first.interpolation_error.get("rms", 0.0)
        if columns[number]["scene"] in examples:
            with result.outcome.guard(result.scene):
                result.keep_example(renders.truth_of(result.scene), plan)
    return True


def _records_of(
    method: Method,
    pixels: FamilyPixels,
    judge: FamilyJudge,
    columns: Sequence[dict[str, Any]],
    outcome: FamilyResult,
) -> list[Record]:
    """Rows of one method on scenes that are scored together."""
    try:
        with outcome.stage("reconstruct"):
            estimate = pixels.estimate(method)
    except Inapplicable as reason:
        return [inapplicable(about, method.name, str(reason)) for about in columns]
    with outcome.stage("score"):
        values = values_of(judge.scores(estimate))
        return [record(about, method.name, own) for about, own in zip(columns, values, strict=True)]


def _example(truth: Truth, methods: Sequence[Method], part: str) -> dict[str, bytes]:
    """Content of the scene's file of example images, by file name."""
    # An estimate beyond single precision is kept as infinite.
    with tempfile.TemporaryDirectory() as folder, np.errstate(over="ignore"):
        write_example(Path(folder), truth, methods, part)
        return {path.name: path.read_bytes() for path in Path(folder).rglob("*.npz")}
