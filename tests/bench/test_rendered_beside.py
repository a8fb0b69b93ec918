"""One process renders and others score, as where a graphics card renders: the same results.

A card is not needed: what it renders comes back as arrays, so that any variant stands in for it.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rooms import needs_arrays
from runs import NOBODY, SMALL, SUITE, share_at_once

from malus.bench.running import sharing, work
from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.plan import plan
from malus.bench.running.results import read_results
from malus.bench.running.runner import run
from malus.bench.running.work import Engine, in_this_process, in_worker_process, rendered_beside
from malus.bench.running.worker_process import Died, WorkerProcess
from malus.renderers.variant import Variant, choose
from malus.scenes.core.result_files import EXAMPLES
from malus.scenes.suite import Suite

TORUS = {"kind": "torus", "major": 0.62, "minor": 0.36, "tilt_deg": 65}
CHECKER = {
    "pattern": {"kind": "checker", "size": 0.5},
    "parts": [{"alpha": 0.1, "albedo": 0.2}, {"alpha": 0.3, "albedo": 0.7}],
}
ONE_LIGHT: dict[str, Any] = {"lights": [{"kind": "distant", "incidence_deg": 40}]}
DEEP = {"samples": 2, "seed": 1, "max_depth": 4}


def suite_of(base: Suite = SMALL, **changes: Any) -> Suite:
    return Suite.parse(base.model_dump(mode="json") | changes, "tests")


SUITES = {
    "plain": suite_of(),
    "formulas": SUITE,
    "metrics and ladder": suite_of(knowledge="ladder", metrics=["polarisation"], **ONE_LIGHT),
    "as many samples as needed": suite_of(sampling={"samples": 64, "seed": 1, "target": 0.2}),
}
OF_ARRAYS = {
    "pattern": suite_of(surfaces=[CHECKER], shapes=[TORUS], **ONE_LIGHT),
    "bouncing light": suite_of(sampling=DEEP, shapes=[TORUS], **ONE_LIGHT),
    "one by one": suite_of(sampling=DEEP, shapes=[TORUS], surfaces=[CHECKER], **ONE_LIGHT),
}


def beside(stack: ExitStack, variant: Variant) -> tuple[Engine, list[WorkerProcess]]:
    """Engine of one process that renders and two that score; the processes in this order."""
    workers = [stack.enter_context(WorkerProcess(120)) for _ in range(3)]
    return rendered_beside(variant, workers[0], workers[1:]), workers


def both(suite: Suite, folder: Path, variant: Variant) -> list[bool]:
    """Run a suite in this process and in three, compare, and tell in which Mitsuba is loaded."""
    run(suite, folder / "alone", variant, engine=in_this_process(variant))
    with ExitStack() as stack:
        engine, workers = beside(stack, variant)
        run(suite, folder / "apart", variant, engine=engine)
        loaded = [loaded for each in workers for loaded in each.stream(has_mitsuba)]
    assert_the_same(folder / "alone", folder / "apart")
    return loaded


def has_mitsuba() -> Iterator[bool]:
    yield "mitsuba" in sys.modules


def assert_the_same(expected: Path, found: Path) -> None:
    """All values of two runs, their failures, and the images of their examples."""
    first, second = read_results(expected), read_results(found)
    pd.testing.assert_frame_equal(second.table, first.table, check_exact=True)
    assert second.run["failures"] == first.run["failures"]
    names = sorted(path.name for path in (expected / EXAMPLES).iterdir())
    assert names == sorted(path.name for path in (found / EXAMPLES).iterdir())
    for name in names:
        with np.load(expected / EXAMPLES / name) as one, np.load(found / EXAMPLES / name) as two:
            assert one.files == two.files
            for image in one.files:
                np.testing.assert_array_equal(two[image], one[image], image)


@pytest.mark.parametrize("name", SUITES)
def test_results_are_the_same_to_the_bit(name: str, tmp_path: Path) -> None:
    # Who scores never loads the renderer; formulas need none.
    assert both(SUITES[name], tmp_path, choose()) == [name != "formulas", False, False]
    stages = read_results(tmp_path / "apart").run["seconds"]
    assert stages["render"] > 0
    assert min(stages["reconstruct"], stages["score"]) > 0


@needs_arrays
@pytest.mark.parametrize("name", OF_ARRAYS)
def test_renders_of_several_surfaces_and_bounces_are_the_same(name: str, tmp_path: Path) -> None:
    """Of scenes that are rendered one by one the process that renders has the scores, too."""
    assert both(OF_ARRAYS[name], tmp_path, choose()) == [True, False, False]
    assert read_results(tmp_path / "apart").run["seconds"]["render"] > 0


def test_what_cannot_be_rendered_costs_its_family(tmp_path: Path) -> None:
    """The scalar variant refuses polarised lamps."""
    lamp = {"kind": "distant", "incidence_deg": 40}
    polarised = lamp | {"polarised": {"degree": 1.0, "angle_deg": 30}}
    both(suite_of(lights=[lamp, polarised]), tmp_path, NOBODY)
    record = read_results(tmp_path / "apart").run
    assert record["families_failed"] == record["families"] / 2
    assert all("polarised light" in reason for reason in record["failures"])


@pytest.mark.parametrize("which", [0, 1])
def test_a_process_that_died_is_replaced(which: int, tmp_path: Path) -> None:
    """The one that renders, or one that scores, as after the kernel killed it for memory."""
    run(SMALL, tmp_path / "whole", NOBODY, engine=in_this_process(NOBODY))
    with ExitStack() as stack:
        engine, workers = beside(stack, NOBODY)
        (pid,) = workers[which].stream(own_pid)
        os.kill(pid, signal.SIGKILL)
        run(SMALL, tmp_path / "killed", NOBODY, engine=engine)
        assert list(workers[which].stream(own_pid)) != [pid]
    assert_the_same(tmp_path / "whole", tmp_path / "killed")


def own_pid() -> Iterator[int]:
    yield os.getpid()


def dies(*_: object) -> Iterator[FamilyResult]:
    os.kill(os.getpid(), signal.SIGKILL)
    yield FamilyResult()


def test_a_render_that_kills_its_process_is_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work, "_rendered", dies)
    with ExitStack() as stack:
        engine, _ = beside(stack, NOBODY)
        results = [result for _, result in engine(tasks()[:1])]
    (failure,) = results[0].failures
    assert failure.reason == "the process that did it died of SIGKILL, 2 times"


def tasks() -> list[FamilyTask]:
    families = plan(SMALL)
    return [FamilyTask(family.id, family, "mitsuba", {"eq8": "eq8"}) for family in families]


def sleeps(*_: object) -> Iterator[FamilyResult]:
    time.sleep(60)
    yield FamilyResult()


def test_a_stop_ends_what_is_rendered_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """As by Ctrl-C, while those that score wait for their turn."""

    def stopped(source: Iterable[FamilyTask]) -> Iterator[FamilyTask]:
        yield from source
        raise KeyboardInterrupt

    with ExitStack() as stack:
        engine, workers = beside(stack, NOBODY)
        for worker in workers:
            list(worker.stream(own_pid))
        monkeypatch.setattr(work, "_rendered", sleeps)
        began = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            list(engine(stopped(tasks()[:3])))
        assert time.monotonic() - began < 30  # half of what one family would take
        with pytest.raises(Died, match="given up"):
            list(workers[0].stream(own_pid))


def test_a_run_on_a_card_has_one_more_process_than_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    share_at_once(monkeypatch, 2)
    started: list[Counted] = []

    class Counted(WorkerProcess):
        def __init__(self, timeout: float) -> None:
            super().__init__(timeout)
            started.append(self)

    monkeypatch.setattr(sharing, "WorkerProcess", Counted)
    monkeypatch.setattr(work, "on_a_card", lambda variant: True)
    run(SMALL, tmp_path / "alone", NOBODY, engine=in_this_process(NOBODY))
    with WorkerProcess(120) as worker:
        engine = in_worker_process(NOBODY, worker)
        run(SMALL, tmp_path / "run", NOBODY, engine=engine)
    assert len(started) == 2
    assert_the_same(tmp_path / "alone", tmp_path / "run")
