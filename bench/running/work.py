"""The work on one family: render it, let every method reconstruct, score. Nothing is stored here.

A task is small and holds parameters only; what comes back is a table. It may therefore be done in
this process or in any other. An exception costs the scene and the method that it came from.
"""

from __future__ import annotations

import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import cast

from threadpoolctl import threadpool_limits

from malus.bench.running.parts import Failure
from malus.bench.running.plan import FamilyPlan
from malus.bench.running.results import table_of
from malus.bench.running.share import Exam, Share
from malus.bench.running.task import Made, Task
from malus.bench.running.worker_process import ATTEMPTS, Child, Died
from malus.bench.scoring.extra_metrics import get_metrics
from malus.reconstruct import get_method
from malus.renderers.families.family import render_family
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant
from malus.scenes.scene import Scene

RENDERING = ("render", "interpolate in eta")
"""Stages that truths come from."""

Engine = Callable[[Iterable[Task]], Iterator[tuple[Task, Made]]]
"""Does tasks, in any order; takes the next from the iterable only when it is about to start it."""


def here(variant: Variant) -> Engine:
    """The engine that does one task after the other, in this process."""

    def one_after_the_other(tasks: Iterable[Task]) -> Iterator[tuple[Task, Made]]:
        for task in tasks:
            yield task, work(task, variant, os.cpu_count() or 1)

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
    yield work(task, variant, os.cpu_count() or 1)


def work(task: Task, variant: Variant, threads: int = 1) -> Made:
    """Render a family and score every method on each of its scenes.

    Scenes are shared out among `threads` where every method allows it. The seconds of a stage are
    then its part of the time that passed.
    """
    made = Made()
    methods = [get_method(reference) for reference in task.methods.values()]
    exam = Exam(methods, get_metrics(task.metrics), task.ladder)
    shares: list[Share] = []
    with made.guard():
        stage, truth_of = _renderer(task.family, task.renderer, variant, made, False)

        together = threads if all(method.per_pixel for method in methods) else 1
        # Threads wait for each other in Python: what each of them does is told by its own clock.
        clock = time.perf_counter if together == 1 else time.thread_time

        def one(scene: Scene) -> Share:
            share = Share(scene, made=Made(clock=clock))
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


def _each(one: Callable[[Scene], Share], scenes: Sequence[Scene], threads: int) -> Iterator[Share]:
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


def _add_seconds(made: Made, shares: Sequence[Share], passed: float) -> None:
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
    made: Made,
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
    family: FamilyPlan, renderer: str, variant: Variant, made: Made, errors: bool
) -> tuple[str, Callable[[Scene], Truth]]:
    """What makes the truth of one scene, and the name of that stage; renders what all share."""
    if renderer == "torrance-sparrow":
        return RENDERING[0], render_torrance_sparrow
    with made.stage(RENDERING[0]):
        rendered = render_family(family.scenes, family.sampling, variant, errors=errors)
    return RENDERING[1], partial(rendered.truth, standard_error=errors)
