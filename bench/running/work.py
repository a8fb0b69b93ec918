"""The work on one family of scenes: render, let every method reconstruct, score. Nothing is stored.

A task is small and holds parameters only; its result is a table. It may therefore be done in this
process or in any other. An exception costs the scene and the method that it came from.
"""

from __future__ import annotations

import errno
import os
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from threadpoolctl import threadpool_limits

from malus.bench.running.examples import write_example
from malus.bench.running.parts import Failure
from malus.bench.running.plan import FamilyPlan
from malus.bench.running.results import Record, describe, inapplicable, record, table_of
from malus.bench.running.worker_process import Died, WorkerProcess, retried
from malus.bench.scoring.extra_metrics import get_metrics
from malus.bench.scoring.judge import Judge, Metric
from malus.bench.scoring.knowledge_ladder import EVERYTHING, rungs
from malus.reconstruct import Inapplicable, Method, Observation, get_method
from malus.renderers.families.family import render_family
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant
from malus.scenes.scene import Scene


@dataclass(frozen=True)
class FamilyTask:
    """What shall be done for one family of scenes.

    Attributes
    ----------
    id : str
        Of the part of the run's results that the task makes.
    methods : dict of name to reference
        By the reference, such as `package.module:object`, another process finds the method.
    examples : frozenset of str
        Scenes whose images are kept for people to look at.
    ladder : bool
        Whether methods are scored on every rung of the ladder of knowledge.
    """

    id: str
    family: FamilyPlan
    renderer: str
    methods: dict[str, str]
    metrics: tuple[str, ...] = ()
    examples: frozenset[str] = frozenset()
    ladder: bool = False


@dataclass
class FamilyResult:
    """The outcome of a task.

    Attributes
    ----------
    table : DataFrame or None
        None where not a single row could be made.
    failures : list of Failure
    examples : dict of file name to content
        Compressed images of the few scenes that were asked for.
    seconds : dict of stage to seconds
    clock : function
        The clock that measures the seconds of a stage; by default that on the wall.
    """

    table: pd.DataFrame | None = None
    failures: list[Failure] = field(default_factory=list)
    examples: dict[str, bytes] = field(default_factory=dict)
    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    clock: Callable[[], float] = time.perf_counter

    def whole(self, methods: Iterable[str]) -> set[str]:
        """Those of `methods` that worked on every scene."""
        failed = {failure.method for failure in self.failures}
        return set() if None in failed else set(methods) - failed

    def worked(self, methods: Iterable[Method]) -> list[Method]:
        """Those of `methods` that have not failed so far."""
        failed = {failure.method for failure in self.failures}
        return [method for method in methods if method.name not in failed]

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the seconds of a stage."""
        started = self.clock()
        try:
            yield
        finally:
            self.seconds[name] += self.clock() - started

    @contextmanager
    def guard(self, scene: Scene | None = None, method: Method | None = None) -> Iterator[None]:
        """Record an exception and go on, unless it means that the run has to stop."""
        try:
            yield
        except Exception as error:
            _raise_what_stops(error)
            scene_id = scene.id if scene else None
            self.failures.append(Failure.of(error, scene_id, method.name if method else None))


_NO_ROOM = {errno.ENOSPC, errno.EDQUOT}


def _raise_what_stops(error: BaseException) -> None:
    """Raise a stop by the user, or a full disk, also where another exception wraps it."""
    cause: BaseException | None = error
    while cause is not None:
        full = isinstance(cause, OSError) and cause.errno in _NO_ROOM
        if full or not isinstance(cause, Exception):
            raise cause
        cause = cause.__cause__ or cause.__context__


Engine = Callable[[Iterable[FamilyTask]], Iterator[tuple[FamilyTask, FamilyResult]]]
"""Does tasks, in any order; takes the next from the iterable only when it is about to start it."""


def here(variant: Variant) -> Engine:
    """Engine that does one task after the other in this process."""

    def one_after_the_other(
        tasks: Iterable[FamilyTask],
    ) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        for task in tasks:
            yield task, work(task, variant, os.cpu_count() or 1)

    return one_after_the_other


def apart(variant: Variant, worker: WorkerProcess) -> Engine:
    """Engine that does one task after the other in a worker process.

    A family that crashes the worker or takes too long is tried again, then recorded as failed.
    """

    def one_after_the_other(
        tasks: Iterable[FamilyTask],
    ) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        for task in tasks:
            yield task, _in_worker(worker, task, variant)

    return one_after_the_other


def _in_worker(worker: WorkerProcess, task: FamilyTask, variant: Variant) -> FamilyResult:
    result: FamilyResult
    try:
        (result,) = retried(lambda: worker.stream(_one_result, task, variant))
    except Died as death:
        return FamilyResult(failures=[Failure(None, None, str(death))])
    return result


def _one_result(task: FamilyTask, variant: Variant) -> Iterator[FamilyResult]:
    yield work(task, variant, os.cpu_count() or 1)


def work(task: FamilyTask, variant: Variant, threads: int = 1) -> FamilyResult:
    """Render a family and score every method on each of its scenes.

    Scenes are shared out among `threads` where every method allows it. The seconds of a stage are
    then its part of the time that passed.
    """
    result = FamilyResult()
    methods = [get_method(reference) for reference in task.methods.values()]
    plan = ScoringPlan(methods, get_metrics(task.metrics), task.ladder)
    scene_results: list[SceneResult] = []
    with result.guard():
        stage, truth_of = _renderer(task.family, task.renderer, variant, result, False)

        together = threads if all(method.per_pixel for method in methods) else 1
        # Threads wait for each other in Python: the work of each is measured by its own clock.
        clock = time.perf_counter if together == 1 else time.thread_time

        def score_scene(scene: Scene) -> SceneResult:
            scene_result = SceneResult(scene, outcome=FamilyResult(clock=clock))
            scene_result.score(stage, truth_of, plan, scene.id in task.examples)
            return scene_result

        started = time.perf_counter()
        for scene_result in _in_threads(score_scene, task.family.scenes, together):
            scene_results.append(scene_result)
            result.failures += scene_result.outcome.failures
            result.examples |= scene_result.outcome.examples
        _add_seconds(result, scene_results, time.perf_counter() - started)
    records = [record for scene_result in scene_results for record in scene_result.records]
    if records:
        with result.stage("score"):
            result.table = _table(task, records, scene_results)
        result.table.attrs["render_seconds"] = sum(result.seconds[name] for name in RENDERING)
    return result


def _table(
    task: FamilyTask, records: Sequence[Record], scene_results: Sequence[SceneResult]
) -> pd.DataFrame:
    """Table of a family; its attributes tell the samples and the error of the interpolation."""
    table = table_of(records)
    table.insert(table.columns.get_loc("method"), "renderer", task.renderer)
    table.attrs["interpolation_rms"] = max(result.interpolation_rms for result in scene_results)
    samples = (result.samples for result in scene_results if result.samples)
    table.attrs["samples"] = next(samples, task.family.sampling.samples)
    return table


def _in_threads(
    score_scene: Callable[[Scene], SceneResult], scenes: Sequence[Scene], threads: int
) -> Iterator[SceneResult]:
    """Results of all scenes in their order, the same to the bit for any number of threads."""
    # Several BLAS threads add in an order that depends on who else computes.
    with threadpool_limits(1, "blas"):
        if threads == 1:
            yield from map(score_scene, scenes)
            return
        pool = ThreadPoolExecutor(threads)
        try:
            yield from pool.map(score_scene, scenes)
        finally:
            # After an error, or Ctrl-C, the scenes that have not begun are left.
            pool.shutdown(cancel_futures=True)


def _add_seconds(
    result: FamilyResult, scene_results: Sequence[SceneResult], elapsed: float
) -> None:
    """Share out the elapsed time among the stages, as all threads together spent theirs."""
    busy: defaultdict[str, float] = defaultdict(float)
    for scene_result in scene_results:
        for stage, seconds in scene_result.outcome.seconds.items():
            busy[stage] += seconds
    total = sum(busy.values())
    for stage, seconds in busy.items():
        result.seconds[stage] += elapsed * seconds / total


@dataclass(frozen=True)
class ScoringPlan:
    """How a scene is scored: methods, metrics, and whether on every rung of the ladder."""

    methods: Sequence[Method]
    metrics: Sequence[Metric] = ()
    ladder: bool = False


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
            with self.outcome.guard(self.scene), self.outcome.stage("write examples"):
                self.outcome.examples |= _example(truth, self.outcome.worked(plan.methods))

    def _score_methods(self, truth: Truth, plan: ScoringPlan) -> None:
        with self.outcome.stage("score"):
            judge, columns = Judge(truth), describe(truth.scene)
        with self.outcome.stage("reconstruct"):
            rungs_below = list(rungs(judge.pixels)) if plan.ladder else []
        for method in plan.methods:
            # Methods that need a picture have rungs of their own: blind, blind-light, …
            below = rungs_below if method.per_pixel else []
            with self.outcome.guard(self.scene, method):
                for rung in [(EVERYTHING, judge.pixels.observation), *below]:
                    self._score_rung(judge, method, plan.metrics, columns, rung)

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


def _example(truth: Truth, methods: Sequence[Method]) -> dict[str, bytes]:
    """Content of the scene's file of example images, by file name."""
    with tempfile.TemporaryDirectory() as folder:
        write_example(Path(folder), truth, methods)
        return {path.name: path.read_bytes() for path in Path(folder).rglob("*.npz")}


RENDERING = ("render", "interpolate in eta")
"""Stages that make the truths."""


def truths(
    family: FamilyPlan,
    scenes: Iterable[Scene],
    renderer: str,
    variant: Variant,
    result: FamilyResult,
    errors: bool = False,
) -> Iterator[tuple[Scene, Truth]]:
    """Truths of some scenes of a family; those that fail are recorded in `result` and left out.

    All of the family is rendered, because its nodes in η follow from all of its scenes. Standard
    errors cost time, and no score needs them: they are zero without `errors`.
    """
    stage, truth_of = _renderer(family, renderer, variant, result, errors)
    for scene in scenes:
        truth = None
        with result.guard(scene), result.stage(stage):
            truth = truth_of(scene)
        if truth is not None:
            yield scene, truth


def _renderer(
    family: FamilyPlan, renderer: str, variant: Variant, result: FamilyResult, errors: bool
) -> tuple[str, Callable[[Scene], Truth]]:
    """Function that makes the truth of a scene, and its stage; renders what all scenes share."""
    if renderer == "torrance-sparrow":
        return RENDERING[0], render_torrance_sparrow
    with result.stage(RENDERING[0]):
        rendered = render_family(family.scenes, family.sampling, variant, errors=errors)
    return RENDERING[1], partial(rendered.truth, standard_error=errors)
