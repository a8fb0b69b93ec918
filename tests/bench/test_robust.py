"""It holds up: kills at any moment, two at once, full disks, failures, workers that die.

`MALUS_KILLS=50` kills that often instead of 8 times; `MALUS_FAMILIES=500` also watches the memory
of a run of so many families, which takes minutes.
"""

from __future__ import annotations

import dataclasses
import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import malus.bench.running.work
from malus.bench import read_results, run
from malus.bench.datasets.render import render_dataset
from malus.bench.running.cluster import spread
from malus.bench.running.parts import PLAN
from malus.bench.running.plan import plan
from malus.bench.running.status import status
from malus.bench.running.work import Engine, FamilyResult, FamilyTask, here
from malus.reconstruct import Components, Observation, get_method
from malus.renderers.variant import Variant, choose
from malus.scenes import Camera, InputError, Scene, Suite, load_suite
from malus.scenes.core.result_files import EXAMPLES, PARTS, RUN

KILLS = int(os.environ.get("MALUS_KILLS", "8"))
TINY = ("run", "quick", "--resolution", "8", "--samples", "2")
NOBODY = Variant("scalar_spectral_polarized", "not used")
SUITE = load_suite("quick").model_copy(
    update={
        "renderer": "torrance-sparrow",
        "lights": load_suite("quick").lights[1:],
        "bodies": ("unpolarised",),
        "camera": Camera(resolution=8),
        "methods": ("unpolarised", "eq8"),
    }
)
"""Two families of two scenes, whose truths are closed forms: a run takes a moment."""

SMALL = load_suite("quick")
SMALL = SMALL.model_copy(
    update={
        "camera": Camera(resolution=8),
        "sampling": SMALL.sampling.model_copy(update={"samples": 2}),
    }
)
"""What TINY renders, for runs without a report."""


def start(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", "from malus.bench.cli import main; main()", *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, process_group=0
    )


def end(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, errors = process.communicate(timeout=120)
    return process.returncode, errors


def files(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def assert_same_results(folder: Path, expected: Path) -> None:
    """To the bit: the same renders of the same seeds, whoever made them and in which order."""
    pd.testing.assert_frame_equal(
        read_results(folder).table, read_results(expected).table, check_exact=True
    )
    assert files(folder / PARTS) == files(expected / PARTS)
    for path in (expected / PARTS).iterdir():
        one, other = pd.read_parquet(folder / PARTS / path.name), pd.read_parquet(path)
        pd.testing.assert_frame_equal(one, other, check_exact=True)
    assert files(folder / EXAMPLES) == files(expected / EXAMPLES)
    for path in (expected / EXAMPLES).iterdir():
        assert (folder / EXAMPLES / path.name).read_bytes() == path.read_bytes()


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, float]:
    """An uninterrupted run, and the seconds until it had written its results."""
    out = tmp_path_factory.mktemp("robust") / "whole"
    started = time.perf_counter()
    process = start(*TINY, "--out", str(out))
    wait_for((out / RUN).exists, process)
    seconds = time.perf_counter() - started
    code, errors = end(process)
    assert code == 0, errors
    return out, seconds


def wait_for(true: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    while not true():
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


def test_kills_at_random_moments_lose_nothing(
    tmp_path: Path, uninterrupted: tuple[Path, float]
) -> None:
    whole, seconds = uninterrupted
    moments = random.Random(8)
    out = tmp_path / "killed"
    for _ in range(KILLS):
        process = start(*TINY, "--out", str(out))
        try:
            # A run is longer than this: it still draws its report, here also while it starts to.
            process.wait(moments.uniform(0, 1.3 * seconds))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
        end(process)
    code, errors = end(start(*TINY, "--out", str(out)))
    assert code == 0, errors
    assert_same_results(out, whole)
    assert files(out) == files(whole), "left behind"
    assert status(out).finished


@pytest.mark.parametrize(
    ("number", "code", "options"),
    [
        (signal.SIGINT, 130, ()),
        (signal.SIGTERM, 143, ()),
        (signal.SIGINT, 130, ("--workers", "2")),
    ],
    ids=["SIGINT", "SIGTERM", "SIGINT with workers"],
)
def test_a_stop_is_one_line_and_leaves_nothing_half_written(
    tmp_path: Path, number: signal.Signals, code: int, options: tuple[str, ...]
) -> None:
    if options:
        pytest.importorskip("distributed", reason="Dask is not installed")
    process = start("run", "quick", "--samples", "128", "--out", str(tmp_path), *options)
    wait_for(lambda: any(tmp_path.glob(f"{PARTS}/[0-9a-f]*.parquet")), process)
    # As a terminal does, to all processes of the command.
    os.killpg(process.pid, number)
    found, errors = end(process)
    assert found == code
    assert errors.splitlines()[-1] == "malus: stopped; the same command goes on where it was"
    assert "Traceback" not in errors
    assert not [name for name in files(tmp_path) if ".part-" in name]
    assert not status(tmp_path).finished
    assert status(tmp_path).done >= 1


def test_two_runs_in_one_folder_do_not_harm_each_other(
    tmp_path: Path, uninterrupted: tuple[Path, float]
) -> None:
    script = (
        "import json, sys; from malus.bench import run; from malus.scenes import Suite\n"
        "run(Suite.parse(json.loads(sys.argv[1]), ''), sys.argv[2])"
    )
    command = [sys.executable, "-c", script, SMALL.model_dump_json(), str(tmp_path)]
    both = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    for process in both:
        assert end(process) == (0, "")
    assert_same_results(tmp_path, uninterrupted[0])
    assert not [name for name in files(tmp_path) if ".part-" in name]


def test_two_suites_at_once_in_one_folder_are_refused(tmp_path: Path) -> None:
    other = SUITE.model_copy(update={"methods": ("eq8",)})

    def meanwhile(tasks: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        with pytest.raises(InputError, match="found another suite's; choose another --out"):
            run(other, tmp_path, NOBODY)
        with pytest.raises(InputError, match="found a run; choose another --out"):
            render_dataset(SUITE, tmp_path, NOBODY)
        run(SUITE, tmp_path, NOBODY)
        yield from here(NOBODY)(tasks)

    results = run(SUITE, tmp_path, NOBODY, engine=meanwhile)
    assert results.run["suite_id"] == SUITE.id
    assert not [name for name in files(tmp_path) if ".part-" in name]
    run(other, tmp_path, NOBODY)


def test_what_dead_processes_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    host = socket.gethostname()
    left = [
        tmp_path / PARTS / f".part-{host}-{dead.pid}-x.json",
        tmp_path / f".part-{host}-{dead.pid}-y",
    ]
    others = [tmp_path / f".part-{host}-{os.getpid()}-x", tmp_path / f".part-else-{dead.pid}-x"]
    (tmp_path / PARTS).mkdir()
    for path in (*left, *others):
        path.touch()
    run(SUITE, tmp_path, NOBODY)
    assert not any(path.exists() for path in left)
    assert all(path.exists() for path in others)


# --- a changed suite ---


def counted(tasks: list[FamilyTask]) -> Engine:
    """The engine of this process, which notes what it is given."""

    def engine(source: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        for task, made in here(NOBODY)(source):
            tasks.append(task)
            yield task, made

    return engine


def test_a_changed_suite_computes_only_what_changed(tmp_path: Path) -> None:
    tasks: list[FamilyTask] = []
    fewer = SUITE.model_copy(update={"methods": ("eq8",), "surfaces": SUITE.surfaces[:1]})
    run(fewer, tmp_path, NOBODY, engine=counted(tasks))
    assert [tuple(task.methods) for task in tasks] == [("eq8",)]
    tasks.clear()
    results = run(SUITE, tmp_path, NOBODY, engine=counted(tasks))
    assert sorted(tuple(task.methods) for task in tasks) == [
        ("unpolarised",),
        ("unpolarised", "eq8"),
    ]
    at_once = run(SUITE, tmp_path / "at once", NOBODY)
    pd.testing.assert_frame_equal(results.table, at_once.table, check_exact=True)
    tasks.clear()
    again = run(fewer, tmp_path, NOBODY, engine=counted(tasks))
    assert not tasks
    assert set(again.table.method) == {"eq8"}


def test_a_damaged_part_is_made_again(tmp_path: Path) -> None:
    before = run(SUITE, tmp_path, NOBODY)
    one, other = sorted((tmp_path / PARTS).iterdir())
    one.write_bytes(one.read_bytes()[:-9])
    raw = bytearray(other.read_bytes())
    raw[:200] = bytes(200)
    other.write_bytes(raw)
    after = run(SUITE, tmp_path, NOBODY)
    assert after.run["families_taken_over"] == 0
    pd.testing.assert_frame_equal(after.table, before.table, check_exact=True)


# --- failures ---


def fails_on(scene_id: str, calls: list[str]) -> Callable[..., object]:
    render = malus.bench.running.work.render_torrance_sparrow

    def renderer(scene: Scene) -> object:
        calls.append(scene.id)
        if scene.id == scene_id:
            raise ZeroDivisionError("made up\non two lines")
        return render(scene)

    return renderer


def test_a_scene_that_cannot_be_rendered_is_recorded_and_the_run_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = run(SUITE, tmp_path / "good", NOBODY)
    bad = next(SUITE.scenes()).id
    calls: list[str] = []
    with monkeypatch.context() as patch:
        patch.setattr("malus.bench.running.work.render_torrance_sparrow", fails_on(bad, calls))
        results = run(SUITE, tmp_path / "bad", NOBODY)
        assert len(calls) == 4
        assert run(SUITE, tmp_path / "bad", NOBODY).run["families_failed"] == 1
        assert len(calls) == 4, "a failure is remembered"
    rest = good.table[good.table.scene != bad].reset_index(drop=True)
    # Names are categories, of which the table without a failure has more.
    names = dict.fromkeys(rest.select_dtypes("category"), "str")
    found = results.table.astype(names)
    pd.testing.assert_frame_equal(found, rest.astype(names), check_exact=True)
    assert (results.run["families"], results.run["families_failed"]) == (2, 1)
    assert results.run["failures"] == ["ZeroDivisionError: made up\\non two lines"]
    found = status(tmp_path / "bad")
    assert (found.done, found.failed_families, found.left) == (1, 1, 0)
    assert found.finished
    assert [why.scene for _, why in found.failed] == [bad]
    mended = run(SUITE, tmp_path / "bad", NOBODY, retry_failed=True)
    assert mended.run["families_failed"] == 0
    pd.testing.assert_frame_equal(mended.table, good.table, check_exact=True)
    assert not list((tmp_path / "bad" / PARTS).glob("*.failed.json"))


def test_a_method_that_breaks_costs_its_own_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(_: Observation) -> Components:
        raise RuntimeError("broken")

    name = f"{__name__}:BROKEN"
    broken = dataclasses.replace(get_method("unpolarised"), name="broken", reconstruct=breaks)
    monkeypatch.setattr(sys.modules[__name__], "BROKEN", broken, raising=False)
    good = run(SUITE, tmp_path / "good", NOBODY)
    suite = SUITE.model_copy(update={"methods": (*SUITE.methods, name)})
    results = run(suite, tmp_path / "bad", NOBODY)
    pd.testing.assert_frame_equal(results.table, good.table, check_exact=True)
    assert results.run["families_failed"] == 2
    assert results.run["failures"][0] == "RuntimeError: broken"
    assert {why.method for _, why in status(tmp_path / "bad").failed} == {"broken"}
    assert run(SUITE, tmp_path / "bad", NOBODY).run["families_failed"] == 0


def test_a_wrong_input_is_tried_again_and_no_row_at_all_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(_: Scene) -> object:
        raise InputError("mesh.obj", "a mesh", "none", "mend it")

    with monkeypatch.context() as patch:
        patch.setattr("malus.bench.running.work.render_torrance_sparrow", refuses)
        with pytest.raises(InputError, match=r"mesh\.obj: expected a mesh, found none; mend it"):
            run(SUITE, tmp_path, NOBODY)
    assert run(SUITE, tmp_path, NOBODY).run["families_failed"] == 0


def test_a_stop_that_a_library_wraps_is_still_a_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def wraps(_: Scene) -> object:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as stop:
            raise RuntimeError("exception in a loop") from stop

    monkeypatch.setattr("malus.bench.running.work.render_torrance_sparrow", wraps)
    with pytest.raises(KeyboardInterrupt):
        run(SUITE, tmp_path, NOBODY)
    assert not list((tmp_path / PARTS).glob("*"))


def test_status_counts_what_is_left_and_refuses_what_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="neither"):
        status(tmp_path)

    def stops(source: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        yield next(here(NOBODY)(source))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(SUITE, tmp_path, NOBODY, engine=stops)
    found = status(tmp_path).as_json()
    assert (found["total"], found["done"], found["left"], found["finished"]) == (2, 1, 1, False)
    listed = json.loads((tmp_path / PLAN).read_text("utf-8"))
    listed["families"][0]["id"] = "../../etc/passwd"
    (tmp_path / PLAN).write_text(json.dumps(listed), "utf-8")
    with pytest.raises(InputError, match="the plan of a run"):
        status(tmp_path)


# --- folders that cannot be written ---


@contextmanager
def mounted(folder: Path, *options: str) -> Iterator[Path]:
    """A small file system of its own, where one may mount."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", ",".join(options), "none", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("no mount here")
    if done.returncode != 0:
        pytest.skip(f"may not mount a file system here: {done.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_a_full_disk_is_one_line_and_loses_nothing(
    tmp_path: Path, uninterrupted: tuple[Path, float]
) -> None:
    with mounted(tmp_path / "small", "size=200k") as small:
        out = small / "out"
        out.mkdir()
        ballast = small / "ballast"
        # Room for the plan and a few parts, not for all.
        ballast.write_bytes(bytes(100_000))
        code, errors = end(start(*TINY, "--out", str(out)))
        assert code == 2, errors
        lines = [line for line in errors.splitlines() if line.startswith("malus: ")]
        assert len(lines) == 1, errors
        assert "No space left on device" in lines[0]
        assert "Traceback" not in errors
        assert not [name for name in files(out) if ".part-" in name]
        done = status(out).done
        assert 0 < done < 8
        assert not status(out).failed
        ballast.unlink()
        subprocess.run(["mount", "-o", "remount,size=16m", str(small)], check=True)
        assert run(SMALL, out).run["families_taken_over"] == done
        assert_same_results(out, uninterrupted[0])


def test_a_read_only_folder_is_one_line(tmp_path: Path) -> None:
    with mounted(tmp_path / "fixed", "ro") as fixed:
        code, errors = end(start(*TINY, "--out", str(fixed)))
    assert code == 2
    lines = [line for line in errors.splitlines() if line.startswith("malus: ")]
    assert len(lines) == 1, errors
    assert "Read-only file system" in lines[0]


# --- clusters ---


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """A client of a cluster of two processes."""
    pytest.importorskip("distributed", reason="Dask is not installed")
    from malus.bench.running.cluster import _local

    with ExitStack() as stack:
        yield _local(2, stack)


def sleeps(task: FamilyTask, variant: str) -> FamilyResult:
    time.sleep(1)
    return FamilyResult()


def test_spreading_costs_less_than_a_tenth_of_tasks_of_a_second(
    client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("malus.bench.running.cluster._remote", sleeps)
    family = plan(SUITE)[0]
    tasks = [FamilyTask(str(k), family, "torrance-sparrow", {}) for k in range(8)]
    warm, timed = tasks[:2], tasks[2:]
    assert len(list(spread(warm, client, NOBODY))) == 2
    started = time.perf_counter()
    done = {task.id for task, _ in spread(timed, client, NOBODY)}
    seconds = time.perf_counter() - started
    assert done == {task.id for task in timed}
    assert seconds < 1.1 * len(timed) / 2


def test_workers_make_the_same_tables_and_a_killed_one_loses_nothing(
    client: Any, tmp_path: Path, uninterrupted: tuple[Path, float]
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
    assert results.run["families_failed"] == 0
    assert_same_results(tmp_path, uninterrupted[0])


@pytest.mark.skipif("MALUS_FAMILIES" not in os.environ, reason="MALUS_FAMILIES=500 asks for it")
def test_memory_stays_flat(tmp_path: Path) -> None:
    count = int(os.environ["MALUS_FAMILIES"])
    data = SMALL.model_dump(mode="json") | {
        "surfaces": [{"alpha": 0.05 + 0.9 * k / count} for k in range(count)],
        "lights": SMALL.model_dump(mode="json")["lights"][1:],
        "bodies": ["polarised"],
    }
    megabytes: list[float] = []

    def watch(done: int, total: int, label: str) -> None:
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
        megabytes.append(pages * os.sysconf("SC_PAGE_SIZE") / 1e6)
        if done % 50 == 0:
            sys.stdout.write(f"{done} families: {megabytes[-1]:.0f} MB\n")

    run(Suite.parse(data, "test"), tmp_path, progress=watch)
    # Kernels and tables of methods are kept up to a fixed number: the first fifth fills them.
    assert megabytes[-2] - megabytes[count // 5] < 64


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--workers", "0"], "at least 1"),
        (["--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], "one of the two"),
    ],
)
def test_wrong_clusters_are_one_line(tmp_path: Path, options: list[str], says: str) -> None:
    code, errors = end(start(*TINY, "--out", str(tmp_path), *options))
    assert code == 2
    assert says in errors.splitlines()[-1]


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
