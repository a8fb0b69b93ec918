"""Native crashes and hangs cost the family that they happened in, and no more."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from runs import NOBODY, SUITE, share_at_once

import malus.bench.running.truths
from malus.bench import run
from malus.bench.datasets.render import RenderTask, render_dataset
from malus.bench.running.cluster import cluster_client, engine, spread
from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.inside_worker import import_all
from malus.bench.running.plan import plan
from malus.bench.running.status import status
from malus.bench.running.truths import truths
from malus.bench.running.work import Engine, in_worker_process, in_worker_processes, work
from malus.bench.running.worker_process import Died, WorkerProcess, retried
from malus.reconstruct import Components, Observation, get_method
from malus.renderers import Truth
from malus.renderers.datasets.dataset import open_folder
from malus.scenes import InputError, Scene

ROUGH = max(surface.alpha for surface in (scene.surface for scene in SUITE.scenes()))
UNPOLARISED = get_method("unpolarised")


def crashes_on_the_rough(observation: Observation) -> Components:
    if observation.alpha == ROUGH:
        os.kill(os.getpid(), signal.SIGSEGV)
    return UNPOLARISED.reconstruct(observation)


def hangs_on_the_rough(observation: Observation) -> Components:
    while observation.alpha == ROUGH:
        time.sleep(60)
    return UNPOLARISED.reconstruct(observation)


CRASHES = dataclasses.replace(
    UNPOLARISED, name="bad", needs=frozenset({"alpha"}), reconstruct=crashes_on_the_rough
)
HANGS = dataclasses.replace(CRASHES, reconstruct=hangs_on_the_rough)


def with_method(name: str) -> Any:
    return SUITE.model_copy(update={"methods": ("eq8", f"{__name__}:{name}")})


def smooth_first(tasks: Iterable[FamilyTask]) -> list[FamilyTask]:
    return sorted(tasks, key=lambda task: task.family.scenes[0].surface.alpha)


def do_the_smooth() -> None:
    """Load what a family needs."""
    family = min(plan(SUITE), key=lambda family: family.scenes[0].surface.alpha)
    work(FamilyTask("0", family, SUITE.renderer, {"eq8": "eq8"}), NOBODY)


def loaded_process(stack: ExitStack) -> Engine:
    """A process that has loaded everything has five seconds for a family of milliseconds."""
    child = stack.enter_context(WorkerProcess())
    list(child.stream(pids_of_the_loaded))
    child.timeout = 5.0
    return lambda tasks: in_worker_process(NOBODY, child)(smooth_first(tasks))


def pids_of_the_loaded() -> Iterator[int]:
    do_the_smooth()
    yield os.getpid()


def loaded_workers(stack: ExitStack) -> Engine:
    pytest.importorskip("distributed", reason="Dask is not installed")
    client = stack.enter_context(cluster_client(2, None))
    client.run(do_the_smooth)
    return lambda tasks: spread(tasks, client, NOBODY, 5.0)


def two_processes(stack: ExitStack) -> Engine:
    workers = [stack.enter_context(WorkerProcess(60)) for _ in range(2)]
    return in_worker_processes(NOBODY, workers)


def own_process(stack: ExitStack) -> Engine:
    return stack.enter_context(engine(NOBODY, None, None, 60.0))


@pytest.mark.parametrize(
    ("start", "method", "says"),
    [
        (own_process, "CRASHES", "died of SIGSEGV"),
        (two_processes, "CRASHES", "died of SIGSEGV"),
        (loaded_process, "HANGS", "longer than the 5 seconds"),
        (loaded_workers, "HANGS", "workers died of it"),
    ],
)
def test_a_crash_or_a_hang_costs_its_own_family(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, start: Any, method: str, says: str
) -> None:
    if method == "HANGS":
        # Wait for it once only.
        monkeypatch.setattr("malus.bench.running.worker_process.ATTEMPTS", 1)
        monkeypatch.setattr("malus.bench.running.cluster.ATTEMPTS", 1)
    good = run(SUITE.model_copy(update={"methods": ("eq8",)}), tmp_path / "good", NOBODY).table
    smooth = good[good.alpha < ROUGH].reset_index(drop=True)
    with ExitStack() as stack:
        results = run(with_method(method), tmp_path / "bad", NOBODY, engine=start(stack))
    eq8_rows = results.table[results.table.method == "eq8"].reset_index(drop=True)
    # Names are categories, of which a table of two families has more than it shows here.
    names = dict.fromkeys(smooth.select_dtypes("category"), "str")
    pd.testing.assert_frame_equal(eq8_rows.astype(names), smooth.astype(names), check_exact=True)
    assert (results.run["families"], results.run["families_failed"]) == (2, 1)
    assert pd.Series(results.run["failures"]).str.contains(says).all()
    (reason,) = (why.reason for _, why in status(tmp_path / "bad").failed)
    assert reason == results.run["failures"][0]

    def nothing_to_do(tasks: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        assert not list(tasks), "a crash is remembered"
        yield from ()

    run(with_method(method), tmp_path / "bad", NOBODY, engine=nothing_to_do)


def test_the_time_limit_reaches_every_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    limits: list[float] = []
    names = "malus.bench.running.cluster"
    monkeypatch.setattr(f"{names}.in_worker_process", lambda _, child: limits.append(child.timeout))
    monkeypatch.setattr(f"{names}.spread", lambda *arguments: limits.append(arguments[3]))
    monkeypatch.setattr(f"{names}._local", lambda *_: None)
    with engine(NOBODY, None, None, 7.0):
        pass
    with engine(NOBODY, 2, None, 8.0) as spread_over:
        spread_over([])
    assert limits == [7.0, 8.0]


def test_a_family_that_crashed_once_is_done_by_the_next_process(tmp_path: Path) -> None:
    """As after the kernel killed a process for memory that another one had."""
    with WorkerProcess() as worker:
        killed: list[int] = []

        def kills_first(tasks: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
            (killed[:],) = worker.stream(pids)
            os.kill(killed[0], signal.SIGKILL)
            yield from in_worker_process(NOBODY, worker)(tasks)

        results = run(SUITE, tmp_path / "killed", NOBODY, engine=kills_first)
    assert killed
    assert results.run["families_failed"] == 0
    whole = run(SUITE, tmp_path / "whole", NOBODY)
    pd.testing.assert_frame_equal(results.table, whole.table, check_exact=True)


def pids() -> Iterator[list[int]]:
    yield [os.getpid()]


def raises() -> Iterator[int]:
    yield 1
    raise InputError("mesh.obj", "a mesh", "none", "mend it")


def test_what_a_worker_raises_arrives_and_it_lives_on() -> None:
    with WorkerProcess(timeout=60) as worker:
        stream = worker.stream(raises)
        assert next(stream) == 1
        with pytest.raises(InputError, match=r"mesh\.obj: expected a mesh"):
            next(stream)
        assert list(worker.stream(range, 2)) == [0, 1]
        # Half a stream that nobody reads on must not be taken for the next one.
        half = worker.stream(range, 5)
        assert next(half) == 0
        half.close()
        assert list(worker.stream(range, 2)) == [0, 1]


def test_a_dead_worker_is_tried_again_and_then_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("malus.bench.running.worker_process.ATTEMPTS", 3)
    attempts: list[int] = []

    def dies(times: int) -> Iterator[str]:
        attempts.append(len(attempts))
        yield f"attempt {len(attempts)}"
        if len(attempts) <= times:
            raise Died("it ended")

    assert list(retried(lambda: dies(2))) == ["attempt 1", "attempt 2", "attempt 3"]
    attempts.clear()
    with pytest.raises(Died, match=r"^it ended, 3 times$"):
        list(retried(lambda: dies(3)))
    assert len(attempts) == 3


def test_what_is_begun_leaves_nothing_behind() -> None:
    """Neither its results nor its exceptions are taken for those of the task after it."""
    with WorkerProcess(timeout=60) as worker:
        worker.begin(range, 5)
        worker.begin(import_all, "no_such_module")
        assert list(worker.stream(range, 2)) == [0, 1]
        worker.begin(os._exit, 3)
        with pytest.raises(Died, match="ended with code 3"):
            list(worker.stream(range, 2))
        assert list(worker.stream(range, 1)) == [0]  # by the next process


def test_a_worker_ends_with_its_parent(tmp_path: Path) -> None:
    """Also where the parent was killed and the worker is busy."""
    script = (
        "import sys, time; sys.path[:0] = sys.argv[1:]\n"
        "from malus.bench.running.worker_process import WorkerProcess\n"
        "from test_faults import tells_and_sleeps\n"
        "with WorkerProcess() as worker:\n"
        "    print(next(worker.stream(tells_and_sleeps)), flush=True)\n"
        "    input()"
    )
    command = [sys.executable, "-c", script, *map(str, Path(__file__).parents[:2])]
    parent = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    worker_pid = int(parent.stdout.readline())
    parent.kill()
    parent.communicate()
    deadline = time.monotonic() + 20
    while Path(f"/proc/{worker_pid}").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not Path(f"/proc/{worker_pid}").exists()


def tells_and_sleeps() -> Iterator[int]:
    yield os.getpid()
    time.sleep(600)


def test_a_hang_that_holds_the_lock_of_python_ends_too() -> None:
    with WorkerProcess(timeout=1) as worker, pytest.raises(Died, match="1 seconds of its timeout"):
        list(worker.stream(holds_the_lock))


def holds_the_lock() -> Iterator[int]:
    # One call into C that takes minutes and lets no other thread of Python run.
    yield sum(range(10**11))


@pytest.mark.parametrize("seconds", [0, -1, float("nan"), float("inf")])
def test_no_time_is_one_line(seconds: float) -> None:
    with pytest.raises(InputError, match=r"^timeout: expected seconds above 0"):
        WorkerProcess(timeout=seconds)


# --- malus render ---


def fails_to_render(error: BaseException, scene_id: str) -> Any:
    render = malus.bench.running.truths.render_torrance_sparrow

    def renderer(scene: Scene) -> object:
        if scene.id == scene_id:
            raise error
        return render(scene)

    return renderer


def test_a_render_records_what_fails_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = list(SUITE.scenes())
    bad = good.pop(1).id
    with monkeypatch.context() as patch:
        patch.setattr(
            "malus.bench.running.truths.render_torrance_sparrow",
            fails_to_render(ZeroDivisionError("made up"), bad),
        )
        done = render_dataset(SUITE, tmp_path, NOBODY)
        assert (done["rendered"], done["failed"]) == (3, 1)
    progress = status(tmp_path)
    assert (progress.done, progress.failed_families, progress.left) == (3, 1, 0)
    assert progress.finished
    assert [(why.scene, why.reason) for _, why in progress.failed] == [
        (bad, "ZeroDivisionError: made up")
    ]
    assert set(open_folder(tmp_path).scenes) == {scene.id for scene in good}
    # It is remembered, until it is asked for or decided by another seed.
    assert render_dataset(SUITE, tmp_path, NOBODY)["failed"] == 1
    mended = render_dataset(SUITE, tmp_path, NOBODY, retry_failed=True)
    assert (mended["rendered"], mended["failed"]) == (1, 0)
    assert not status(tmp_path).failed


def test_a_render_tries_a_wrong_input_again_and_needs_one_scene(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(_: Scene) -> object:
        raise InputError("mesh.obj", "a mesh", "none", "mend it")

    with monkeypatch.context() as patch:
        patch.setattr("malus.bench.running.truths.render_torrance_sparrow", refuses)
        with pytest.raises(InputError, match=r"found none; mesh\.obj: expected a mesh"):
            render_dataset(SUITE, tmp_path, NOBODY)
    assert status(tmp_path).failed_families == 4
    assert render_dataset(SUITE, tmp_path, NOBODY)["rendered"] == 4


@pytest.mark.parametrize("cores", [1, 2])
def test_a_render_in_workers_is_the_same_and_survives_their_death(
    cores: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    share_at_once(monkeypatch, cores)
    render_dataset(SUITE, tmp_path / "here", NOBODY)
    with WorkerProcess() as worker:
        render_dataset(SUITE, tmp_path / "apart", NOBODY, worker=worker)
        here, there = open_folder(tmp_path / "here"), open_folder(tmp_path / "apart")
        assert [entry.sha256 for entry in here.record.scenes] == [
            entry.sha256 for entry in there.record.scenes
        ]
        monkeypatch.setattr("malus.bench.datasets.render._rendered", dies_after_one)
        done = render_dataset(SUITE, tmp_path / "dies", NOBODY, worker=worker)
    # Each of two families has two scenes, and every process dies after one: no scene is lost.
    assert (done["rendered"], done["failed"]) == (4, 0)


def dies_after_one(order: RenderTask, _: int) -> Iterator[Truth]:
    result = FamilyResult()
    for _, truth in truths(order.family, order.scenes, order.renderer, order.variant, result):
        yield truth
        os.kill(os.getpid(), signal.SIGKILL)
