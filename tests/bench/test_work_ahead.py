"""Families that are begun while the one before is scored: the same results, each rendered once."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from malus.bench.datasets import render
from malus.bench.running import truths
from malus.bench.running.family_task import FamilyTask
from malus.bench.running.plan import FamilyPlan, plan
from malus.bench.running.runner import in_working_order
from malus.bench.running.work import work
from malus.bench.running.worker_process import WorkerProcess
from malus.renderers.families.family import begin_family
from malus.renderers.mitsuba import wavefront
from malus.renderers.mitsuba.wavefront import STAGES
from malus.renderers.variant import choose
from malus.scenes import Camera, Dielectric, Sampling, Scene, Sphere, Suite, Uniform

METHODS = {"unpolarised": "unpolarised", "eq8": "eq8"}


@pytest.fixture(autouse=True)
def nothing_begun() -> Iterator[None]:
    truths._begun.cache_clear()
    yield
    truths._begun.cache_clear()


@pytest.fixture
def families() -> list[FamilyPlan]:
    return planned()


def planned(**more: Any) -> list[FamilyPlan]:
    data: dict[str, Any] = {
        "name": "ahead",
        "shapes": [{"kind": "sphere"}, {"kind": "torus"}],
        "materials": [{"eta": 1.3}, {"eta": 1.5}],
        "surfaces": ["obsidian"],
        "lights": [{"kind": "uniform"}, {"kind": "distant", "incidence_deg": 60}],
        "wavelengths_nm": [550],
        "methods": list(METHODS),
        "camera": {"resolution": 12},
        "sampling": {"samples": 4},
    }
    return plan(Suite.model_validate(data | more))


def tasks(families: list[FamilyPlan]) -> list[FamilyTask]:
    return [
        FamilyTask(str(number), family, "mitsuba", METHODS, following=following)
        for number, (family, following) in enumerate(
            zip(families, [*families[1:], None], strict=True)
        )
    ]


def table(task: FamilyTask, ahead: bool) -> pd.DataFrame:
    result = work(task, choose(), ahead=ahead)
    assert result.table is not None
    assert not result.failures
    return result.table


def test_a_family_begun_ahead_is_the_same_to_the_bit_and_begun_once(
    families: list[FamilyPlan], monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = [table(replace(task, following=None), ahead=False) for task in tasks(families)]
    begun: list[str] = []

    def counted(scenes: Any, *rest: Any, **options: Any) -> Callable[[], Any]:
        begun.append(scenes[0].id)
        return begin_family(scenes, *rest, **options)

    monkeypatch.setattr(truths, "begin_family", counted)
    for number, (task, expected) in enumerate(zip(tasks(families), plain, strict=True)):
        pd.testing.assert_frame_equal(table(task, ahead=True), expected, check_exact=True)
        # Its own, and the one that follows.
        assert len(begun) == min(number + 2, len(families))
    assert begun == [family.scenes[0].id for family in families]


def test_a_fault_ahead_is_told_by_the_family_that_it_concerns(
    families: list[FamilyPlan], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(scenes: Any, *rest: Any, **options: Any) -> Callable[[], Any]:
        if scenes == families[1].scenes:
            raise RuntimeError("no such kernel")
        return begin_family(scenes, *rest, **options)

    monkeypatch.setattr(truths, "begin_family", broken)
    first, second, third, _ = tasks(families)
    table(first, ahead=True)
    (failure,) = work(second, choose(), ahead=True).failures
    assert "no such kernel" in failure.reason
    table(third, ahead=True)


def test_what_failed_at_its_end_is_begun_anew(
    families: list[FamilyPlan], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its end was asked for twice, which may be whole the second time, with what was warned of."""
    begun: list[str] = []

    def broken_once(scenes: Any, *rest: Any, **options: Any) -> Callable[[], Any]:
        begun.append(scenes[0].id)
        finish = begin_family(scenes, *rest, **options)

        def end() -> Any:
            if len(begun) == 1:
                raise RuntimeError("not to be trusted")
            return finish()

        return end

    task = replace(tasks(families)[0], following=None)
    expected = table(task, ahead=False)
    truths._begun.cache_clear()
    monkeypatch.setattr(truths, "begin_family", broken_once)
    (failure,) = work(task, choose()).failures
    assert "not to be trusted" in failure.reason
    pd.testing.assert_frame_equal(table(task, ahead=False), expected, check_exact=True)
    assert len(begun) == 2


def test_shapes_that_do_not_all_stay_loaded_come_one_after_the_other(
    families: list[FamilyPlan],
) -> None:
    """A tree costs more than a table, and tables are kept; the results keep the plan's order."""
    assert in_working_order(families) == families
    many = planned(
        shapes=[{"kind": "blob", "seed": seed} for seed in range(STAGES + 1)],
        surfaces=["obsidian", "carbon"],
    )
    worked = in_working_order(many)
    assert sorted(family.id for family in worked) == sorted(family.id for family in many)
    shapes = [family.scenes[0].shape for family in worked]
    changes = sum(one != other for one, other in itertools.pairwise(shapes))
    assert changes == STAGES
    assert worked != many


@pytest.mark.skipif(not choose().vectorised, reason="one kernel after the other needs LLVM or CUDA")
def test_what_is_rendered_meanwhile_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A family of several kernels: the later ones start when others set the same BSDFs."""
    monkeypatch.setattr(wavefront, "PIXELS_A_LAUNCH", 32)
    scenes = [
        Scene(
            shape=Sphere(),
            surface=Dielectric(eta=eta, alpha=alpha),
            light=Uniform(),
            camera=Camera(resolution=13),
        )
        for eta, alpha in ((1.5, 0.1), (1.4, 0.4))
    ]
    sampling = Sampling(samples=4)
    alone = [begin_family([scene], sampling)().truth(scene) for scene in scenes]
    begun = [begin_family([scene], sampling) for scene in scenes]
    for scene, expected, wait in zip(scenes, alone, begun, strict=True):
        truth = wait().truth(scene)
        for name in ("specular", "diffuse", "standard_error"):
            np.testing.assert_array_equal(getattr(truth, name), getattr(expected, name))


class Seen(Exception):
    """The test has what it wanted."""


def has_mitsuba() -> Iterator[bool]:
    yield "mitsuba" in sys.modules


def test_the_renderer_is_loaded_while_a_dataset_is_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes longer than most families; the process that renders did nothing meanwhile."""
    with WorkerProcess() as worker:

        def planned_dataset(*_: object) -> None:
            assert list(worker.stream(has_mitsuba)) == [True]
            raise Seen

        monkeypatch.setattr(render, "planned_dataset", planned_dataset)
        with pytest.raises(Seen):
            render.render_dataset("quick", tmp_path / "dataset", worker=worker)
