"""Tasks for a worker process, and for more of them where one would take a while."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from queue import Queue
from typing import Generic, TypeVar

from malus.bench.running.task_queue import Task, TaskQueue
from malus.bench.running.worker_process import WorkerProcess
from malus.renderers.variant import Variant
from malus.scenes.core.cores import free_card_memory, free_memory, usable_cores

MOST_PROCESSES = 8
"""Worker processes at once; each holds the renderer and the tables of its families."""

MEMORY = 1e9
"""Bytes that are free for each of them but the first; of rooms they take about as many."""

CARD_MEMORY = 4e9
"""Bytes of a graphics card that are free for each of them but the first, where they render on it. A
launch takes a few hundred megabytes, and a process as many before it begins."""

WORTH_SECONDS = 1.5
"""Work after the first task for which one process gets others beside it: they take as long to
start."""

POLL_SECONDS = 0.02
"""Time after which a process that loads is looked at again."""

WARMING_SECONDS = 10.0
"""The first task loads and compiles what all need, which takes no longer than this."""

_Item = TypeVar("_Item")

Work = Callable[[WorkerProcess, Task, int], Iterable[_Item]]
"""Does a task in a worker process, with so many threads."""


def processes(variant: Variant) -> int:
    """Worker processes that may render at once: one a core, fewer where there is little memory."""
    most = cpu_processes()
    if most > 1 and on_a_card(variant):
        return int(min(most, 1 + free_card_memory() // CARD_MEMORY))
    return most


def cpu_processes() -> int:
    """Worker processes at once that need no graphics card: one a core, fewer for little memory."""
    return int(min(usable_cores(), MOST_PROCESSES, 1 + free_memory() // MEMORY))


def on_a_card(variant: Variant) -> bool:
    """Whether a graphics card renders."""
    return variant.name.startswith("cuda")


def shared_later(
    tasks: Iterable[Task],
    worker: WorkerProcess,
    most: int,
    do: Work[Task, _Item],
    load: Callable[[WorkerProcess, Task], object],
    apart: Callable[[WorkerProcess], Work[Task, _Item]] | None = None,
) -> Iterator[tuple[Task, _Item]]:
    """Do tasks in one process, and where they take a while in `most` of them; yields as they come.

    One process hardly profits from several cores: what is Python in it has one. Where those
    in sight will take `WORTH_SECONDS` at the pace of the last, others start, and `load` what such a
    task needs; those that have take tasks, too. With `apart`, the first process is beside the
    others as soon as one of these has: `apart` of it is what they do.
    """
    queue, pace = TaskQueue(tasks, one_renders=apart is not None), _Pace()
    with ExitStack() as stack:
        more: list[WorkerProcess] = []
        while not more or not (apart is None or any(other.is_free() for other in more)):
            task = queue.next_of(worker)
            if task is None:
                return
            for item in do(worker, task, usable_cores()):
                yield task, item
            if most > 1 and not more and pace.seconds_with(queue) > WORTH_SECONDS:
                count = most - 1 if apart is None else most
                others = (WorkerProcess(worker.timeout) for _ in range(count))
                more = [stack.enter_context(other) for other in others]
                for other in more:
                    load(other, task)
        if apart is None:
            yield from shared(queue, [worker, *more], do)
        else:
            yield from shared(queue, more, apart(worker), beside=worker)


def shared(
    queue: TaskQueue[Task],
    workers: Sequence[WorkerProcess],
    do: Work[Task, _Item],
    beside: WorkerProcess | None = None,
) -> Iterator[tuple[Task, _Item]]:
    """Do tasks in several processes, each with its share of the cores; yields as they come.

    Where it is left before its end, what the processes do is ended, too, and the one `beside` them.
    """
    with ThreadPoolExecutor(len(workers)) as pool:  # each thread waits for one of them
        sharing = _Sharing(queue, do, pool, len(workers), beside)
        try:
            for worker in workers:
                sharing.admit(worker)
            while sharing.busy:
                task, items = sharing.next_items()
                for item in items:
                    assert task is not None
                    yield task, item
        finally:
            sharing.stop()


class _Pace:
    """How long tasks take that are done one after the other, from now on."""

    def __init__(self) -> None:
        self._warmed: float | None = None  # when the first was done
        self._last = time.monotonic()

    def seconds_with(self, queue: TaskQueue[Task]) -> float:
        """Seconds since the first task, and those that the tasks in sight will take; one is done.

        The first one tells nothing, unless it took longer than to load and compile takes.
        """
        now = time.monotonic()
        took, self._last = now - self._last, now
        if self._warmed is None:
            self._warmed = now
            took *= took > WARMING_SECONDS
        return now - self._warmed + took * queue.in_sight()


class _Sharing(Generic[Task, _Item]):
    """Who is busy, and what arrives of them."""

    def __init__(
        self,
        queue: TaskQueue[Task],
        do: Work[Task, _Item],
        pool: ThreadPoolExecutor,
        workers: int,
        beside: WorkerProcess | None,
    ) -> None:
        self._queue, self._do, self._pool, self._beside = queue, do, pool, beside
        self._threads = max(1, usable_cores() // workers)
        # No more wait than are made at once: they may be large.
        self._arrived: Queue[_Arrived[Task, _Item]] = Queue(workers)
        self.busy: set[WorkerProcess] = set()
        self._loading: set[WorkerProcess] = set()

    def admit(self, worker: WorkerProcess) -> None:
        """Give a process its first task, at once or when it has loaded what it was to begin."""
        if worker.is_free():
            self.hand_over(worker)
            return
        self._loading.add(worker)
        self._pool.submit(self._await, worker)

    def _await(self, worker: WorkerProcess) -> None:
        while not worker.is_free():
            time.sleep(POLL_SECONDS)
        self._arrived.put(_Arrived(worker, None, [], ended=True))

    def hand_over(self, worker: WorkerProcess) -> None:
        """Give a process its next task, where one is left."""
        self.busy.discard(worker)
        task = self._queue.next_of(worker)
        if task is not None:
            self._pool.submit(self._work, worker, task)
            self.busy.add(worker)  # only then: `stop` waits for what is busy

    def _work(self, worker: WorkerProcess, task: Task) -> None:
        last: list[_Item] = []
        raised = None
        try:
            for item in self._do(worker, task, self._threads):
                if last:
                    self._arrived.put(_Arrived(worker, task, last))
                last = [item]
        except BaseException as error:
            raised = error
        self._arrived.put(_Arrived(worker, task, last, ended=True, raised=raised))

    def next_items(self) -> tuple[Task | None, list[_Item]]:
        """What arrives next, nothing of a process that has loaded.

        Its process has its next task then, where it has ended this one.
        """
        arrived = self._arrived.get()
        if arrived.raised is not None:
            self.busy.discard(arrived.worker)
            raise arrived.raised
        if arrived.ended:
            self._loading.discard(arrived.worker)
            self.hand_over(arrived.worker)
        return arrived.task, arrived.items

    def stop(self) -> None:
        """End what is under way, and take what its threads wait to hand in."""
        for worker in self.busy | self._loading:
            worker.give_up()
        if self.busy and self._beside is not None:
            self._beside.give_up()
        while self.busy or self._loading:
            arrived = self._arrived.get()
            if arrived.ended:
                self.busy.discard(arrived.worker)
                self._loading.discard(arrived.worker)


@dataclass(frozen=True)
class _Arrived(Generic[Task, _Item]):
    """What came of a task, with its last item that it has ended, and what it raised.

    Of a process that has loaded what it was to begin there is no task.
    """

    worker: WorkerProcess
    task: Task | None
    items: list[_Item]
    ended: bool = False
    raised: BaseException | None = None
