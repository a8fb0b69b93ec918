"""The work on one family: render it, let every method reconstruct, score. Nothing is stored here.

A task is small and holds parameters only; what comes back is a table. It may therefore be done in
this process or in any other. An exception costs the scene and the method that it came from.
"""

from __future__ import annotations

import errno
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, cast

import pandas as pd

from malus.bench.child import ATTEMPTS, Child, Died
from malus.bench.examples import keep
from malus.bench.extra_metrics import get_metrics
from malus.bench.judge import Judge, Metric
from malus.bench.parts import Failure
from malus.bench.plan import FamilyPlan
from malus.bench.results import inapplicable_rows, score_rows, table_of
from malus.reconstruct import Inapplicable, Method, get_method
from malus.renderers.family import render_family
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant
from malus.scenes.scene import Scene

RENDERING = ("render", "interpolate in eta")
"""Stages that truths come from."""

_NO_ROOM = {errno.ENOSPC, errno.EDQUOT}


@dataclass(frozen=True)
class Task:
    """What shall be done for one family.

    Attributes
    ----------
    id : str
        Of the part that it makes.
    methods : dict of name to reference
        By the reference, such as `package.module:object`, another process finds the method.
    examples : frozenset of str
        Scenes whose images are kept for people to look at.
    """

    id: str
    family: FamilyPlan
    renderer: str
    methods: dict[str, str]
    metrics: tuple[str, ...] = ()
    examples: frozenset[str] = frozenset()


@dataclass
class Made:
    """What came of a task.

    Attributes
    ----------
    table : DataFrame or None
        None where not a single row could be made.
    failures : list of Failure
    examples : dict of file name to content
        Compressed images of the few scenes that were asked for.
    seconds : dict of stage to seconds
    """

    table: pd.DataFrame | None = None
    failures: list[Failure] = field(default_factory=list)
    examples: dict[str, bytes] = field(default_factory=dict)
    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))

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
        started = time.perf_counter()
        yield
        self.seconds[name] += time.perf_counter() - started

    @contextmanager
    def guard(self, scene: Scene | None = None, method: Method | None = None) -> Iterator[None]:
        """Record an exception and go on, unless it means that the run has to stop."""
        try:
            yield
        except Exception as error:
            _raise_what_stops(error)
            name = scene.id if scene else None
            self.failures.append(Failure.of(error, name, method.name if method else None))


Engine = Callable[[Iterable[Task]], Iterator[tuple[Task, Made]]]
"""Does tasks, in any order; takes the next from the iterable only when it is about to start it."""


def here(variant: Variant) -> Engine:
    """The engine that does one task after the other, in this process."""

    def one_after_the_other(tasks: Iterable[Task]) -> Iterator[tuple[Task, Made]]:
        for task in tasks:
            yield task, work(task, variant)

    return one_after_the_other


def apart(variant: Variant, child: Child) -> Engine:
    """The engine that does one task after the other in a process of its own.

    A family that crashes it or takes too long is tried `ATTEMPTS` times, then recorded as failed.
    """

    def one_after_the_other(tasks: Iterable[Task]) -> Iterator[tuple[Task, Made]]:
        for task in tasks:
            yield task, _attempted(child, task, variant)

    return one_after_the_other


def _attempted(child: Child, task: Task, variant: Variant) -> Made:
    reason = ""
    for _ in range(ATTEMPTS):
        try:
            (made,) = child.stream(_only, task, variant)
        except Died as death:
            reason = f"{death}, {ATTEMPTS} times"
        else:
            return cast(Made, made)
    return Made(failures=[Failure(None, None, reason)])


def _only(task: Task, variant: Variant) -> Iterator[Made]:
    yield work(task, variant)


def work(task: Task, variant: Variant) -> Made:
    """Render a family and score every method on each of its scenes."""
    made = Made()
    methods = [get_method(reference) for reference in task.methods.values()]
    metrics = get_metrics(task.metrics)
    records: list[dict[str, Any]] = []
    worst = 0.0
    with made.guard():
        for scene, truth in _truths(task, variant, made):
            with made.guard(scene), made.stage("reconstruct and score"):
                records += _rows(truth, methods, metrics, made)
            if scene.id in task.examples:
                with made.guard(scene), made.stage("write examples"):
                    made.examples |= _example(truth, made.worked(methods))
            worst = max(worst, truth.interpolation_error.get("rms", 0.0))
    if records:
        made.table = table_of(records)
        made.table.attrs["interpolation_rms"] = worst
        made.table.attrs["render_seconds"] = sum(made.seconds[name] for name in RENDERING)
    return made


def _truths(task: Task, variant: Variant, made: Made) -> Iterator[tuple[Scene, Truth]]:
    return truths(task.family, task.family.scenes, task.renderer, variant, made)


def truths(
    family: FamilyPlan,
    scenes: Iterable[Scene],
    renderer: str,
    variant: Variant,
    made: Made,
    errors: bool = False,
) -> Iterator[tuple[Scene, Truth]]:
    """Truths of some scenes of a family; those without one are recorded in `made` and left out.

    All of the family is rendered, because its nodes in η follow from all of its scenes. Standard
    errors cost time, and no score needs them: they are zero without `errors`.
    """
    stage, truth_of = RENDERING[0], _torrance_sparrow
    if renderer != "torrance-sparrow":
        with made.stage(stage):
            rendered = render_family(family.scenes, family.sampling, variant, errors=errors)
        stage, truth_of = RENDERING[1], partial(rendered.truth, standard_error=errors)
    for scene in scenes:
        truth = None
        with made.guard(scene), made.stage(stage):
            truth = truth_of(scene)
        if truth is not None:
            yield scene, truth


def _torrance_sparrow(scene: Scene) -> Truth:
    return render_torrance_sparrow(scene)


def _rows(
    truth: Truth, methods: Sequence[Method], metrics: Sequence[Metric], made: Made
) -> list[dict[str, Any]]:
    judge = Judge(truth)
    records: list[dict[str, Any]] = []
    for method in methods:
        with made.guard(truth.scene, method):
            try:
                records += score_rows(truth.scene, method.name, judge.score(method, metrics))
            except Inapplicable as reason:
                records += inapplicable_rows(truth.scene, method.name, str(reason))
    return records


def _example(truth: Truth, methods: Sequence[Method]) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        keep(Path(folder), truth, methods)
        return {path.name: path.read_bytes() for path in Path(folder).rglob("*.npz")}


def _raise_what_stops(error: BaseException) -> None:
    """Raise a stop by the user, or a full disk, also where another exception wraps it."""
    cause: BaseException | None = error
    while cause is not None:
        full = isinstance(cause, OSError) and cause.errno in _NO_ROOM
        if full or not isinstance(cause, Exception):
            raise cause
        cause = cause.__cause__ or cause.__context__
