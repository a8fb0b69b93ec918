"""The work on one family of scenes: render, let every method reconstruct, score. Nothing is stored.

A task is small and holds parameters only; its result is a table. It may therefore be done in this
process or in any other. What renders and scores is imported where that is done.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain, repeat

from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.parts import Failure
from malus.bench.running.worker_process import Died, WorkerProcess, retried
from malus.renderers.variant import Variant
from malus.scenes.core.cores import usable_cores

Engine = Callable[[Iterable[FamilyTask]], Iterator[tuple[FamilyTask, FamilyResult]]]
"""Does tasks in any order, and takes each from the iterable only when it is about to start it."""


def in_this_process(variant: Variant) -> Engine:
    """Engine that does tasks in this process, one after the other."""

    def results_of(
        tasks: Iterable[FamilyTask],
    ) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        for task in tasks:
            yield task, work(task, variant, usable_cores(), ahead=True)

    return results_of


def in_worker_process(variant: Variant, worker: WorkerProcess) -> Engine:
    """Engine that does tasks in a worker process, one after the other.

    A family that crashes the worker or takes too long is tried again, then recorded as failed.
    """

    def results_of(
        tasks: Iterable[FamilyTask],
    ) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        for task in tasks:
            yield task, _in_worker(worker, task, variant)

    return results_of


def _in_worker(worker: WorkerProcess, task: FamilyTask, variant: Variant) -> FamilyResult:
    result: FamilyResult
    try:
        # What is rendered ahead may be what kills a worker: the second time this task is alone.
        attempts = chain([task], repeat(replace(task, following=None)))
        (result,) = retried(lambda: worker.stream(_one_result, next(attempts), variant))
    except Died as death:
        return FamilyResult(failures=[Failure(None, None, str(death))])
    return result.tabled(task.renderer)


def _one_result(task: FamilyTask, variant: Variant) -> Iterator[FamilyResult]:
    from malus.bench.running.scored_family import scored

    yield scored(task, variant, usable_cores(), ahead=True)


def work(task: FamilyTask, variant: Variant, threads: int = 1, ahead: bool = False) -> FamilyResult:
    """Render a family and score every method on each of its scenes; the result has a table.

    Parameters as those of `scored`.
    """
    from malus.bench.running.scored_family import scored

    return scored(task, variant, threads, ahead).tabled(task.renderer)
