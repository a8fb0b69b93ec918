"""Benchmark of many scenes: the cost of planning, tables, files, messages and memory.

A made-up engine stands in for the renderer: it returns the table of one family that was really
scored, with the names of the scenes changed. Everything else is what `malus run` does.
"""

from __future__ import annotations

import pickle
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from malus.bench.running.cluster import cluster_client
from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.plan import plan
from malus.bench.running.progress import peak_memory
from malus.bench.running.runner import run
from malus.bench.running.work import work
from malus.bench.running.worker_process import WorkerProcess
from malus.bench.studies.study import Findings
from malus.renderers.variant import Variant
from malus.scenes.suite import Suite

FAMILY = 24
"""Scenes of a family, as in fig5."""

_NO_RENDERER = Variant("scalar_spectral_polarized", "nothing is rendered")
_MEGABYTE = 1e6


@dataclass(frozen=True)
class Scale:
    """Cost of a run of so many scenes besides rendering and scoring.

    `memory_mb` is the peak of the whole process, of which `start_mb` were in use before.
    """

    scenes: int
    plan_seconds: float
    run_seconds: float
    store_mb: float
    start_mb: float
    memory_mb: float


@dataclass(frozen=True)
class Messages:
    """Bytes and seconds that pass through a scheduler for a family of `FAMILY` scenes."""

    task_bytes: int
    result_bytes: int
    seconds: float


def findings(folder: Path | None, most: int) -> Findings:
    """Run the benchmark on a hundredth, a tenth and all of so many scenes."""
    counts = sorted({max(24, most // share) for share in (100, 10, 1)})
    scales, messaging = measure(counts), messages()
    figures = [asdict(scale) for scale in scales] + [asdict(messaging)]
    return Findings(tuple(report_lines(scales, messaging)), figures)


def made_up_suite(scenes: int) -> Suite:
    """A suite of at least so many scenes in families of `FAMILY`.

    Examples
    --------
    >>> len(list(made_up_suite(100).scenes()))
    120
    """
    families = -(-scenes // FAMILY)
    data = {
        "name": "scaling",
        "shapes": [{"kind": "sphere"}],
        "materials": [{"eta": 1.3 + 0.02 * k} for k in range(FAMILY)],
        "surfaces": [{"alpha": 0.05 + 0.9 * k / families} for k in range(families)],
        "lights": [{"kind": "distant", "incidence_deg": 60}],
        "wavelengths_nm": [450, 550, 650],
        "methods": ["unpolarised", "eq8", "half_vector", "half_vector+body"],
        "renderer": "torrance-sparrow",
        "camera": {"resolution": 8},
    }
    return Suite.parse(data, "malus bench scaling")


def measure(scenes: Sequence[int]) -> list[Scale]:
    """Measure a run of made-up results for each number of scenes, in a process of its own."""
    scales = []
    for count in scenes:
        with WorkerProcess() as worker:
            scales += list(worker.stream(_measured, count))
    return scales


def messages(families: int = 200) -> Messages:
    """Measure tasks and results that pass through a scheduler to two workers that do nothing."""
    suite = made_up_suite(FAMILY)
    task = _task(suite)
    result = work(task, _NO_RENDERER)
    with cluster_client(2, None) as client:
        scattered = client.scatter(result, broadcast=True)
        client.gather([client.submit(_answer, task, scattered, k) for k in range(4)])
        started = time.perf_counter()
        client.gather([client.submit(_answer, task, scattered, -k - 1) for k in range(families)])
        seconds = (time.perf_counter() - started) / families
    return Messages(len(pickle.dumps(task)), len(pickle.dumps(result)), seconds)


def report_lines(scales: Sequence[Scale], carried: Messages) -> list[str]:
    """Lines of a table, with 1e5 and 1e6 scenes extrapolated from the largest two."""
    lines = [
        f"{'scenes':>9} {'plan':>8} {'tables':>9} {'store':>10} {'memory':>10} {'scheduler':>10}"
    ]
    measured = [(scale, "") for scale in scales]
    beyond = [(_extrapolated(scales[-2], scales[-1], n), "  (drawn on)") for n in (10**5, 10**6)]
    for scale, note in measured + beyond:
        busy = carried.seconds * scale.scenes / FAMILY
        lines.append(
            f"{scale.scenes:9d} {scale.plan_seconds:6.1f} s {scale.run_seconds:7.1f} s "
            f"{scale.store_mb:7.1f} MB {scale.memory_mb:7.0f} MB {busy:8.1f} s{note}"
        )
    lines.append(
        f"a family of {FAMILY}: {carried.task_bytes / 1e3:.1f} kB to the worker, "
        f"{carried.result_bytes / 1e3:.0f} kB back, {1e3 * carried.seconds:.1f} ms of the scheduler"
    )
    return lines


def _extrapolated(smaller: Scale, larger: Scale, scenes: int) -> Scale:
    """Cost of so many scenes, on the straight line through two that were measured.

    No cost falls with more scenes: where the larger run happened to need less, the line is level.
    """
    factor = (scenes - larger.scenes) / (larger.scenes - smaller.scenes)

    def extrapolate(name: str) -> float:
        last = getattr(larger, name)
        return float(last + factor * max(last - getattr(smaller, name), 0.0))

    names = ("plan_seconds", "run_seconds", "store_mb", "start_mb", "memory_mb")
    return Scale(scenes, **{name: extrapolate(name) for name in names})


def _measured(scenes: int) -> Iterator[Scale]:
    suite = made_up_suite(scenes)
    template = work(_task(suite), _NO_RENDERER)
    start = peak_memory() / _MEGABYTE
    started = time.process_time()
    families = plan(suite)
    planned = time.process_time() - started
    count = sum(len(family.scenes) for family in families)
    del families
    with tempfile.TemporaryDirectory() as folder:
        started = time.process_time()
        run(suite, folder, _NO_RENDERER, engine=lambda tasks: _made_up(tasks, template))
        seconds = time.process_time() - started - planned
        size = sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
    yield Scale(count, planned, seconds, size / _MEGABYTE, start, peak_memory() / _MEGABYTE)


def _task(suite: Suite) -> FamilyTask:
    family = plan(suite)[0]
    return FamilyTask("0" * 16, family, suite.renderer, {name: name for name in suite.methods})


def _made_up(
    tasks: Iterable[FamilyTask], template: FamilyResult
) -> Iterator[tuple[FamilyTask, FamilyResult]]:
    """Engine that answers every task with the template's table, under the task's scenes."""
    assert template.table is not None
    scene_ids = list(template.table.scene.unique())
    for task in tasks:
        names = dict(zip(scene_ids, (scene.id for scene in task.family.scenes), strict=True))
        table = template.table.assign(scene=template.table.scene.map(names))
        table.attrs = dict(template.table.attrs)
        yield task, FamilyResult(table)


def _answer(task: FamilyTask, result: FamilyResult, _: int) -> Any:
    return result
