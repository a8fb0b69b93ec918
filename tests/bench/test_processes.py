"""Families shared out among worker processes: each once, the same results, and no process left."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pandas as pd
import pytest
from runs import NOBODY, SUITE, share_at_once

from malus.bench.running import sharing, work
from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.inside_worker import serve
from malus.bench.running.plan import plan
from malus.bench.running.runner import run
from malus.bench.running.task_queue import TaskQueue
from malus.bench.running.work import in_this_process, in_worker_process, in_worker_processes
from malus.bench.running.worker_process import Died, WorkerProcess
from malus.renderers.variant import Variant
from malus.scenes.core.cores import free_card_memory, free_memory
from malus.scenes.suite import Suite

MANY = Suite.parse(
    SUITE.model_dump(mode="json") | {"surfaces": [{"alpha": 0.1 + 0.05 * k} for k in range(7)]},
    "tests",
)
"""Seven families of two scenes."""

CARD = Variant("cuda_ad_mono_polarized", "a card")


def tasks() -> list[FamilyTask]:
    return [FamilyTask(family.id, family, "torrance-sparrow", {}) for family in plan(MANY)]


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_every_task_is_given_once_and_who_gets_it_was_told(workers: int) -> None:
    queue, told, given, expected = TaskQueue(tasks()), {}, [], 0
    while True:
        worker = len(given) % workers
        task = queue.next_of(worker)
        if task is None:
            break
        expected += worker in told
        assert told.pop(worker, task.family) == task.family
        if task.following is not None:
            told[worker] = task.following
        given.append(task.id)
    assert sorted(given) == sorted(task.id for task in tasks())
    assert not told
    assert expected == len(given) - workers  # all but the first of each
    if workers == 1:
        assert given == [task.id for task in tasks()]


def test_what_a_slow_worker_would_get_next_is_left_to_others() -> None:
    queue = TaskQueue(tasks())
    slow = queue.next_of("slow")
    others = list(iter(lambda: queue.next_of("fast"), None))
    assert slow is not None
    assert {slow.id, *(task.id for task in others)} == {task.id for task in tasks()}
    assert queue.next_of("slow") is None


def loaded(
    shapes: list[str], workers: int, one_renders: bool = False
) -> list[tuple[int, str, float]]:
    """Worker, shape and roughness of every task, where workers take turns."""
    content = SUITE.model_dump(mode="json") | {
        "shapes": [{"kind": kind} for kind in shapes],
        "surfaces": [{"alpha": 0.1 * k} for k in range(1, 5)],
        "lights": [{"kind": "distant", "incidence_deg": angle} for angle in (10, 30, 50)],
    }
    families = plan(Suite.parse(content, "tests"))
    queue = TaskQueue((FamilyTask(one.id, one, "mitsuba", {}) for one in families), one_renders)
    done = []
    while (task := queue.next_of(len(done) % workers)) is not None:
        scene = task.family.scenes[0]
        done.append((len(done) % workers, scene.shape.kind, scene.surface.alphas[0]))
    assert len(done) == 12 * len(shapes)
    return done


def test_processes_share_out_the_tables_of_roughnesses() -> None:
    tables = {(worker, alpha) for worker, _, alpha in loaded(["sphere"], 2)}
    assert len(tables) == 4  # two each, and not eight
    one = [alpha for _, _, alpha in loaded(["sphere"], 1)]
    assert one == sorted(one)  # one process keeps the order of the plan


def test_processes_share_out_the_trees_of_meshes() -> None:
    shapes = ["torus", "superquadric", "lathe", "blob"]
    trees = {(worker, shape) for worker, shape, _ in loaded(shapes, 2)}
    assert len(trees) == 4


def test_where_one_process_renders_for_all_meshes_stay_together() -> None:
    """Its tree of a mesh serves whoever scores; roughnesses are shared out still."""
    shapes = [shape for _, shape, _ in loaded(["torus", "blob"], 2, one_renders=True)]
    assert [len(set(half)) for half in (shapes[:12], shapes[12:])] == [1, 1]
    tables = {(worker, alpha) for worker, _, alpha in loaded(["sphere"], 2, one_renders=True)}
    assert len(tables) == 4


def test_several_processes_give_the_same_to_the_bit(tmp_path: Path) -> None:
    alone = run(MANY, tmp_path / "alone", NOBODY, engine=in_this_process(NOBODY)).table
    with WorkerProcess(60) as one, WorkerProcess(60) as two:
        engine = in_worker_processes(NOBODY, [one, two])
        shared = run(MANY, tmp_path / "shared", NOBODY, engine=engine)
        assert len({pid for worker in (one, two) for pid in worker.stream(pid_of)}) == 2
    pd.testing.assert_frame_equal(shared.table, alone, check_exact=True)


def pid_of() -> Iterator[int]:
    yield os.getpid()


@pytest.mark.parametrize("cores", [1, 3])
def test_a_run_that_takes_a_while_gets_a_process_a_core(
    cores: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    share_at_once(monkeypatch, cores)
    started = []

    class Counted(WorkerProcess):
        def __init__(self, timeout: float) -> None:
            super().__init__(timeout)
            started.append(timeout)

    monkeypatch.setattr(sharing, "WorkerProcess", Counted)
    with WorkerProcess(60) as worker:
        engine = in_worker_process(NOBODY, worker)
        table = run(MANY, tmp_path / "run", NOBODY, engine=engine).table
    assert started == [60] * (cores - 1)
    assert set(table.alpha) == {surface.alpha for surface in MANY.surfaces}


def test_a_graphics_card_and_little_memory_have_few_processes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sharing, "usable_cores", lambda: 16)
    monkeypatch.setattr(sharing, "free_memory", lambda: math.inf)
    monkeypatch.setattr(sharing, "free_card_memory", lambda: 0.0)
    assert sharing.processes(CARD) == 1
    assert sharing.cpu_processes() == sharing.MOST_PROCESSES
    assert sharing.processes(NOBODY) == sharing.MOST_PROCESSES
    for free, count in ((0.0, 1), (2.5e9, 3), (1e12, sharing.MOST_PROCESSES)):
        monkeypatch.setattr(sharing, "free_memory", lambda free=free: free)
        assert sharing.processes(NOBODY) == count
    monkeypatch.setattr(sharing, "free_card_memory", lambda: 9e9)
    assert sharing.processes(CARD) == 3
    monkeypatch.setattr(sharing, "usable_cores", lambda: 2)
    assert sharing.processes(CARD) == 2


@pytest.mark.parametrize(
    ("told", "free"),
    [
        ("80994, Default, Disabled", 80994),
        ("80994, Default, Disabled\n512, Default, [N/A]", 512),  # whichever renders
        ("80994, Exclusive_Process, Disabled", 0),
        ("80994, Default, Enabled", 0),
        ("[N/A], Default, Disabled", 0),
        ("No devices were found", 0),
        ("", 0),
    ],
)
def test_free_memory_of_a_card_is_what_its_driver_tells(
    told: str, free: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = tmp_path / "nvidia-smi"
    command.write_text(f"#!/bin/sh\nprintf '{told}\\n'\n", encoding="utf-8")
    command.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert free_card_memory() == free * 2**20
    command.write_text("#!/bin/sh\necho 80994, Default, Disabled\nexit 9\n", encoding="utf-8")
    assert free_card_memory() == 0
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    assert free_card_memory() == 0


def test_free_memory_is_that_of_the_machine_or_of_its_container(tmp_path: Path) -> None:
    assert free_memory(tmp_path) == math.inf
    (tmp_path / "proc").mkdir()
    lines = "MemTotal: 9 kB\nMemFree: 1 kB\nMemAvailable:    4000 kB\nBuffers: 7 kB\n"
    (tmp_path / "proc" / "meminfo").write_text(lines, encoding="ascii")
    assert free_memory(tmp_path) == 4000 * 1024
    group = tmp_path / "sys" / "fs" / "cgroup"
    group.mkdir(parents=True)
    (group / "memory.current").write_text("900\n", encoding="ascii")
    stat = "anon 500\nfile 400\ninactive_file 300\n"
    (group / "memory.stat").write_text(stat, encoding="ascii")
    for limit, free in (("max", 4000 * 1024), ("1000", 400), ("500", 0), ("99999999", 4000 * 1024)):
        (group / "memory.max").write_text(limit + "\n", encoding="ascii")
        assert free_memory(tmp_path) == free


def sleeps(*_: object) -> Iterator[FamilyResult]:
    time.sleep(60)
    yield FamilyResult()


def test_a_stop_ends_what_the_processes_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """As by Ctrl-C: nobody waits for the families under way."""

    def stopped(source: Iterable[FamilyTask]) -> Iterator[FamilyTask]:
        for task, _ in pairwise(source):
            yield task
        raise KeyboardInterrupt

    with WorkerProcess(120) as one, WorkerProcess(120) as two:
        assert len(list(one.stream(pid_of)) + list(two.stream(pid_of))) == 2
        monkeypatch.setattr(work, "_one_result", sleeps)
        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            list(in_worker_processes(NOBODY, [one, two])(stopped(tasks()[:3])))
        assert time.monotonic() - began < 30  # a half of what one of them would take
        with pytest.raises(Died, match="given up"):
            list(one.stream(pid_of))


def test_a_process_whose_parent_is_gone_before_it_is_ready_says_nothing() -> None:
    """A killed command left a traceback on the terminal."""
    kept, given = multiprocessing.Pipe()
    kept.close()
    serve(given, None, (None, None))


def fails_with(error: Exception) -> Iterator[None]:
    yield None
    raise error


@pytest.mark.parametrize("error", [EOFError("cut"), BrokenPipeError("gone"), ValueError("wrong")])
def test_what_a_task_raises_is_no_death_of_its_process(error: Exception) -> None:
    """One that reads like a lost connection was waited for without end."""
    with WorkerProcess(60) as worker:
        (before,) = worker.stream(pid_of)
        with _watched(30), pytest.raises(type(error), match=str(error)):
            list(worker.stream(fails_with, error))
        assert list(worker.stream(pid_of)) == [before]


class Odd(Exception):
    """One that Python pickles, and cannot make again: it gives one of two words to its class."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(f"{first} and {second}")


def fails_oddly() -> Iterator[None]:
    yield None
    raise Odd("one", "another")


def test_an_exception_that_cannot_be_made_again_keeps_its_words() -> None:
    """Those of stores elsewhere are such: a TypeError about their class was told instead."""
    with WorkerProcess(60) as worker, pytest.raises(RuntimeError, match="Odd: one and another"):
        list(worker.stream(fails_oddly))


@contextmanager
def _watched(seconds: int) -> Iterator[None]:
    """Raise where the block waits for longer."""

    def late(*_: object) -> None:
        raise TimeoutError(f"nothing came in {seconds} s")

    earlier = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, earlier)
