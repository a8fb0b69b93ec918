"""Plan a suite, and run it."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

from malus.bench.datasets.maps_and_frames import Additions
from malus.bench.running import runner
from malus.bench.running.cluster import engine
from malus.bench.running.family_task import FamilyResult, FamilyTask
from malus.bench.running.inside_worker import DRAWING, import_all
from malus.bench.running.overrides import chosen_suite
from malus.bench.running.plan import FamilyPlan, OmittedWork, plan_record, savings
from malus.bench.running.plan import plan as families_of
from malus.bench.running.progress import Progress, silent
from malus.bench.running.results import Results
from malus.bench.running.work import in_worker_process
from malus.bench.running.worker_process import TIMEOUT_SECONDS, WorkerProcess
from malus.reconstruct import get_method
from malus.renderers.families.adaptive import Renders, first_samples, relative_error
from malus.renderers.families.family import render_family
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.variant import Variant, chosen_variant
from malus.scenes.core.remote import as_path
from malus.scenes.scene import Sampling
from malus.scenes.suite import Suite

BYTES_A_VALUE = 4
IMAGES_A_TRUTH = 5
"""Stokes images that a stored scene holds: both lobes, both noises, the standard error."""


@dataclass(frozen=True)
class Plan:
    """What a run of a suite will do, what it leaves out, and what that will cost.

    Attributes
    ----------
    suite : Suite
        What will be run.
    variant : Variant
        The Mitsuba variant that will render.
    families : tuple of FamilyPlan
        Scenes that differ only in refractive index, and so share their renders.
    savings : tuple of OmittedWork
        What is left out, and why nothing is lost.
    scenes : int
        Number of scenes.
    renders, renders_without_plan : int
        Images of one lobe that are rendered, and that one render for every scene, band, polariser
        angle and lobe would be.
    seconds, seconds_without_plan : float
        Predicted time of rendering on this machine.
    bytes : int
        Size of the suite as a stored dataset, before compression.

    Examples
    --------
    >>> import malus
    >>> planned = malus.plan("quick")
    >>> sum(saving.renders for saving in planned.savings) + planned.renders
    480
    """

    suite: Suite
    variant: Variant
    families: tuple[FamilyPlan, ...]
    savings: tuple[OmittedWork, ...]
    scenes: int
    renders: int
    renders_without_plan: int
    seconds: float
    seconds_without_plan: float
    bytes: int


def plan(suite: Suite | str | Path, backend: str | Variant = "auto") -> Plan:
    """What a run of a suite will do and cost; one family is rendered in miniature to tell.

    Parameters
    ----------
    suite : Suite, or the name of one that malus brings, or the path of a TOML file
    backend : 'auto', 'cuda', 'llvm' or 'scalar'

    Returns
    -------
    Plan
        Families, savings and costs.

    Raises
    ------
    InputError
        Unknown suite, method, metric or backend, unreadable file, wrong key or value.

    Examples
    --------
    >>> planned = plan("quick")
    >>> planned.scenes, len(planned.families), planned.renders < planned.renders_without_plan
    (16, 8, True)
    """
    variant = chosen_variant(backend)
    chosen = chosen_suite(suite, variant)
    for reference in chosen.methods:
        get_method(reference)
    if chosen.metrics:
        from malus.bench.scoring.extra_metrics import get_metrics

        get_metrics(chosen.metrics)
    families = families_of(chosen)
    seconds = predicted_seconds(families, variant, chosen.renderer, chosen.random is not None)
    record = plan_record(chosen, families, seconds)
    return Plan(
        suite=chosen,
        variant=variant,
        families=tuple(families),
        savings=tuple(savings(chosen, families)),
        scenes=sum(len(family.scenes) for family in families),
        renders=record["renders"],
        renders_without_plan=record["without_plan"],
        seconds=seconds,
        seconds_without_plan=record["seconds_without"],
        bytes=dataset_bytes(chosen, families),
    )


SAMPLES_OF_RANDOM = 8
"""Random scenes that are rendered to predict the time of all: rooms take longer than spheres."""


def predicted_seconds(
    families: Sequence[FamilyPlan],
    variant: Variant,
    renderer: str = "mitsuba",
    random: bool = False,
) -> float:
    """Seconds of rendering, from rendering one family on this machine, in miniature by Mitsuba.

    Of `random` scenes, which differ in all that costs time, several are rendered.
    """
    if random and renderer == "mitsuba":
        several = families[:: -(-len(families) // SAMPLES_OF_RANDOM)]
        each = [_seconds_of_random(family, variant) for family in several]
        return len(families) * sum(each) / len(each)
    sample = max(families, key=lambda family: family.specular_images)
    if renderer == "torrance-sparrow":
        started = time.perf_counter()
        for scene in sample.scenes:
            render_torrance_sparrow(scene)
        return len(families) * (time.perf_counter() - started)
    few = _few_samples(sample)
    _timed(sample, few, variant)  # compiles kernels
    seconds, rendered = _timed(sample, few, variant)
    ratio = _expected_samples(sample, rendered, few) / few.samples
    # Half of the miniature's time is work that does not grow with the samples (measured).
    return len(families) * seconds * 0.5 * (1.0 + ratio)


def _seconds_of_random(family: FamilyPlan, variant: Variant) -> float:
    """Seconds of a random scene, from few samples and more: most work does not grow with these.

    Its kernels are compiled before: those of many scenes are alike.
    """
    few = _few_samples(family)
    more = few.model_copy(update={"samples": 4 * few.samples})
    rendered = _timed(family, few, variant)[1]
    least, longer = (_timed(family, sampling, variant)[0] for sampling in (few, more))
    a_sample = max(0.0, longer - least) / (more.samples - few.samples)
    expected = _expected_samples(family, rendered, few)
    return least + a_sample * max(0.0, expected - few.samples)


def _few_samples(family: FamilyPlan) -> Sampling:
    """As the family is sampled, with a sixteenth of the samples."""
    few = {"samples": max(2, family.sampling.samples // 16 // 2 * 2), "target": None}
    return family.sampling.model_copy(update=few)


def _timed(family: FamilyPlan, sampling: Sampling, variant: Variant) -> tuple[float, Renders]:
    """Seconds of rendering a family, and its renders."""
    started = time.perf_counter()
    rendered = render_family(family.scenes, sampling, variant, errors=False)
    return time.perf_counter() - started, rendered


def _expected_samples(family: FamilyPlan, miniature: Renders, few: Sampling) -> float:
    """Samples a pixel that a family will take; noise falls as the root of their number."""
    most, target = family.sampling.samples, family.sampling.target
    if target is None:
        return most
    error = relative_error(miniature, family.scenes)
    return min(most, max(first_samples(family.sampling), few.samples * (error / target) ** 2))


def dataset_bytes(suite: Suite, families: Sequence[FamilyPlan]) -> int:
    """Bytes of the images and maps of every scene, before compression."""
    scenes, bands = sum(len(family.scenes) for family in families), len(suite.wavelengths_nm)
    values = bands * 3 * IMAGES_A_TRUTH + Additions.of(suite).values_of_a_pixel(bands)
    return scenes * suite.camera.resolution**2 * values * BYTES_A_VALUE


def run(
    suite: Suite | str | Path,
    out: Path | str | None = None,
    *,
    samples: int | None = None,
    resolution: int | None = None,
    seed: int | None = None,
    methods: Sequence[str] = (),
    metrics: Sequence[str] = (),
    backend: str | Variant = "auto",
    workers: int | None = None,
    scheduler: str | None = None,
    timeout: float | None = None,
    retry_failed: bool = False,
    report: bool = True,
    progress: Progress = silent,
    worker: WorkerProcess | None = None,
) -> Results:
    """Render, reconstruct, score and report a suite; write everything to a folder.

    Families whose results are already there, from the same suite, seed and versions, are taken
    over: a run that was stopped goes on where it was. What cannot be done is recorded
    (`Results.run["failures"]`), and the run goes on without it.

    Parameters
    ----------
    suite : Suite, or the name of one that malus brings, or the path of a TOML file
    out : path or URL of a folder, by default results/NAME
    samples, resolution, seed : int, optional
        Samples a pixel, pixels a side, and seed, in place of the suite's.
    methods : sequence of str
        Names of methods, or `package.module:object`, in place of the suite's.
    metrics : sequence of str
        Names of further metrics, besides the suite's: `list_metrics` tells them.
    backend : 'auto', 'cuda', 'llvm' or 'scalar'
    workers : int, optional
        Processes of this machine to spread over.
    scheduler : str, optional
        Address of a Dask cluster to spread over, in place of `workers`.
    timeout : float, optional
        Seconds that a family may take. With it the work is done in a process of its own, so that a
        crash of the renderer costs one family; a script that asks for this or for `workers` has to
        keep its own work under `if __name__ == "__main__":`. By default this process does all.
    retry_failed : bool
        Try again what failed in an earlier run.
    report : bool
        Write the figures, the summary and the page too.
    progress : function of (families done, families in all, label of the next)
    worker : WorkerProcess, optional
        A process that does the work, and draws figures too, where neither `workers` nor `scheduler`
        is given; its own timeout holds.

    Returns
    -------
    Results
        Its `table`, a DataFrame, has one row a scene, method and metric.

    Raises
    ------
    InputError
        Unknown suite, method, metric or backend, a value that is not valid, a folder that cannot
        be written or that holds something else, not a single family that can be rendered.

    Examples
    --------
    >>> import tempfile
    >>> folder = tempfile.mkdtemp()
    >>> results = run("quick", folder, resolution=8, samples=2, methods=["eq8"], report=False)
    >>> sorted(results.table.method.unique()), results.run["families_failed"]
    (['eq8'], 0)
    """
    variant = chosen_variant(backend)
    chosen = chosen_suite(
        suite,
        variant,
        samples=samples,
        resolution=resolution,
        seed=seed,
        methods=methods,
        metrics=metrics,
    )
    folder = as_path(out) if out is not None else Path("results") / chosen.name
    if worker is not None and workers is None and scheduler is None:
        return _run_in(worker, chosen, folder, variant, progress, retry_failed, report)
    apart = timeout is not None or workers is not None or scheduler is not None
    seconds = TIMEOUT_SECONDS if timeout is None else timeout
    with engine(variant, workers, scheduler, seconds) if apart else nullcontext() as work:
        results = runner.run(chosen, folder, variant, progress, work, retry_failed)
    return _reported(results, folder) if report else results


def _run_in(
    worker: WorkerProcess,
    suite: Suite,
    folder: Path,
    variant: Variant,
    progress: Progress,
    retry_failed: bool,
    report: bool,
) -> Results:
    """Run a suite in a worker process; while that works, this one loads what draws figures."""

    def engine(tasks: Iterable[FamilyTask]) -> Iterator[tuple[FamilyTask, FamilyResult]]:
        if report:
            Thread(target=import_all, args=DRAWING, daemon=True).start()
        yield from in_worker_process(variant, worker)(tasks)
        if report:
            worker.begin(import_all, *DRAWING)

    results = runner.run(suite, folder, variant, progress, engine, retry_failed)
    return _reported(results, folder, worker) if report else results


def _reported(results: Results, folder: Path, worker: WorkerProcess | None = None) -> Results:
    from malus.reports.write import write_report

    write_report(results, folder, elsewhere=None if worker is None else worker.stream)
    return results
