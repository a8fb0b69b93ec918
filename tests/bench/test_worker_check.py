"""Workers of a cluster that would give other results than this process are refused."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import Any

import pytest
from runs import NOBODY, SUITE

from malus.bench.datasets import render
from malus.bench.running import cluster
from malus.bench.running.cluster import _key, _result, spread
from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.plan import plan
from malus.bench.running.worker_check import UnfitWorker, check_workers, made_with
from malus.renderers import variant
from malus.scenes import InputError

METHOD = """
from malus.reconstruct.methods import TRIVIAL as mine
# {}
"""


@pytest.fixture
def client() -> Iterator[Any]:
    """A client of a cluster of one process, which may be spoiled."""
    pytest.importorskip("distributed", reason="Dask is not installed")
    with ExitStack() as stack:
        yield cluster._local(1, stack)


def another_mitsuba(package: str) -> str:
    return "3.7.0" if package == "mitsuba" else "0"


def takes_another_version() -> None:
    """As on a worker with another Mitsuba: made of what was looked up before, and after."""
    variant.made_by.cache_clear()
    variant.version = another_mitsuba


class Without:
    """A finder of modules where malus is not installed."""

    def find_spec(self, name: str, *_: object) -> None:
        if name.split(".")[0] == "malus":
            raise ModuleNotFoundError(f"No module named {name!r}")


def loses_malus() -> None:
    sys.meta_path.insert(0, Without())
    for name in [name for name in sys.modules if name.split(".")[0] == "malus"]:
        del sys.modules[name]


def tasks(methods: dict[str, str] | None = None) -> list[FamilyTask]:
    families = plan(SUITE)
    chosen = methods or {"eq8": "eq8"}
    return [FamilyTask(str(k), f, "torrance-sparrow", chosen) for k, f in enumerate(families)]


def test_a_worker_of_another_version_ends_the_run_before_a_task(client: Any) -> None:
    """Its renders were filed as those of this process's Mitsuba, in `run.json` too."""
    client.run(takes_another_version)
    with pytest.raises(UnfitWorker, match=r"worker tcp://.*expected malus .*, mitsuba 3\.7\.0"):
        next(spread(tasks(), client, NOBODY))


def test_one_that_comes_later_does_no_task(client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "check_workers", lambda _: client.run(takes_another_version))
    with pytest.raises(UnfitWorker, match=r"worker tcp://[^:]*:\d+, versions: expected malus"):
        next(spread(tasks(), client, NOBODY))


def test_a_worker_without_malus_is_told_and_lives(
    client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first task ended it, the next worker too, and the run then waited for ever."""
    monkeypatch.setattr(cluster, "WITHOUT_WORKERS_SECONDS", 1.0)
    before = set(client.nthreads())
    client.run(loses_malus)
    with pytest.raises(UnfitWorker, match=r"found .*No module named 'malus'"):
        next(spread(tasks(), client, NOBODY))
    assert set(client.nthreads()) == before


def test_a_worker_that_is_lost_meanwhile_is_not_refused() -> None:
    class Losing:
        def run(self, *_: object, **__: object) -> dict[str, object]:
            return {"lost": OSError("closed"), "there": variant.made_by("mitsuba")}

    check_workers(Losing())


def test_a_method_of_another_file_on_a_worker_ends_the_run(
    client: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What the worker's file made was filed under the digest of the one here."""
    for place in ("here", "there"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "of_two_places.py").write_text(METHOD.format(place))
    monkeypatch.chdir(tmp_path / "here")
    methods = {"unpolarised": "of_two_places:mine"}
    client.run(os.chdir, str(tmp_path / "here"))
    done = list(spread(tasks(methods), client, NOBODY))
    assert [result.failures for _, result in done] == [[], []]
    client.run(os.chdir, str(tmp_path / "there"))
    with pytest.raises(UnfitWorker, match=r"method unpolarised: .*of file [0-9a-f]{16}, found"):
        next(spread(tasks(methods), client, NOBODY))


def test_runs_share_no_result_of_a_method_that_has_changed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Two runs on one cluster share tasks by their keys."""
    monkeypatch.chdir(tmp_path)
    (task, _) = tasks({"unpolarised": "that_changes:mine"})
    keys = []
    for content in ("one", "other", "other"):
        (tmp_path / "that_changes.py").write_text(METHOD.format(content))
        keys.append(_key(task, made_with(task)))
    assert keys[0] != keys[1] == keys[2]


def sleeps(*_: object) -> FamilyResult:
    time.sleep(600)
    return FamilyResult()


def test_a_cluster_that_lost_all_workers_is_not_waited_for_for_ever(
    client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "_remote", sleeps)
    monkeypatch.setattr(cluster, "WITHOUT_WORKERS_SECONDS", 0.5)
    client.cluster.scale(0)
    begun = time.monotonic()  # the scheduler is told a moment later
    while client.nthreads():
        assert time.monotonic() < begun + 60
        time.sleep(0.05)
    with pytest.raises(InputError, match=r"one with a worker, found none for 0\.5 s; start `dask"):
        next(spread(tasks(), client, NOBODY))


class Elsewhere:
    """A client whose worker is in another folder."""

    def nthreads(self) -> dict[str, int]:
        return {"there": 1}


def test_workers_in_another_folder_render_into_the_same_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """They rendered into one of that name in theirs, and this process all of it again."""
    there = tmp_path / "there"
    there.mkdir()

    def spread_parts(
        render_part: Callable[[str, str], None], parts: Sequence[str], *_: object
    ) -> Iterator[str]:
        monkeypatch.chdir(there)
        for part in parts:
            render_part(part, "scalar")
        monkeypatch.chdir(tmp_path)
        yield from parts

    monkeypatch.setattr(render, "cluster_client", lambda *_: nullcontext(Elsewhere()))
    monkeypatch.setattr(render, "spread_parts", spread_parts)
    monkeypatch.chdir(tmp_path)
    done = render.render_dataset(SUITE, "out", "scalar", scheduler="there")
    assert (done["rendered"], done["taken_over"]) == (4, 0)
    assert list(there.iterdir()) == []


def test_a_worker_that_does_not_see_the_folder_says_so(tmp_path: Path) -> None:
    missing = tmp_path / "elsewhere"
    with pytest.raises(InputError, match=r"out: expected a folder that every worker sees, found"):
        render._render_part(SUITE, str(missing), False, None, "1/1", "scalar")
    assert not missing.exists()


def test_as_many_deaths_are_told_as_the_cluster_allowed() -> None:
    """Those of a cluster that was there allow four by default, and were told as three."""

    class KilledWorker(Exception):
        allowed_failures = 3

    class Future:
        status = "error"

        def exception(self) -> Exception:
            return KilledWorker()

    (failure,) = _result(Future()).failures
    assert failure.reason.startswith("4 workers died of it")
