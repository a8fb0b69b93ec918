"""The work on one family of scenes: render, let every method reconstruct, score. Nothing is stored.

A task is small and holds parameters only; its result is a table. It may therefore be done in this
process or in any other. What renders and scores is imported where that is done.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import replace
from itertools import chain, repeat

from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.parts import Failure
from malus.bench.running.task_queue import TaskQueue
from malus.bench.running.worker_process import Died, WorkerProcess, retried
from malus.renderers.variant import Variant
from malus.scenes.core.cores import usable_cores

Engine = Callable[[Iterable[FamilyTask]], Iterator[tuple[FamilyTask, FamilyResult]]]
"""Does tasks in any order, and takes them from the iterable a few ahead at most."""

MOST_PROCESSES = 8
"""Worker processes of one run; each holds the renderer and the tables of its families."""

ALONE_SECONDS = 1.5
"""Time after its first family in which one process works alone: what is done by then would have
waited for others to start, which takes as long."""


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
    """Engine that does tasks in a worker process, and in more of them where that takes a while.

    One process hardly profits from several cores: what is Python in it has one. Where it has worked
    for `ALONE_SECONDS`, a process a core does.

    A family that crashes its worker or takes too long is tried again, then recorded as failed.
    """

    def results_of(
        tasks: Iterable[FamilyTask],
    ) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        queue, began, processes = TaskQueue(tasks), None, _processes(variant)
        while processes == 1 or began is None or time.monotonic() - began < ALONE_SECONDS:
            task = queue.next_of(worker)
            if task is None:
                return
            yield task, _in_worker(worker, task, variant, usable_cores())
            began = began or time.monotonic()
        with ExitStack() as stack:
            more = [WorkerProcess(worker.timeout) for _ in range(processes - 1)]
            yield from _shared(queue, variant, [worker, *map(stack.enter_context, more)])

    return results_of


def in_worker_processes(variant: Variant, workers: Sequence[WorkerProcess]) -> Engine:
    """Engine that shares tasks out among worker processes from the start."""
    return lambda tasks: _shared(TaskQueue(tasks), variant, workers)


def _processes(variant: Variant) -> int:
    """Worker processes that a run may have: one a core, and one for a graphics card."""
    return 1 if variant.name.startswith("cuda") else min(usable_cores(), MOST_PROCESSES)


def _shared(
    queue: TaskQueue, variant: Variant, workers: Sequence[WorkerProcess]
) -> Iterator[tuple[FamilyTask, FamilyResult]]:
    """Do tasks in several worker processes, each with its share of the cores."""
    threads = max(1, usable_cores() // len(workers))
    pool = ThreadPoolExecutor(len(workers))  # each thread waits for one of them
    running: dict[Future[FamilyResult], tuple[WorkerProcess, FamilyTask]] = {}

    def hand_over(worker: WorkerProcess) -> None:
        task = queue.next_of(worker)
        if task is not None:
            running[pool.submit(_in_worker, worker, task, variant, threads)] = worker, task

    try:
        for worker in workers:
            hand_over(worker)
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                worker, task = running.pop(future)
                hand_over(worker)  # before its result is stored
                yield task, future.result()
    finally:
        for worker, _ in running.values():
            worker.give_up()
        pool.shutdown()


def _in_worker(
    worker: WorkerProcess, task: FamilyTask, variant: Variant, threads: int
) -> FamilyResult:
    result: FamilyResult
    try:
        # What is rendered ahead may be what kills a worker: the second time this task is alone.
        attempts = chain([task], repeat(replace(task, following=None)))
        (result,) = retried(lambda: worker.stream(_one_result, next(attempts), variant, threads))
    except Died as death:
        return FamilyResult(failures=[Failure(None, None, str(death))])
    return result.tabled(task.renderer)


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
