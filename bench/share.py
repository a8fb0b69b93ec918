"""The share of one scene in the work on its family: its truth, and every method's score."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from malus.bench.examples import keep
from malus.bench.judge import Judge, Metric
from malus.bench.results import Record, describe, inapplicable, record
from malus.bench.task import Made
from malus.reconstruct import Inapplicable, Method
from malus.renderers.truth import Truth
from malus.scenes.scene import Scene


@dataclass
class Share:
    """What came of one scene of a task."""

    scene: Scene
    records: list[Record] = field(default_factory=list)
    made: Made = field(default_factory=Made)
    interpolation_rms: float = 0.0

    def do(
        self,
        stage: str,
        truth_of: Callable[[Scene], Truth],
        methods: Sequence[Method],
        metrics: Sequence[Metric],
        keep_example: bool,
    ) -> None:
        """Make the truth, score every method on it, and keep its images if they are wanted."""
        truth = None
        with self.made.guard(self.scene), self.made.stage(stage):
            truth = truth_of(self.scene)
        if truth is None:
            return
        self.interpolation_rms = truth.interpolation_error.get("rms", 0.0)
        with self.made.guard(self.scene):
            self.records += _records(truth, methods, metrics, self.made)
        if keep_example:
            with self.made.guard(self.scene), self.made.stage("write examples"):
                self.made.examples |= _example(truth, self.made.worked(methods))


def _records(
    truth: Truth, methods: Sequence[Method], metrics: Sequence[Metric], made: Made
) -> list[Record]:
    with made.stage("score"):
        judge, about = Judge(truth), describe(truth.scene)
    records: list[Record] = []
    for method in methods:
        with made.guard(truth.scene, method):
            try:
                with made.stage("reconstruct"):
                    estimate = judge.sight.estimate(method)
                with made.stage("score"):
                    score = judge.score_estimate(estimate, metrics)
                    records.append(record(about, method.name, score.values()))
            except Inapplicable as reason:
                records.append(inapplicable(about, method.name, str(reason)))
    return records


def _example(truth: Truth, methods: Sequence[Method]) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        keep(Path(folder), truth, methods)
        return {path.name: path.read_bytes() for path in Path(folder).rglob("*.npz")}
