"""The study of cores on a tiny size: its figures belong together. No time is judged here."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from malus.bench.running import sharing
from malus.bench.running.worker_process import WorkerProcess
from malus.bench.studies import cores
from malus.renderers.variant import Variant, choose
from malus.scenes import InputError
from malus.scenes.core.cores import usable_cores


def test_figures_of_a_tiny_run() -> None:
    suite = cores.reduced_fig5(resolution=4, samples=2, every=24)
    suite = suite.model_copy(update={"shapes": suite.shapes[:1], "surfaces": suite.surfaces[:1]})
    speeds = cores.measure(suite, choose(), [1, 1])
    for speed in speeds:
        assert speed.cores == 1
        assert speed.processor_seconds > 0.0
        assert sum(speed.stages.values()) == pytest.approx(speed.seconds)
        assert {"render", "reconstruct", "score", cores.OTHER} <= set(speed.stages)
    first, second = cores.figures(speeds)
    assert first["speed_up"] == 1.0
    assert second["speed_up"] == pytest.approx(first["seconds"] / second["seconds"])
    assert len(cores.report_lines(speeds)) == 3


def test_what_bounds_more_cores_is_named_first() -> None:
    one = cores.CoresSpeed(1, 10.0, 10.0, {"render": 4.0, "score": 4.0, "files": 2.0})
    four = cores.CoresSpeed(4, 5.0, 12.0, {"render": 1.0, "score": 3.0, "files": 1.0})
    words = cores.bound(one, four)
    # Ideal would be 1.0, 1.0 and 0.5 s.
    assert "could save 7.5 s of 10.0 s and save 5.0 s; lost: score 2.0 s, files 0.5 s." in words
    assert "1.20x as long together, and 2.4 are busy" in words


def what_it_may_use() -> Iterator[tuple[int, str]]:
    yield usable_cores(), os.environ["NUMBA_NUM_THREADS"]


def test_a_process_keeps_to_its_cores_and_this_one_does_not() -> None:
    before = os.sched_getaffinity(0), dict(os.environ)
    with cores._only(1), WorkerProcess() as worker:
        assert list(worker.stream(what_it_may_use)) == [(1, "1")]
    assert (os.sched_getaffinity(0), dict(os.environ)) == before


def test_where_a_card_renders_one_more_process_does_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a run: as many processes are timed as one would start."""
    begun: list[tuple[int, int]] = []

    def beside(variant: Variant, renderer: WorkerProcess, workers: list[WorkerProcess]) -> None:
        begun.append((1, len(workers)))

    monkeypatch.setattr(cores, "rendered_beside", beside)
    monkeypatch.setattr(cores, "in_worker_processes", lambda _, them: begun.append((0, len(them))))
    monkeypatch.setattr(cores, "_run", lambda suite, variant, engine: {})
    monkeypatch.setattr(cores, "_processor_seconds", lambda workers: 0.0)
    monkeypatch.setattr(cores, "usable_cores", lambda: 4)
    monkeypatch.setattr(sharing, "usable_cores", lambda: 4)
    monkeypatch.setattr(sharing, "free_memory", lambda: 1e12)
    suite = cores.reduced_fig5(resolution=4, samples=2, every=24)
    cards, llvm = (Variant(f"{name}_ad_mono_polarized", "made up") for name in ("cuda", "llvm"))
    for variant, count, expected in ((cards, 4, (1, 4)), (cards, 1, (0, 1)), (llvm, 4, (0, 4))):
        cores.measure(suite, variant, [count])
        assert begun[-1] == expected


def test_more_cores_than_there_are_is_refused() -> None:
    suite = cores.reduced_fig5(resolution=4, samples=2, every=24)
    with pytest.raises(InputError, match=r"most: expected .* cores"):
        cores.measure(suite, choose("scalar"), [usable_cores() + 1])
