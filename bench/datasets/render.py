"""Render the truths of a suite as a dataset, family by family, and nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import chain, repeat
from pathlib import Path
from typing import Any, Self

from malus.bench.running.family_task import FamilyResult
from malus.bench.running.output_folder import prepare_folder
from malus.bench.running.overrides import chosen_suite, chosen_variant
from malus.bench.running.parts import Failure
from malus.bench.running.plan import FamilyPlan, by_stage, plan
from malus.bench.running.progress import Progress, silent
from malus.bench.running.truths import truths
from malus.bench.running.worker_process import Died, WorkerProcess, retried
from malus.renderers.datasets.dataset import DatasetWriter
from malus.renderers.datasets.dataset_record import FailedScene
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import owned
from malus.scenes.core.model import content_id
from malus.scenes.core.remote import as_path
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
) -> dict[str, Any]:
    """Render a suite as a dataset: Stokes images of both lobes, normals and errors as OpenEXR.

    Scenes that the folder holds already are taken over. A scene that cannot be rendered is
    recorded with the reason, and the others go on.

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

    Returns
    -------
    dict
        `out`; numbers of scenes, `scenes`, `rendered`, `taken_over` and `failed`; `seconds`, and
        `bytes` of what was rendered.

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
    variant = chosen_variant(backend)
    chosen = chosen_suite(suite, variant, samples=samples, resolution=resolution, seed=seed)
    with ExitStack() as stack:
        if timeout is not None and worker is None:
            worker = stack.enter_context(WorkerProcess(timeout))
        folder = prepare_folder(as_path(out), "a dataset")
        done = _render_families(chosen, folder, variant, progress, worker, retry_failed)
    size = done.pop("bytes")
    return done | {"seconds": round(time.perf_counter() - started, 3), "bytes": size}


def _render_families(
    suite: Suite,
    folder: Path,
    variant: Variant,
    progress: Progress,
    worker: WorkerProcess | None,
    retry_failed: bool,
) -> dict[str, Any]:
    """Render and write what the folder lacks; counts of scenes, and bytes that were written."""
    families = plan(suite)
    origins = {
        scene.id: _origin(family, suite, variant) for family in families for scene in family.scenes
    }
    with (
        owned(folder, content_id(origins)),
        DatasetWriter(folder, origins, about(suite, variant)) as writer,
        WritingThread(writer, origins) as writing,
    ):
        taken_over = len(writer.done)
        for task in _tasks(families, suite, variant, lambda s: _is_left(s, writer, retry_failed)):
            progress(len(writer.done), len(origins), task.family.label)
            for outcome in _outcomes(task, worker):
                writing.wait()
                progress(len(writer.done), len(origins), task.family.label)
                writing.begin(outcome, task.family)
        writing.wait()
        progress(len(writer.done), len(origins), "")
    if not writer.done:
        why = next(iter(writer.failed.values())).reason
        raise InputError(f"suite {suite.name}", "a scene that can be rendered", "none", why)
    return {
        "out": str(folder),
        "scenes": len(origins),
        "rendered": writing.truths,
        "taken_over": taken_over,
        "failed": len(writer.failed),
        "bytes": writing.bytes,
    }


def about(suite: Suite, variant: Variant) -> dict[str, Any]:
    """What `dataset.json` says of where the truths come from: suite, versions and variant."""
    return {
        "suite": suite.model_dump(mode="json"),
        "versions": versions("malus", "mitsuba", "drjit", "numpy"),
        "variant": {"name": variant.name, "reason": variant.reason},
    }


def _origin(family: FamilyPlan, suite: Suite, variant: Variant) -> str:
    """Hash of what decides a truth besides its scene: the family's renders and who made them."""
    return content_id([family.id, suite.renderer, variant.name, version("malus")])


@dataclass(frozen=True)
class RenderTask:
    """Some scenes of a family that are to be rendered together.

    Attributes
    ----------
    following : FamilyPlan or None
        The family after this one, which can be begun meanwhile.
    """

    family: FamilyPlan
    scenes: Sequence[Scene]
    renderer: str
    variant: Variant
    following: FamilyPlan | None = None


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
            tasks.append(RenderTask(family, scenes, suite.renderer, variant))
    following = [*(task.family for task in tasks[1:]), None]
    return [replace(task, following=family) for task, family in zip(tasks, following, strict=False)]


def _is_left(scene: Scene, writer: DatasetWriter, retry_failed: bool) -> bool:
    failed = writer.failed.get(scene.id)
    return scene.id not in writer.done and (failed is None or retry_failed or failed.mendable)


def _rendered(task: RenderTask) -> Iterator[Truth | Failure]:
    """The truth of each scene, or why there is none."""
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
        for _, truth in rendered:
            yield truth
    yield from result.failures


def _outcomes(task: RenderTask, worker: WorkerProcess | None) -> Iterator[Truth | Failure]:
    """Truths and failures of a task, rendered by the worker process where there is one.

    A task that crashes the worker is tried again, without the scenes that are there already.
    """
    if worker is None:
        yield from _rendered(task)
        return
    left = {scene.id: scene for scene in task.scenes}
    # What is rendered ahead may be what kills a worker: the second time this task is alone.
    following = chain([task.following], repeat(None))

    def attempt() -> Iterator[Truth | Failure]:
        scenes = tuple(left.values())
        return worker.stream(_rendered, replace(task, scenes=scenes, following=next(following)))

    try:
        for outcome in retried(attempt):
            if isinstance(outcome, Truth):
                del left[outcome.scene.id]
            yield outcome
    except Died as death:
        yield from (Failure(name, None, str(death)) for name in left)


class WritingThread:
    """Writes truths in a thread of its own, one after the other, while the next is rendered.

    At most one is written at a time, so that memory holds that one and the next. As a context
    manager it waits for the last one, also after an error or Ctrl-C: no scene is left half written.

    Attributes
    ----------
    truths, bytes : int
        Number of truths that were written, and of bytes.
    """

    def __init__(self, writer: DatasetWriter, origins: Mapping[str, str]) -> None:
        self.truths = self.bytes = 0
        self._writer, self._origins = writer, origins
        self._thread = ThreadPoolExecutor(1, "malus-writes")
        self._in_work: Future[None] | None = None

    def __enter__(self) -> Self:
        """Start nothing yet."""
        return self

    def __exit__(self, *_: object) -> None:
        """Wait for what is being written; `wait` tells its errors."""
        self._thread.shutdown()

    def wait(self) -> None:
        """Wait for what is being written.

        Raises
        ------
        InputError
            If it could not be written.
        """
        if self._in_work is not None:
            self._in_work.result()
            self._in_work = None

    def begin(self, outcome: Truth | Failure, family: FamilyPlan) -> None:
        """Begin to write a truth, or to record why there is none; `wait` comes before."""
        assert self._in_work is None
        self._in_work = self._thread.submit(self._write, outcome, family)

    def _write(self, outcome: Truth | Failure, family: FamilyPlan) -> None:
        """Write a truth, or record a failure: without a scene, it is one of all without a truth."""
        writer = self._writer
        if isinstance(outcome, Truth):
            name = outcome.scene.id
            writer.add(outcome, self._origins[name])
            self.bytes += sum(file.stat().st_size for file in (writer.folder / name).iterdir())
            self.truths += 1
            return
        scenes = [scene.id for scene in family.scenes]
        for name in scenes if outcome.scene is None else [outcome.scene]:
            if name not in writer.done:
                writer.fail(
                    FailedScene(
                        scene=name,
                        origin=self._origins[name],
                        label=family.label,
                        reason=outcome.reason,
                        mendable=outcome.mendable,
                    )
                )
