"""When further processes start, when they get tasks, and what they load. No time is judged here."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest
from runs import SUITE

from malus.bench.running import sharing
from malus.bench.running.plan import FamilyPlan, plan
from malus.bench.running.sharing import _Pace, shared_later
from malus.bench.running.task_queue import AHEAD, TaskQueue
from malus.bench.running.worker_process import Died, WorkerProcess


@dataclass(frozen=True)
class Task:
    number: int
    family: FamilyPlan
    following: FamilyPlan | None = None


FAMILY = plan(SUITE)[0]


def some(count: int) -> Iterator[Task]:
    return (Task(number, FAMILY) for number in range(count))


def test_a_queue_tells_how_many_tasks_are_in_sight() -> None:
    queue: TaskQueue[Task] = TaskQueue(some(AHEAD + 9))
    assert queue.in_sight() == AHEAD
    queue.next_of("one")
    assert queue.in_sight() == AHEAD + 1  # and the one that is kept for it
    few: TaskQueue[Task] = TaskQueue(some(3))
    few.next_of("one")
    assert few.in_sight() == 2


@pytest.mark.parametrize(
    ("took", "tells"),
    [
        ([1.0, 0.25], [0.0, 0.25 + 4 * 0.25]),  # the first loads and compiles
        ([1.0, 0.25, 0.5], [0.0, 0.25 + 4 * 0.25, 0.75 + 4 * 0.5]),
        ([60.0], [4 * 60.0]),  # longer than that takes
    ],
)
def test_the_pace_of_the_last_task_tells_what_is_left(
    took: list[float], tells: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(sharing, "time", SimpleNamespace(monotonic=lambda: clock.now))
    pace, queue = _Pace(), SimpleNamespace(in_sight=lambda: 4)
    for seconds, expected in zip(took, tells, strict=True):
        clock.now += seconds
        assert pace.seconds_with(queue) == pytest.approx(expected)  # type: ignore[arg-type]


class Loading(WorkerProcess):
    """A process that is said to load for a while; no real one is started."""

    made: list[Loading]
    loads_for: int

    def __init__(self, timeout: float = 60.0) -> None:
        super().__init__(timeout)
        self.asked = self.loaded = 0
        Loading.made.append(self)

    def is_free(self) -> bool:
        self.asked += 1
        return not self.loaded or self.asked > Loading.loads_for or self._given_up


def does(worker: WorkerProcess, task: Task, threads: int) -> Iterable[tuple[Any, int]]:
    if getattr(worker, "loaded", 0):
        assert worker.asked > Loading.loads_for  # type: ignore[attr-defined]
    time.sleep(0.01)
    yield worker, threads


def loads(worker: WorkerProcess, task: Task) -> None:
    assert isinstance(task, Task)
    worker.loaded = 1  # type: ignore[attr-defined]


@pytest.mark.parametrize("count", [1, 2, 3, 17, 60])
@pytest.mark.parametrize("is_apart", [False, True])
@pytest.mark.parametrize("loads_for", [0, 5, 10**9])
def test_others_get_tasks_when_they_have_loaded(
    count: int, is_apart: bool, loads_for: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every task is done once, also where the others never get ready."""
    Loading.made, Loading.loads_for = [], loads_for
    monkeypatch.setattr(sharing, "WorkerProcess", Loading)
    monkeypatch.setattr(sharing, "WORTH_SECONDS", 0.0)
    monkeypatch.setattr(sharing, "WARMING_SECONDS", 0.0)
    monkeypatch.setattr(sharing, "POLL_SECONDS", 0.001)
    first = WorkerProcess(60)
    apart = (lambda renderer: does) if is_apart else None
    done = list(shared_later(some(count), first, 3, does, loads, apart))
    assert sorted(task.number for task, _ in done) == list(range(count))
    by_others = [worker for _, (worker, _) in done if worker is not first]
    assert len(Loading.made) == (0 if count == 1 else 3 if is_apart else 2)
    if loads_for == 10**9:
        assert not by_others
    elif count == 60:
        assert by_others


def never(*_: object) -> None:
    time.sleep(600)


def own_pid() -> Iterator[int]:
    yield os.getpid()


def has_json(*_: object) -> Iterator[bool]:
    yield "xmlrpc.client" in sys.modules


def imports() -> None:
    import xmlrpc.client  # noqa: F401 - what nothing else loads


def test_a_process_is_free_when_it_has_loaded() -> None:
    with WorkerProcess(60) as none, WorkerProcess(60) as busy, WorkerProcess(60) as soon:
        assert none.is_free()  # it is started with its task
        busy.begin(never)
        soon.begin(imports)
        while not soon.is_free():
            time.sleep(0.02)
        assert not busy.is_free()
        busy.give_up()
        while not busy.is_free():
            time.sleep(0.02)
        with pytest.raises(Died, match="given up"):
            list(busy.stream(own_pid))


def test_a_process_that_takes_the_place_of_a_dead_one_loads_again() -> None:
    """Before its first task, whose time that does not cost."""
    with WorkerProcess(60) as worker:
        worker.begin(imports)
        (pid,) = worker.stream(own_pid)
        os.kill(pid, signal.SIGKILL)
        with pytest.raises(Died):
            list(worker.stream(own_pid))
        assert list(worker.stream(has_json)) == [True]


def kills_itself() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_death_while_it_loads_is_not_the_next_task_s() -> None:
    with WorkerProcess(60) as worker:
        worker.begin(kills_itself)
        while not worker.is_free():
            time.sleep(0.02)
        assert len(list(worker.stream(own_pid))) == 1  # what killed it is not begun again
