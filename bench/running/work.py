"""The work on one family of scenes: render, let every method reconstruct, score. Nothing is stored.

A task is small and holds parameters only; its result is a table. It may therefore be done in this
process or in any other. What renders and scores is imported where that is done.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, repeat
from threading import Lock
from typing import TYPE_CHECKING

from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.inside_worker import SCORING, import_all
from malus.bench.running.parts import Failure
from malus.bench.running.sharing import cpu_processes, on_a_card, shared, shared_later
from malus.bench.running.task_queue import TaskQueue
from malus.bench.running.worker_process import Died, WorkerProcess, retried
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.core.cores import usable_cores

if TYPE_CHECKING:
    from malus.bench.running.truths import RenderedApart

Engine = Callable[[Iterable[FamilyTask]], Iterator[tuple[FamilyTask, FamilyResult]]]
"""Does tasks in any order, and takes them from the iterable a few ahead at most."""


def in_this_process(variant: Variant) -> Engine:
    """Engine that does tasks in this process, one after the other."""

    def results_of(
        tasks: Iterable[FamilyTask],
    ) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        queue = TaskQueue(tasks)
        while (task := queue.next_of("this process")) is not None:
            yield task, work(task, variant, usable_cores(), ahead=True)

    return results_of


def in_worker_process(variant: Variant, worker: WorkerProcess) -> Engine:
    """Engine that does tasks in a worker process, and in one a core where that takes a while.

    A family that crashes its worker or takes too long is tried again, then recorded as failed. On a
    graphics card that one process renders, and one a core scores what it rendered.
    """
    work_of, card = partial(_in_worker, variant), on_a_card(variant)
    apart = partial(_Apart, variant) if card else None

    def load(worker: WorkerProcess, task: FamilyTask) -> None:
        worker.begin(import_all, *SCORING)
        if not card and task.renderer == "mitsuba":
            worker.begin(mitsuba, variant)

    return lambda tasks: shared_later(tasks, worker, cpu_processes(), work_of, load, apart)


def in_worker_processes(variant: Variant, workers: Sequence[WorkerProcess]) -> Engine:
    """Engine that shares tasks out among worker processes from the start."""
    return lambda tasks: shared(TaskQueue(tasks), workers, partial(_in_worker, variant))


def rendered_beside(
    variant: Variant, renderer: WorkerProcess, workers: Sequence[WorkerProcess]
) -> Engine:
    """Engine in which one process renders, and others score what it rendered.

    For a graphics card: it renders a family in milliseconds, which a core scores in a second.
    """
    work_of = _Apart(variant, renderer)
    return lambda tasks: shared(
        TaskQueue(tasks, one_renders=True), workers, work_of, beside=renderer
    )


class _Apart:
    """Scores of families in any of several processes, all rendered by the same other one."""

    def __init__(self, variant: Variant, renderer: WorkerProcess) -> None:
        self._variant, self._renderer, self._turn = variant, renderer, Lock()

    def __call__(
        self, worker: WorkerProcess, task: FamilyTask, threads: int
    ) -> Iterator[FamilyResult]:
        """Yield the result of a task, scored in `worker`."""
        if task.renderer != "mitsuba":
            yield from _in_worker(self._variant, worker, task, threads)
            return
        # What follows in one process is not what is rendered next: others wait for theirs.
        alone = replace(task, following=None)
        try:
            with self._turn:
                (rendered,) = retried(
                    lambda: self._renderer.stream(_rendered, alone, self._variant)
                )
            if not isinstance(rendered, FamilyResult):
                (rendered,) = retried(lambda: worker.stream(_scored, alone, rendered, threads))
        except Died as death:
            yield FamilyResult(failures=[Failure(None, None, str(death))])
            return
        yield rendered.tabled(task.renderer)


def _rendered(task: FamilyTask, variant: Variant) -> Iterator[RenderedApart | FamilyResult]:
    """Renders of a family; its scores where its truths need the renderer, or why there are none."""
    from malus.bench.running.scored_family import scored
    from malus.bench.running.truths import rendered_apart
    from malus.renderers.variant import use_threads

    use_threads(variant, usable_cores())
    result, rendered = FamilyResult(), None
    with result.guard():
        rendered = rendered_apart(task.family, variant, result)
    if rendered is None and not result.failures:
        result = scored(task, variant, usable_cores(), result=result)
    yield result if rendered is None else rendered


def _scored(task: FamilyTask, rendered: RenderedApart, threads: int) -> Iterator[FamilyResult]:
    from malus.bench.running.scored_family import scored_apart

    yield scored_apart(task, rendered, threads)


def _in_worker(
    variant: Variant, worker: WorkerProcess, task: FamilyTask, threads: int
) -> Iterator[FamilyResult]:
    result: FamilyResult
    try:
        # What is rendered ahead may be what kills a worker: the second time this task is alone.
        attempts = chain([task], repeat(replace(task, following=None)))
        (result,) = retried(lambda: worker.stream(_one_result, next(attempts), variant, threads))
    except Died as death:
        yield FamilyResult(failures=[Failure(None, None, str(death))])
        return
    yield result.tabled(task.renderer)


def _one_result(task: FamilyTask, variant: Variant, threads: int) -> Iterator[FamilyResult]:
    from malus.bench.running.scored_family import scored
    from malus.renderers.variant import use_threads

    if task.renderer == "mitsuba":
        use_threads(variant, threads)
    yield scored(task, variant, threads, ahead=True)


def work(task: FamilyTask, variant: Variant, threads: int = 1, ahead: bool = False) -> FamilyResult:
    """Render a family and score every method on each of its scenes; the result has a table.

    Parameters as those of `scored`.
    """
    from malus.bench.running.scored_family import scored

    return scored(task, variant, threads, ahead).tabled(task.renderer)
