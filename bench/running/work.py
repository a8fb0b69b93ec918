"""The work on one family: render it, let every method reconstruct, score. Nothing is stored here.

A task is small and holds parameters only; what comes back is a table. It may therefore be done in
this process or in any other. An exception costs the scene and the method that it came from.
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
from typing import Any, cast

import pandas as pd
from threadpoolctl import threadpool_limits

from malus.bench.running.examples import keep
from malus.bench.running.parts import Failure
from malus.bench.running.plan import FamilyPlan
from malus.bench.running.results import Record, describe, inapplicable, record, table_of
from malus.bench.running.worker_process import ATTEMPTS, Died, WorkerProcess
from malus.bench.scoring.extra_metrics import get_metrics
from malus.bench.scoring.judge import Judge, Metric
from malus.bench.scoring.knowledge_ladder import EVERYTHING, rungs
from malus.reconstruct import Inapplicable, Method, Observation, get_method
from malus.renderers.families.family import render_family
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant
from malus.scenes.scene import Scene

_NO_ROOM = {errno.ENOSPC, errno.EDQUOT}


@dataclass(frozen=True)
class FamilyTask:
    """What shall be done for one family.

    Attributes
    ----------
    id : str
        Of the part that it makes.
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
    """What came of a task.

    Attributes
    ----------
    table : DataFrame or None
        None where not a single row could be made.
    failures : list of Failure
    examples : dict of file name to content
        Compressed images of the few scenes that were asked for.
    seconds : dict of stage to seconds
    clock : function
        What tells the seconds of a stage: by default the clock on the wall.
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
            name = scene.id if scene else None
            self.failures.append(Failure.of(error, name, method.name if method else None))


def _raise_what_stops(error: BaseException) -> None:
    """Raise a stop by the user, or a full disk, also where another exception wraps it."""
    cause: BaseException | None = error
    while cause is not None:
        full = isinstance(cause, OSError) and cause.errno in _NO_ROOM
        if full or not isinstance(cause, Exception):
            raise cause
        cause = cause.__cause__ or cause.__context__


@dataclass(frozen=True)
class ScoringPlan:
    """How a scene is scored: methods, metrics, and whether on every rung of the ladder."""

    methods: Sequence[Method]
    metrics: Sequence[Metric] = ()
    ladder: bool = False


@dataclass
class SceneResult:
    """What came of one scene of a task."""

    scene: Scene
    records: list[Record] = field(default_factory=list)
    made: FamilyResult = field(default_factory=FamilyResult)
    interpolation_rms: float = 0.0
    samples: int | None = None

    def do(
        self, stage: str, truth_of: Callable[[Scene], Truth], exam: ScoringPlan, keep_example: bool
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

    def _examine(self, truth: Truth, exam: ScoringPlan) -> None:
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


RENDERING = ("render", "interpolate in eta")
"""Stages that truths come from."""

Engine = Callable[[Iterable[FamilyTask]], Iterator[tuple[FamilyTask, FamilyResult]]]
"""Does tasks, in any order; takes the next from the iterable only when it is about to start it."""


def here(variant: Variant) -> Engine:
    """The engine that does one task after the other, in this process."""

    def one_after_the_other(
        tasks: Iterable[FamilyTask],
    ) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        for task in tasks:
            yield task, work(task, variant, os.cpu_count() or 1)

    return one_after_the_other


def apart(variant: Variant, child: WorkerProcess) -> Engine:
    """The engine that does one task after the other in a process of its own.

    A family that crashes it or takes too long is tried `ATTEMPTS` times, then recorded as failed.
    """

    def one_after_the_other(
        tasks: Iterable[FamilyTask],
    ) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        for task in tasks:
            yield task, _attempted(child, task, variant)

    return one_after_the_other


def _attempted(child: WorkerProcess, task: FamilyTask, variant: Variant) -> FamilyResult:
    reason = ""
    for _ in range(ATTEMPTS):
        try:
            (made,) = child.stream(_only, task, variant)
        except Died as death:
            reason = f"{death}, {ATTEMPTS} times"
        else:
            return cast(FamilyResult, made)
    return FamilyResult(failures=[Failure(None, None, reason)])


def _only(task: FamilyTask, variant: Variant) -> Iterator[FamilyResult]:
    yield work(task, variant, os.cpu_count() or 1)


def work(task: FamilyTask, variant: Variant, threads: int = 1) -> FamilyResult:
    """Render a family and score every method on each of its scenes.

    Scenes are shared out among `threads` where every method allows it. The seconds of a stage are
    then its part of the time that passed.
    """
    made = FamilyResult()
    methods = [get_method(reference) for reference in task.methods.values()]
    exam = ScoringPlan(methods, get_metrics(task.metrics), task.ladder)
    shares: list[SceneResult] = []
    with made.guard():
        stage, truth_of = _renderer(task.family, task.renderer, variant, made, False)

        together = threads if all(method.per_pixel for method in methods) else 1
        # Threads wait for each other in Python: what each of them does is told by its own clock.
        clock = time.perf_counter if together == 1 else time.thread_time

        def one(scene: Scene) -> SceneResult:
            share = SceneResult(scene, made=FamilyResult(clock=clock))
            share.do(stage, truth_of, exam, scene.id in task.examples)
            return share

        started = time.perf_counter()
        for share in _each(one, task.family.scenes, together):
            shares.append(share)
            made.failures += share.made.failures
            made.examples |= share.made.examples
        _add_seconds(made, shares, time.perf_counter() - started)
    records = [record for share in shares for record in share.records]
    if records:
        with made.stage("score"):
            made.table = table_of(records)
            made.table.insert(made.table.columns.get_loc("method"), "renderer", task.renderer)
        made.table.attrs["interpolation_rms"] = max(share.interpolation_rms for share in shares)
        told = (share.samples for share in shares if share.samples)
        made.table.attrs["samples"] = next(told, task.family.sampling.samples)
        made.table.attrs["render_seconds"] = sum(made.seconds[name] for name in RENDERING)
    return made


def _each(
    one: Callable[[Scene], SceneResult], scenes: Sequence[Scene], threads: int
) -> Iterator[SceneResult]:
    """The shares of all scenes in their order, the same to the bit however many threads."""
    # Several BLAS threads add in an order that depends on who else computes.
    with threadpool_limits(1, "blas"):
        if threads == 1:
            yield from map(one, scenes)
            return
        pool = ThreadPoolExecutor(threads)
        try:
            yield from pool.map(one, scenes)
        finally:
            # After an error, or Ctrl-C, the scenes that have not begun are left.
            pool.shutdown(cancel_futures=True)


def _add_seconds(made: FamilyResult, shares: Sequence[SceneResult], passed: float) -> None:
    """Share out the time that passed as the stages were busy in all threads together."""
    busy: defaultdict[str, float] = defaultdict(float)
    for share in shares:
        for stage, seconds in share.made.seconds.items():
            busy[stage] += seconds
    whole = sum(busy.values())
    for stage, seconds in busy.items():
        made.seconds[stage] += passed * seconds / whole


def truths(
    family: FamilyPlan,
    scenes: Iterable[Scene],
    renderer: str,
    variant: Variant,
    made: FamilyResult,
    errors: bool = False,
) -> Iterator[tuple[Scene, Truth]]:
    """Truths of some scenes of a family; those without one are recorded in `made` and left out.

    All of the family is rendered, because its nodes in η follow from all of its scenes. Standard
    errors cost time, and no score needs them: they are zero without `errors`.
    """
    stage, truth_of = _renderer(family, renderer, variant, made, errors)
    for scene in scenes:
        truth = None
        with made.guard(scene), made.stage(stage):
            truth = truth_of(scene)
        if truth is not None:
            yield scene, truth


def _renderer(
    family: FamilyPlan, renderer: str, variant: Variant, made: FamilyResult, errors: bool
) -> tuple[str, Callable[[Scene], Truth]]:
    """What makes the truth of one scene, and the name of that stage; renders what all share."""
    if renderer == "torrance-sparrow":
        return RENDERING[0], render_torrance_sparrow
    with made.stage(RENDERING[0]):
        rendered = render_family(family.scenes, family.sampling, variant, errors=errors)
    return RENDERING[1], partial(rendered.truth, standard_error=errors)
