"""Clusters: workers are kept busy, make the same tables as one process, and may die."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest
from runs import (
    NOBODY,
    SMALL,
    SUITE,
    TINY,
    assert_same_results,
    end,
    one_line,
    run_malus,
    start,
    wait_for,
)

from malus.bench import run
from malus.bench.running import cluster
from malus.bench.running.cluster import WAITING, spread
from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.plan import plan
from malus.renderers.variant import choose
from malus.scenes import InputError


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """A client of a cluster of two processes."""
    pytest.importorskip("distributed", reason="Dask is not installed")
    from malus.bench.running.cluster import _local

    with ExitStack() as stack:
        yield _local(2, stack)


def meets(task: FamilyTask, *_: object) -> FamilyResult:
    """Wait until another task is under way too, which only another worker can do."""
    mine = Path(task.id)
    mine.touch()
    until = time.monotonic() + 60
    while len(list(mine.parent.iterdir())) < 2:
        if time.monotonic() > until:
            raise RuntimeError("no worker does the other task")
        time.sleep(0.01)
    return FamilyResult()


def test_workers_do_tasks_at_the_same_time(
    client: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What the scheduler takes of a family's time is measured by `malus bench scaling`."""
    monkeypatch.setattr("malus.bench.running.cluster._remote", meets)
    family = plan(SUITE)[0]
    tasks = [FamilyTask(str(tmp_path / str(k)), family, "torrance-sparrow", {}) for k in range(2)]
    done = list(spread(tasks, client, NOBODY))
    assert sorted(task.id for task, _ in done) == [task.id for task in tasks]
    assert not any(result.failures for _, result in done)


def answers(task: FamilyTask, *_: object) -> FamilyResult:
    return FamilyResult()


def test_no_worker_waits_for_a_task_and_few_are_handed_over(
    client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("malus.bench.running.cluster._remote", answers)
    family = plan(SUITE)[0]
    taken: list[FamilyTask] = []

    def source() -> Iterator[FamilyTask]:
        for k in range(100):
            taken.append(FamilyTask(str(k), family, "torrance-sparrow", {}))
            yield taken[-1]

    under_way = []
    for finished, (_, result) in enumerate(spread(source(), client, NOBODY)):
        assert not result.failures
        under_way.append(len(taken) - finished)
    assert len(under_way) == 100
    # Two workers: one task each and the next one, and a fixed number beside them.
    assert min(under_way[:60]) >= 4
    assert max(under_way) <= 4 + WAITING


def test_workers_make_the_same_tables_and_a_killed_one_loses_nothing(
    client: Any, tmp_path: Path, uninterrupted: Path
) -> None:
    killed: list[int] = []

    def kills(source: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        for pair in spread(source, client, choose()):
            if not killed:
                killed.append(next(iter(client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)
            yield pair

    results = run(SMALL, tmp_path, engine=kills)
    assert killed
    assert results.run["failures"] == []
    assert_same_results(tmp_path, uninterrupted)


def profilers(dask_worker: Any) -> set[str]:
    """Periodic callbacks of a worker that take samples of its threads and are running."""
    callbacks = dask_worker.periodic_callbacks
    return {name for name in ("profile", "profile-cycle") if running(callbacks.get(name))}


def running(callback: Any) -> bool:
    return callback is not None and callback.is_running()


def starts_profiler(dask_worker: Any) -> None:
    from tornado.ioloop import PeriodicCallback

    dask_worker.periodic_callbacks["profile"] = PeriodicCallback(dask_worker.trigger_profile, 10)
    dask_worker.loop.add_callback(dask_worker.periodic_callbacks["profile"].start)


def test_workers_take_no_samples_of_a_thread_that_renders(client: Any) -> None:
    """Dask's profiler holds frames with arrays of Dr.Jit, which only their thread may free."""
    assert set().union(*client.run(profilers).values()) == set()
    client.run(starts_profiler)  # as the workers of somebody else's cluster do
    begun = time.monotonic()  # when a loop comes to what it was asked is its own affair
    while not all(client.run(profilers).values()) and time.monotonic() < begun + 30:
        time.sleep(0.05)
    assert set().union(*client.run(profilers).values()) == {"profile"}
    family = plan(SUITE)[0]
    tasks = [FamilyTask(str(k), family, "torrance-sparrow", {}) for k in range(4)]
    assert len(list(spread(tasks, client, NOBODY))) == 4
    stopped = [name for name in client.run(profilers).values() if not name]
    assert stopped  # on every worker that did a task


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--workers", "0"], "range x>=1"),
        (["--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], "one of the two"),
    ],
)
def test_wrong_clusters_are_one_line(tmp_path: Path, options: list[str], says: str) -> None:
    done = run_malus(*TINY, "--out", str(tmp_path), *options)
    assert done.returncode == 2
    assert says in one_line(done.stderr)


def test_too_few_open_files_for_the_workers_are_one_line() -> None:
    """Dask printed dozens of tracebacks, of which none named the limit."""
    pytest.importorskip("distributed", reason="Dask is not installed")
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    with ExitStack() as stack:
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, before)
        resource.setrlimit(resource.RLIMIT_NOFILE, (40, before[1]))  # 40 did not suffice for two
        with pytest.raises(InputError, match=r"at least 48 open files for 2 workers, found 40; "):
            cluster._local(2, stack)


@pytest.mark.parametrize(
    ("raised", "told"),
    [
        (ModuleNotFoundError("No module named 'distributed'"), "found none; pip install"),
        (ImportError("lib.so: failed to map segment"), "failed to map segment"),
    ],
    ids=["missing", "broken"],
)
def test_a_package_that_is_there_and_broken_is_not_told_as_missing(
    monkeypatch: pytest.MonkeyPatch, raised: ImportError, told: str
) -> None:
    class Fails:
        def find_spec(self, name: str, *_: object) -> None:
            if name == "distributed":
                raise raised

    monkeypatch.delitem(sys.modules, "distributed", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Fails(), *sys.meta_path])
    with pytest.raises((ImportError, InputError), match=told):
        cluster._distributed()


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs Linux")
@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stop_while_workers_start_is_one_line(sent: int, code: int, tmp_path: Path) -> None:
    """To all of a terminal, as Ctrl-C is: workers printed tracebacks, and Dask when it closed."""
    pytest.importorskip("distributed", reason="Dask is not installed")
    command = start(*TINY, "--workers", "2", "--out", str(tmp_path / "out"))
    wait_for(lambda: any(map(imports_dask, processes_of(command.pid))), command)
    os.killpg(command.pid, sent)
    found, errors = end(command)
    assert found == code, errors
    assert one_line(errors) == "malus: stopped; the same command goes on where it was"
    until = time.monotonic() + 60  # what keeps track of semaphores ends a moment later
    while left := processes_of(command.pid):
        assert time.monotonic() < until, left
        time.sleep(0.05)


def processes_of(group: int) -> list[Path]:
    """Processes of a group that are alive, by their folders."""
    found = []
    for process in Path("/proc").iterdir():
        with suppress(OSError):
            if process.name.isdigit() and os.getpgid(int(process.name)) == group:
                found.append(process)
    return [process for process in found if read(process / "cmdline")]  # a zombie has none


def read(file: Path) -> str:
    """Text of a file of a process; empty where that has ended meanwhile."""
    with suppress(OSError):
        return file.read_text()
    return ""


def imports_dask(process: Path) -> bool:
    """Whether a worker has imported half of Dask's package: the library of msgpack is a part."""
    return "spawn_main" in read(process / "cmdline") and "_cmsgpack" in read(process / "maps")


def test_workers_that_do_not_start_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")

    def fails(**_: object) -> None:
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr(distributed, "LocalCluster", fails)
    with ExitStack() as stack, pytest.raises(InputError, match=r"2 processes that start, found Na"):
        cluster._local(2, stack)


def test_a_scheduler_without_workers_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed", reason="Dask is not installed")
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 1)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0") as none,
        pytest.raises(InputError, match=r"a worker, found none in 1 s; start `dask worker tcp://"),
        ExitStack() as stack,
    ):
        cluster._existing(none.scheduler_address, stack)


def test_without_workers_nothing_of_dask_is_imported(tmp_path: Path) -> None:
    script = (
        "import sys; from malus.bench.commands.run import run_command\n"
        "from malus.bench.running.cluster import engine\n"
        "from malus.renderers.variant import choose\n"
        "with engine(choose('scalar'), None, None): print({'dask', 'distributed'} & {*sys.modules})"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "set()"
