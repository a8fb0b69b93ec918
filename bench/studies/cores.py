"""Benchmark of cores: a reduced fig5 on one core, two, … and all, and what bounds the speed-up.

It takes the way of `malus run`, which shares families out among a process a core; where a graphics
card renders, these score what one more process renders on it. They and this one may use these cores
only. A run of other surfaces and few samples goes before in each, so that neither start nor
compilation count; nor does the report.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from malus.bench.running.runner import run
from malus.bench.running.sharing import cpu_processes, on_a_card
from malus.bench.running.work import Engine, in_worker_processes, rendered_beside
from malus.bench.running.worker_process import WorkerProcess
from malus.bench.studies.study import Findings
from malus.renderers.variant import Variant, choose
from malus.scenes.core.cores import usable_cores
from malus.scenes.core.errors import InputError
from malus.scenes.suite import Suite, load_suite

OTHER = "planning, tables and files"
"""What is left of a run besides the stages that it counts."""

_THREADS = ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class CoresSpeed:
    """Time of the same run on a number of cores.

    Attributes
    ----------
    seconds, processor_seconds : float
        By the clock, and of all cores together.
    stages : dict of stage to seconds by the clock
        Where several processes do a stage at once, the mean over these. What one process renders
        for all of them counts likewise, as their mean wait for it.
    """

    cores: int
    seconds: float
    processor_seconds: float
    stages: dict[str, float]


def findings(
    folder: Path | None, most: int, resolution: int, samples: int, every: int, backend: str
) -> Findings:
    """Run the benchmark on one core, two, … and the most; 0 for all that may be used."""
    suite = reduced_fig5(resolution, samples, every)
    speeds = measure(suite, choose(backend), numbers_of_cores(most or usable_cores()))
    return Findings(tuple(report_lines(speeds)), figures(speeds))


def reduced_fig5(resolution: int, samples: int, every: int) -> Suite:
    """Figure 5 with two of its shapes, two of its lights, and every n-th of its materials.

    Examples
    --------
    >>> suite = reduced_fig5(resolution=8, samples=2, every=12)
    >>> len(list(suite.scenes()))
    40
    """
    data: dict[str, Any] = load_suite("fig5").model_dump(mode="json")
    shapes, lights = data["shapes"], data["lights"]
    data |= {
        "name": "cores",
        "shapes": [shapes[0], shapes[-1]],
        "lights": [lights[0], lights[3]],
        "materials": data["materials"][::every],
        "camera": data["camera"] | {"resolution": resolution},
        "sampling": data["sampling"] | {"samples": samples},
    }
    return Suite.parse(data, "malus bench cores")


def numbers_of_cores(most: int) -> list[int]:
    """One core, two, four, … and the most.

    Examples
    --------
    >>> numbers_of_cores(1), numbers_of_cores(2), numbers_of_cores(12)
    ([1], [1, 2], [1, 2, 4, 8, 12])
    """
    return sorted({*(1 << k for k in range(most.bit_length()) if 1 << k <= most), most})


def measure(suite: Suite, variant: Variant, cores: Sequence[int]) -> list[CoresSpeed]:
    """Run a suite on each number of cores, one after the other.

    Raises
    ------
    InputError
        Where a process cannot be kept to some cores, or for more than it may use.
    """
    if not hasattr(os, "sched_setaffinity"):
        raise InputError("study cores", "Linux", os.name, "only there a process is kept to cores")
    if max(cores) > usable_cores():
        found = f"{usable_cores()} that may be used"
        raise InputError("most", f"{max(cores)} cores", found, "ask for fewer")
    return [_measured(suite, variant, count) for count in cores]


@contextmanager
def _only(cores: int) -> Iterator[None]:
    """Keep processes that are started by this thread to so many cores, and their threads too."""
    allowed, before = os.sched_getaffinity(0), dict(os.environ)
    os.sched_setaffinity(0, sorted(allowed)[:cores])
    os.environ.update(dict.fromkeys(_THREADS, str(cores)))
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)
        for name in _THREADS:
            if name in before:
                os.environ[name] = before[name]
            else:
                del os.environ[name]


def _measured(suite: Suite, variant: Variant, cores: int) -> CoresSpeed:
    """Time of one run on so many cores, after one to warm up each process."""
    with _only(cores), ExitStack() as stack:
        count = min(cores, cpu_processes())
        workers = [stack.enter_context(WorkerProcess()) for _ in range(count)]
        engine_of = partial(in_worker_processes, variant)
        started = list(workers)
        if count > 1 and on_a_card(variant):
            started.append(stack.enter_context(WorkerProcess()))
            engine_of = partial(rendered_beside, variant, started[-1])
        for worker in workers:
            _run(_warm_up(suite), variant, engine_of([worker]))
        clock, processor = time.perf_counter(), _processor_seconds(started)
        summed = _run(suite, variant, engine_of(workers))
        seconds = time.perf_counter() - clock
        busy = _processor_seconds(started) - processor
    stages = {stage: value / count for stage, value in summed.items()}
    stages[OTHER] = seconds - sum(stages.values())
    return CoresSpeed(cores, seconds, busy, stages)


def _processor_seconds(workers: Sequence[WorkerProcess]) -> float:
    """Processor seconds of this process and of its workers, so far."""
    return time.process_time() + sum(sum(worker.stream(_own_seconds)) for worker in workers)


def _own_seconds() -> Iterator[float]:
    yield time.process_time()


def _warm_up(suite: Suite) -> Suite:
    """A small suite with the same kernels and other surfaces: no table of its serves again."""
    data = suite.model_dump(mode="json")
    data |= {
        "surfaces": [{"alpha": 0.37}],
        "camera": data["camera"] | {"resolution": 8},
        "sampling": data["sampling"] | {"samples": 2},
    }
    return Suite.parse(data, "malus bench cores")


def _run(suite: Suite, variant: Variant, engine: Engine) -> dict[str, float]:
    """Seconds of each stage of a run in worker processes, added up over these."""
    with tempfile.TemporaryDirectory() as folder:
        results = run(suite, folder, variant, engine=engine)
        seconds: dict[str, float] = dict(results.run["seconds"])
    return {stage: value for stage, value in seconds.items() if stage != "total"}


def figures(speeds: Sequence[CoresSpeed]) -> list[dict[str, Any]]:
    """The figures of each run, with its speed-up over the first and how many cores were busy."""
    first = speeds[0]
    return [
        asdict(speed)
        | {
            "speed_up": first.seconds / speed.seconds,
            "busy": speed.processor_seconds / speed.seconds,
        }
        for speed in speeds
    ]


def bound(first: CoresSpeed, last: CoresSpeed) -> str:
    """What keeps a run on more cores from being as many times faster, in a sentence.

    Examples
    --------
    >>> one = CoresSpeed(1, 10.0, 10.0, {"render": 6.0, "score": 4.0})
    >>> two = CoresSpeed(2, 7.0, 10.5, {"render": 3.0, "score": 4.0})
    >>> bound(one, two)[:62]
    '2 cores could save 5.0 s of 10.0 s and save 3.0 s; lost: score'
    """
    ideal = first.cores / last.cores
    lost = {
        stage: last.stages.get(stage, 0.0) - seconds * ideal
        for stage, seconds in first.stages.items()
    }
    worst = sorted((stage for stage in lost if lost[stage] > 0), key=lambda stage: -lost[stage])
    losses = ", ".join(f"{stage} {lost[stage]:.1f} s" for stage in worst) or "nothing"
    more = last.processor_seconds / first.processor_seconds
    return (
        f"{last.cores} cores could save {first.seconds * (1 - ideal):.1f} s of {first.seconds:.1f}"
        f" s and save {first.seconds - last.seconds:.1f} s; lost: {losses}. They work"
        f" {more:.2f}x as long together, and {last.processor_seconds / last.seconds:.1f} are busy"
        " on average: what is lost waits for one thread where few are busy, and for memory or locks"
        " where more work is done"
    )


def report_lines(speeds: Sequence[CoresSpeed]) -> list[str]:
    """A table with a line for each number of cores, and what bounds the last, for people."""
    stages = list(speeds[0].stages)
    lines = []
    for row in figures(speeds):
        parts = ", ".join(f"{stage} {row['stages'].get(stage, 0.0):.1f}" for stage in stages)
        lines.append(
            f"{row['cores']:3d} cores: {row['seconds']:6.1f} s, {row['speed_up']:.2f}x,"
            f" {row['busy']:.1f} busy; {parts}"
        )
    return [*lines, bound(speeds[0], speeds[-1])] if len(speeds) > 1 else lines
