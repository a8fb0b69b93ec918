"""The share of one scene in the work on its family: its truth, and every method's score."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from malus.bench.running.examples import keep
from malus.bench.running.results import Record, describe, inapplicable, record
from malus.bench.running.task import Made
from malus.bench.scoring.judge import Judge, Metric
from malus.bench.scoring.knowledge_ladder import EVERYTHING, rungs
from malus.reconstruct import Inapplicable, Method, Observation
from malus.renderers.truth import Truth
from malus.scenes.scene import Scene


@dataclass(frozen=True)
class Exam:
    """How a scene is scored: methods, metrics, and whether on every rung of the ladder."""

    methods: Sequence[Method]
    metrics: Sequence[Metric] = ()
    ladder: bool = False


@dataclass
class Share:
    """What came of one scene of a task."""

    scene: Scene
    records: list[Record] = field(default_factory=list)
    made: Made = field(default_factory=Made)
    interpolation_rms: float = 0.0
    samples: int | None = None

    def do(
        self, stage: str, truth_of: Callable[[Scene], Truth], exam: Exam, keep_example: bool
    ) -> None:
        """Make the truth, score every method on it, and keep its images if they are wanted."""
        truth = None
        with self.made.guard(self.scene), self.made.stage(stage):
            truth = truth_of(self.scene)
        if truth is None:
            return
        self.samples = truth.samples
        self.interpolation_rms = truth.interpolation_error.get("rms", 0.0)
        with self.made.guard(self.scene):
            self._examine(truth, exam)
        if keep_example:
            with self.made.guard(self.scene), self.made.stage("write examples"):
                self.made.examples |= _example(truth, self.made.worked(exam.methods))

    def _examine(self, truth: Truth, exam: Exam) -> None:
        with self.made.stage("score"):
            judge, about = Judge(truth), describe(truth.scene)
        with self.made.stage("reconstruct"):
            told = list(rungs(judge.sight)) if exam.ladder else []
        for method in exam.methods:
            # Methods that need a picture have knowledge of their own: blind, blind-light, …
            below = told if method.per_pixel else []
            with self.made.guard(self.scene, method):
                for knowledge, known in [(EVERYTHING, judge.sight.known), *below]:
                    self._score(judge, method, exam.metrics, (about, knowledge, known))

    def _score(
        self,
        judge: Judge,
        method: Method,
        metrics: Sequence[Metric],
        rung: tuple[dict[str, Any], str, Observation | Inapplicable],
    ) -> None:
        about, knowledge, known = rung
        try:
            if isinstance(known, Inapplicable):
                raise known
            with self.made.stage("reconstruct"):
                estimate = judge.sight.estimate(method, known)
            with self.made.stage("score"):
                values = judge.score_estimate(estimate, metrics).values()
                self.records.append(record(about, method.name, values, knowledge=knowledge))
        except Inapplicable as reason:
            self.records.append(inapplicable(about, method.name, str(reason), knowledge))


def _example(truth: Truth, methods: Sequence[Method]) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        keep(Path(folder), truth, methods)
        return {path.name: path.read_bytes() for path in Path(folder).rglob("*.npz")}
