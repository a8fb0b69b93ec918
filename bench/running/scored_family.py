"""Render a family of scenes, let every method reconstruct each, and score. Nothing is stored.

An exception costs the scene and the method that it came from.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

from threadpoolctl import threadpool_limits

from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.scene_scores import SceneResult, ScoringPlan, score_together
from malus.bench.running.truths import (
    RENDERING,
    RenderedApart,
    Renders,
    begin_ahead,
    renders_of,
)
from malus.bench.scoring.extra_metrics import get_metrics
from malus.bench.scoring.family_scores import groups
from malus.reconstruct import get_method
from malus.renderers.variant import Variant
from malus.scenes.scene import Scene


def scored(
    task: FamilyTask,
    variant: Variant,
    threads: int = 1,
    ahead: bool = False,
    result: FamilyResult | None = None,
) -> FamilyResult:
    """Render a family and score every method on each of its scenes; the result has records.

    Scenes are shared out among `threads` where every method allows it. The seconds of a stage are
    then its part of the time that passed. With `ahead`, the kernels of the family that follows run
    meanwhile. A `result` that is given has the seconds of what was done before.
    """
    result, plan, renders = result or FamilyResult(), _plan_of(task), None
    with result.guard():
        renders = renders_of(task.family, task.renderer, variant, result, False)
        if ahead and task.following is not None:
            begin_ahead(task.following, task.renderer, variant, False)
    return result if renders is None else _with_scores(result, task, plan, renders, threads)


def scored_apart(task: FamilyTask, rendered: RenderedApart, threads: int = 1) -> FamilyResult:
    """Score every method on a family that another process rendered; otherwise as `scored`."""
    result = FamilyResult(seconds=rendered.seconds)
    return _with_scores(result, task, _plan_of(task), rendered.renders(task.family), threads)


def _plan_of(task: FamilyTask) -> ScoringPlan:
    methods = [get_method(reference) for reference in task.methods.values()]
    return ScoringPlan(methods, get_metrics(task.metrics), task.ladder, task.id)


def _with_scores(
    result: FamilyResult, task: FamilyTask, plan: ScoringPlan, renders: Renders, threads: int
) -> FamilyResult:
    """Add the scores of every method on each scene, and what failed; returns the result."""
    together = threads if all(method.per_pixel for method in plan.methods) else 1
    # Threads wait for each other in Python: the work of each is measured by its own clock.
    clock = time.perf_counter if together == 1 else time.thread_time

    def score_group(scenes: tuple[Scene, ...]) -> list[SceneResult]:
        results = [SceneResult(scene, outcome=FamilyResult(clock=clock)) for scene in scenes]
        if not score_together(results, renders, plan, task.examples):
            for scene_result in results:
                keep_example = scene_result.scene.id in task.examples
                scene_result.score(renders.stage, renders.truth_of, plan, keep_example)
        return results

    scene_results: list[SceneResult] = []
    with result.guard():
        started = time.perf_counter()
        for results in _in_threads(score_group, list(groups(task.family.scenes)), together):
            for scene_result in results:
                scene_results.append(scene_result)
                result.failures += scene_result.outcome.failures
                result.examples |= scene_result.outcome.examples
        _add_seconds(result, scene_results, time.perf_counter() - started)
    result.records = [record for scene_result in scene_results for record in scene_result.records]
    if result.records:
        samples = (scene_result.samples for scene_result in scene_results if scene_result.samples)
        result.attributes = {
            "interpolation_rms": max(one.interpolation_rms for one in scene_results),
            "samples": next(samples, task.family.sampling.samples),
            "render_seconds": sum(result.seconds[name] for name in RENDERING),
        }
    return result


def _in_threads(
    score_group: Callable[[tuple[Scene, ...]], list[SceneResult]],
    scenes: Sequence[tuple[Scene, ...]],
    threads: int,
) -> Iterator[list[SceneResult]]:
    """Results of all groups in their order, the same to the bit for any number of threads."""
    # Several BLAS threads add in an order that depends on who else computes.
    with threadpool_limits(1, "blas"):
        if threads == 1:
            yield from map(score_group, scenes)
            return
        pool = ThreadPoolExecutor(threads)
        try:
            yield from pool.map(score_group, scenes)
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
