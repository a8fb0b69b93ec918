"""Render the truths of a suite as a dataset, family by family, and nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, repeat
from pathlib import Path
from typing import Any

from malus.bench.datasets.card import remove_documents, write_documents
from malus.bench.datasets.maps_and_frames import NOTHING, Additions
from malus.bench.datasets.planned import PlannedDataset, planned_dataset
from malus.bench.datasets.writing_thread import WritingThread
from malus.bench.running.cluster import cluster_client, spread_parts
from malus.bench.running.family_task import FamilyResult
from malus.bench.running.inside_worker import at_most, import_all
from malus.bench.running.output_folder import prepare_folder
from malus.bench.running.overrides import chosen_suite
from malus.bench.running.parts import Failure
from malus.bench.running.plan import FamilyPlan, by_stage
from malus.bench.running.progress import Progress, silent
from malus.bench.running.sharing import processes, shared_later
from malus.bench.running.task_queue import TaskQueue
from malus.bench.running.truths import truths
from malus.bench.running.worker_process import (
    LONGEST_SECONDS,
    TIMEOUT_SECONDS,
    Died,
    WorkerProcess,
    retried,
)
from malus.renderers.datasets.dataset_files import names_files
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.datasets.listed_scenes import being_written, check_parts_differ, listed_of
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, chosen_variant, mitsuba, use_threads
from malus.scenes.core.errors import InputError
from malus.scenes.core.remote import as_path, is_here
from malus.scenes.core.versions import versions
from malus.scenes.scene import Scene
from malus.scenes.suite import Suite


def render_dataset(
    suite: Suite | str | Path,
    out: Path | str,
    backend: str | Variant = "auto",
    progress: Progress = silent,
    worker: WorkerProcess | None = None,
    retry_failed: bool = False,
    *,
    samples: int | None = None,
    resolution: int | None = None,
    seed: int | None = None,
    timeout: float | None = None,
    part: str | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> dict[str, Any]:
    """Render a suite as a dataset: Stokes images of both lobes, normals and errors as OpenEXR.

    Scenes that the folder holds already are taken over. A card, `README.md` and `croissant.json`,
    tells what the dataset holds, and `splits.json` the splits of a random suite.
    A scene that cannot be rendered is recorded with the reason, and the others go on.

    Parameters
    ----------
    suite : Suite, or the name of one that malus brings, or the path of a TOML file
    out : path or URL of a folder
    backend : 'auto', 'cuda', 'llvm' or 'scalar'
    progress : function of (scenes done, scenes in all, label of the next family)
    worker : WorkerProcess, optional
        A process that renders; by default this one does.
    retry_failed : bool
        Try again what failed in an earlier run; a wrong input is always tried again.
    samples, resolution, seed : int, optional
        Samples a pixel, pixels a side, and seed, in place of the suite's.
    timeout : float, optional
        Seconds that a family may take. With it a process of its own renders, so that a crash costs
        one family; a script that asks for this has to keep its own work under
        `if __name__ == "__main__":`.
    part : str, optional
        One part of several, such as `"3/16"`: every 16th scene of a random suite, or every 16th
        family of scenes of another, from the third. Parts may be rendered at once and into one
        folder, which the last makes whole; or into several, whose content is copied into one.
    workers : int, optional
        Processes of this machine to spread parts over.
    scheduler : str, optional
        Address of a Dask cluster to spread them over, whose workers all see `out`.

    Returns
    -------
    dict
        `out`; `part`, such as `3/16`, or None for the whole; numbers of its
        scenes, `scenes`, `rendered`, `taken_over` and `failed`; `seconds`, and
        `bytes` of what was rendered by this process.

    Raises
    ------
    InputError
        Unknown suite or backend, a value that is not valid, a folder that cannot be written or
        that holds something else, not a single scene that can be rendered.

    Examples
    --------
    >>> import tempfile
    >>> folder = tempfile.mkdtemp()
    >>> done = render_dataset("quick", folder, resolution=8, samples=2)
    >>> done["scenes"], done["rendered"], done["failed"]
    (16, 16, 0)
    """
    started = time.perf_counter()
    on_cluster = workers is not None or scheduler is not None
    if on_cluster and part is not None:
        hint = "leave it out: the cluster shares out parts of its own"
        raise InputError("part", "no part beside `workers` or `scheduler`", part, hint)
    variant = chosen_variant(backend)
    chosen = chosen_suite(suite, variant, samples=samples, resolution=resolution, seed=seed)
    planned = _planned(chosen, variant, part, None if on_cluster else worker)
    with ExitStack() as stack:
        if timeout is not None and worker is None:
            worker = stack.enter_context(WorkerProcess(timeout))
        folder = prepare_folder(as_path(out), "a dataset")
        by_cluster = 0
        if on_cluster:
            client = stack.enter_context(cluster_client(workers, scheduler))
            render_part = partial(_render_part, chosen, _address(folder), retry_failed, timeout)
            by_cluster = _spread(render_part, planned, folder, client, variant, progress)
        done = _render_families(chosen, planned, folder, variant, progress, worker, retry_failed)
        done["rendered"] += by_cluster
        done["taken_over"] -= by_cluster
        check_parts_differ(folder, planned.scenes, planned.part)  # of those begun together
        write_documents(folder, chosen)
    size = done.pop("bytes")
    return done | {"seconds": round(time.perf_counter() - started, 3), "bytes": size}


def _planned(
    suite: Suite, variant: Variant, part: str | None, worker: WorkerProcess | None
) -> PlannedDataset:
    """Plan of a dataset; a process that will render it loads the renderer meanwhile."""
    if worker is not None and suite.renderer == "mitsuba":
        worker.begin(mitsuba, variant)
    return planned_dataset(suite, variant, part)


PARTS_A_THREAD = 4
"""Parts for each thread of a cluster: enough that none waits long for the last."""


def _spread(
    render_part: Callable[[str, str], None],
    planned: PlannedDataset,
    folder: Path,
    client: Any,
    variant: Variant,
    progress: Progress,
) -> int:
    """Render parts on a cluster, and return the number of scenes that are new.

    What its workers leave is for the one who makes the whole.
    """

    def done() -> int:
        return sum(name in planned.scenes for name in listed_of(folder).done)

    before = done()
    threads = sum(client.nthreads().values())
    count = min(PARTS_A_THREAD * threads, len(planned.families))
    names = [f"{number}/{count}" for number in range(1, count + 1)]
    for name in spread_parts(render_part, names, client, variant):
        progress(done(), planned.part.in_all, f"part {name}")
    return done() - before


def _address(folder: Path) -> str:
    """Path or URL of a folder, the same for workers, which have working folders of their own."""
    return str(folder.absolute() if is_here(folder) else folder)


def _render_part(
    suite: Suite, out: str, retry_failed: bool, timeout: float | None, part: str, backend: str
) -> None:
    """Render a part on a worker, which ends itself where its families take too long.

    Raises
    ------
    InputError
        Where the worker does not see the folder: what it rendered would be lost on its disk.
    """
    if is_here(as_path(out)) and not as_path(out).is_dir():
        hint = "give a folder or URL that all see, or render with `part` on each machine"
        raise InputError("out", "a folder that every worker sees", f"a worker without {out}", hint)
    families = len(planned_dataset(suite, chosen_variant(backend), part).families)
    seconds = TIMEOUT_SECONDS if timeout is None else timeout
    with at_most(min(seconds * max(families, 1), LONGEST_SECONDS)):
        render_dataset(suite, out, backend, retry_failed=retry_failed, part=part)


def _render_families(
    suite: Suite,
    planned: PlannedDataset,
    folder: Path,
    variant: Variant,
    progress: Progress,
    worker: WorkerProcess | None,
    retry_failed: bool,
) -> dict[str, Any]:
    """Render and write what the folder lacks; counts of scenes, and bytes that were written."""
    families, origins = planned.families, {n: s.origin for n, s in planned.scenes.items()}
    with (
        being_written(folder, planned.part),
        DatasetWriter(folder, planned.scenes, about(suite, variant), planned.part) as writer,
        WritingThread(writer, origins) as writing,
    ):
        taken_over = len(writer.done)
        if names_files(suite):
            writer.keep_files_of_done(each for family in families for each in family.scenes)
        tasks = _tasks(families, suite, variant, lambda s: _is_left(s, writer, retry_failed))
        if tasks:
            remove_documents(folder)
            progress(len(writer.done), len(origins), tasks[0].family.label)
        for task, outcome in _all_outcomes(tasks, worker):
            writing.wait()
            progress(len(writer.done), len(origins), task.family.label)
            writing.begin(outcome, task.family)
        writing.wait()
        progress(len(writer.done), len(origins), "")
    if not writer.done and writer.failed:
        why = next(iter(writer.failed.values())).reason
        raise InputError(f"suite {suite.name}", "a scene that can be rendered", "none", why)
    return {
        "out": str(folder),
        "part": planned.part.label if planned.part.count > 1 else None,
        "scenes": len(origins),
        "rendered": writing.truths,
        "taken_over": taken_over,
        "failed": len(writer.failed),
        "bytes": writing.bytes,
    }


def about(suite: Suite, variant: Variant) -> dict[str, Any]:
    """What `dataset.json` says of where the truths come from: suite, versions and variant."""
    additions = Additions.of(suite)
    return {
        "suite": suite.model_dump(mode="json"),
        "versions": versions("malus", "mitsuba", "drjit", "numpy"),
        "variant": {"name": variant.name, "reason": variant.reason},
        "conventions": additions.conventions(),
    }


@dataclass(frozen=True)
class RenderTask:
    """Some scenes of a family that are to be rendered together.

    Attributes
    ----------
    following : FamilyPlan or None
        The family after this one, which can be begun meanwhile.
    additions : Additions
        What is stored beside the truths.
    """

    family: FamilyPlan
    scenes: Sequence[Scene]
    renderer: str
    variant: Variant
    following: FamilyPlan | None = None
    additions: Additions = NOTHING


def _tasks(
    families: Sequence[FamilyPlan],
    suite: Suite,
    variant: Variant,
    is_left: Callable[[Scene], bool],
) -> list[RenderTask]:
    """Tasks of the scenes that are left, those of one shape together: its tree is built once."""
    tasks = []
    for family in by_stage(families):
        scenes = [scene for scene in family.scenes if is_left(scene)]
        if scenes:
            added = Additions.of(suite)
            tasks.append(RenderTask(family, scenes, suite.renderer, variant, additions=added))
    return tasks


def _is_left(scene: Scene, writer: DatasetWriter, retry_failed: bool) -> bool:
    failed = writer.failed.get(scene.id)
    return scene.id not in writer.done and (failed is None or retry_failed or failed.mendable)


def _all_outcomes(
    tasks: Sequence[RenderTask], worker: WorkerProcess | None
) -> Iterator[tuple[RenderTask, Truth | Failure]]:
    """Truths and failures of all tasks, of this process or of worker processes."""
    if worker is not None and tasks:
        variant = tasks[0].variant

        def load(worker: WorkerProcess, task: RenderTask) -> None:
            worker.begin(import_all, __name__)
            if task.renderer == "mitsuba":
                worker.begin(mitsuba, variant)

        yield from shared_later(tasks, worker, processes(variant), _outcomes, load)
        return
    queue = TaskQueue(tasks)
    while (task := queue.next_of("this process")) is not None:
        for outcome in _rendered(task):
            yield task, outcome


def _rendered(task: RenderTask, threads: int | None = None) -> Iterator[Truth | Failure]:
    """The truth of each scene, or why there is none; in a process of the caller's own threads."""
    if threads is not None and task.renderer == "mitsuba":
        use_threads(task.variant, threads)
    result = FamilyResult()
    with result.guard():
        rendered = truths(
            task.family,
            task.scenes,
            task.renderer,
            task.variant,
            result,
            errors=True,
            following=task.following,
        )
        for scene, truth in rendered:
            whole = None
            with result.guard(scene):
                whole = task.additions.added_to(truth, task.variant)
            if whole is not None:
                yield whole
    yield from result.failures


def _outcomes(worker: WorkerProcess, task: RenderTask, threads: int) -> Iterator[Truth | Failure]:
    """Truths and failures of a task, rendered by a worker process.

    A task that crashes the worker is tried again, without the scenes that are there already.
    """
    left = {scene.id: scene for scene in task.scenes}
    # What is rendered ahead may be what kills a worker: the second time this task is alone.
    following = chain([task.following], repeat(None))

    def attempt() -> Iterator[Truth | Failure]:
        scenes = tuple(left.values())
        again = replace(task, scenes=scenes, following=next(following))
        return worker.stream(_rendered, again, threads)

    try:
        for outcome in retried(attempt):
            if isinstance(outcome, Truth):
                del left[outcome.scene.id]
            yield outcome
    except Died as death:
        yield from (Failure(name, None, str(death)) for name in left)
