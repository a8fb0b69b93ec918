"""It holds up: kills at any moment, two at once, suites that change, and failures.

`MALUS_KILLS=50` kills that often more; `MALUS_FAMILIES=500` also watches the memory
of a run of so many families, which takes minutes.
"""

from __future__ import annotations

import dataclasses
import json
import os
import random
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pandas as pd
import pytest
from runs import NOBODY, SMALL, SUITE, TINY, assert_same_results, end, files, start, wait_for

import malus.bench.running.truths
from malus.bench import run
from malus.bench.datasets.render import render_dataset
from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.parts import PLAN
from malus.bench.running.status import status
from malus.bench.running.work import Engine, in_this_process
from malus.reconstruct import Components, Observation, get_method
from malus.scenes import InputError, Scene, Suite
from malus.scenes.core.result_files import PARTS

KILLS = int(os.environ.get("MALUS_KILLS", "0"))


def test_kills_at_any_moment_lose_nothing(tmp_path: Path, uninterrupted: Path) -> None:
    """Before the first part is there, between parts, and after the last, while the rest is drawn.

    A moment's delay, another one each time, lets kills fall into what is written then.
    """
    delays = random.Random(8)
    stages = [0, 2, 5, 8, *(delays.randrange(9) for _ in range(KILLS))]
    out = tmp_path / "killed"
    killed = []
    for stage in stages:
        process = start(*TINY, "--out", str(out))
        while process.poll() is None and not reached(out, stage):
            time.sleep(0.002)
        time.sleep(delays.uniform(0, 0.05))
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            killed.append(stage)
        end(process)
    assert killed
    code, errors = end(start(*TINY, "--out", str(out)))
    assert code == 0, errors
    assert_same_results(out, uninterrupted)
    assert files(out) == files(uninterrupted), "left behind"
    assert status(out).finished


def reached(out: Path, parts: int) -> bool:
    """Whether a run has begun and has so many parts."""
    return (out / PLAN).exists() and len(list(out.glob(f"{PARTS}/[0-9a-f]*.parquet"))) >= parts


def test_a_run_whose_plan_is_lost_goes_on(tmp_path: Path) -> None:
    """As where its folder was cleared while it ran: it was taken for scores, and refused."""
    before = run(SUITE, tmp_path, NOBODY).table
    (tmp_path / PLAN).unlink()
    with pytest.raises(InputError, match="parts of a run; give the same `malus run` again"):
        status(tmp_path)
    again = run(SUITE, tmp_path, NOBODY)
    assert again.run["families_taken_over"] == again.run["families"]
    pd.testing.assert_frame_equal(again.table, before, check_exact=True)
    assert status(tmp_path).finished


@pytest.mark.parametrize(
    ("number", "code", "options"),
    [
        (signal.SIGINT, 130, ()),
        (signal.SIGTERM, 143, ()),
        (signal.SIGHUP, 129, ()),
        (signal.SIGINT, 130, ("--workers", "2")),
    ],
    ids=["SIGINT", "SIGTERM", "SIGHUP", "SIGINT with workers"],
)
def test_a_stop_is_one_line_and_leaves_nothing_half_written(
    tmp_path: Path, number: signal.Signals, code: int, options: tuple[str, ...]
) -> None:
    if options:
        pytest.importorskip("distributed", reason="Dask is not installed")
    process = start("run", "quick", "--samples", "8192", "--out", str(tmp_path), *options)
    wait_for(lambda: any(tmp_path.glob(f"{PARTS}/[0-9a-f]*.parquet")), process)
    # As a terminal does, to all processes of the command.
    os.killpg(process.pid, number)
    exit_code, errors = end(process)
    assert exit_code == code, errors
    assert errors.splitlines()[-1] == "malus: stopped; the same command goes on where it was"
    assert "Traceback" not in errors
    assert not [name for name in files(tmp_path) if ".part-" in name]
    assert not status(tmp_path).finished
    assert status(tmp_path).done >= 1


def test_two_runs_in_one_folder_do_not_harm_each_other(tmp_path: Path, uninterrupted: Path) -> None:
    script = (
        "import json, sys; from malus.bench import run; from malus.scenes import Suite\n"
        "run(Suite.parse(json.loads(sys.argv[1]), ''), sys.argv[2])"
    )
    command = [sys.executable, "-c", script, SMALL.model_dump_json(), str(tmp_path)]
    both = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    for process in both:
        assert end(process) == (0, "")
    assert_same_results(tmp_path, uninterrupted)
    assert not [name for name in files(tmp_path) if ".part-" in name]


def test_two_suites_at_once_in_one_folder_are_refused(tmp_path: Path) -> None:
    other = SUITE.model_copy(update={"methods": ("eq8",)})

    def meanwhile(tasks: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        with pytest.raises(InputError, match="found another suite's; choose another `out`"):
            run(other, tmp_path, NOBODY)
        with pytest.raises(InputError, match="found a run; choose another `out`"):
            render_dataset(SUITE, tmp_path, NOBODY)
        run(SUITE, tmp_path, NOBODY)
        yield from in_this_process(NOBODY)(tasks)

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
        for task, result in in_this_process(NOBODY)(source):
            tasks.append(task)
            yield task, result

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
    render = malus.bench.running.truths.render_torrance_sparrow

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
        patch.setattr("malus.bench.running.truths.render_torrance_sparrow", fails_on(bad, calls))
        results = run(SUITE, tmp_path / "bad", NOBODY)
        assert len(calls) == 4
        assert run(SUITE, tmp_path / "bad", NOBODY).run["families_failed"] == 1
        assert len(calls) == 4, "a failure is remembered"
    rest = good.table[good.table.scene != bad].reset_index(drop=True)
    # Names are categories, of which the table without a failure has more.
    names = dict.fromkeys(rest.select_dtypes("category"), "str")
    kept = results.table.astype(names)
    pd.testing.assert_frame_equal(kept, rest.astype(names), check_exact=True)
    assert (results.run["families"], results.run["families_failed"]) == (2, 1)
    assert results.run["failures"] == ["ZeroDivisionError: made up\\non two lines"]
    progress = status(tmp_path / "bad")
    assert (progress.done, progress.failed_families, progress.left) == (1, 1, 0)
    assert progress.finished
    assert [why.scene for _, why in progress.failed] == [bad]
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
    (reason,) = set(results.run["failures"])
    assert re.fullmatch(r"RuntimeError \(test_robust.py, line \d+\): broken", reason)
    assert {why.method for _, why in status(tmp_path / "bad").failed} == {"broken"}
    assert run(SUITE, tmp_path / "bad", NOBODY).run["families_failed"] == 0


def test_a_wrong_input_is_tried_again_and_no_row_at_all_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(_: Scene) -> object:
        raise InputError("mesh.obj", "a mesh", "none", "mend it")

    with monkeypatch.context() as patch:
        patch.setattr("malus.bench.running.truths.render_torrance_sparrow", refuses)
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

    monkeypatch.setattr("malus.bench.running.truths.render_torrance_sparrow", wraps)
    with pytest.raises(KeyboardInterrupt):
        run(SUITE, tmp_path, NOBODY)
    assert not list((tmp_path / PARTS).glob("*"))


def test_status_counts_what_is_left_and_refuses_what_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="neither"):
        status(tmp_path)

    def stops(source: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        yield next(in_this_process(NOBODY)(source))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(SUITE, tmp_path, NOBODY, engine=stops)
    progress = status(tmp_path).as_json()
    assert (progress["total"], progress["done"], progress["left"], progress["finished"]) == (
        2,
        1,
        1,
        False,
    )
    listed = json.loads((tmp_path / PLAN).read_text("utf-8"))
    listed["families"][0]["id"] = "../../etc/passwd"
    (tmp_path / PLAN).write_text(json.dumps(listed), "utf-8")
    with pytest.raises(InputError, match="the plan of a run"):
        status(tmp_path)


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
