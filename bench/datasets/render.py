"""`malus render`: the truths of a suite as a dataset, family by family, and nothing else."""

from __future__ import annotations

import platform
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from malus.bench.running.family_task import FamilyResult
from malus.bench.running.output_folder import prepare_folder
from malus.bench.running.parts import Failure
from malus.bench.running.plan import FamilyPlan, plan
from malus.bench.running.progress import Progress, silent
from malus.bench.running.work import truths
from malus.bench.running.worker_process import ATTEMPTS, Died, WorkerProcess
from malus.renderers.datasets.dataset import DatasetWriter
from malus.renderers.datasets.dataset_record import FailedScene
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, choose
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import owned
from malus.scenes.core.model import content_id
from malus.scenes.core.remote import as_path
from malus.scenes.scene import Scene
from malus.scenes.suite import Suite


def render_dataset(
    suite: Suite,
    out: Path | str,
    variant: Variant | None = None,
    progress: Progress = silent,
    child: WorkerProcess | None = None,
    retry_failed: bool = False,
) -> dict[str, Any]:
    """Write the truths of a suite to a folder; scenes that are there are taken over.

    A scene that cannot be rendered is recorded with the reason, and the others go on.

    Parameters
    ----------
    suite : Suite
    out : path of a folder
    variant : Variant, by default the fastest that works
    progress : function of (scenes done, scenes in all, label of the next family)
    child : Child, optional
        Renders, so that a crash costs a family only; by default this process does.
    retry_failed : bool
        Try again what failed in an earlier run; a wrong input is always tried again.

    Returns
    -------
    dict of scenes, rendered, taken_over, failed, seconds and bytes (of what was rendered).

    Raises
    ------
    InputError
        A folder that cannot be written, not a single scene that can be rendered.
    """
    started = time.perf_counter()
    folder = prepare_folder(as_path(out), "a dataset")
    chosen = variant or choose()
    families = plan(suite)
    planned = {
        scene.id: _origin(family, suite, chosen) for family in families for scene in family.scenes
    }
    rendered = size = 0
    with (
        owned(folder, content_id(planned)),
        DatasetWriter(folder, planned, about(suite, chosen)) as writer,
    ):
        taken_over = len(writer.done)
        for family in families:
            progress(len(writer.done), len(planned), family.label)
            missing = [scene for scene in family.scenes if _is_left(scene, writer, retry_failed)]
            for found in _found(Order(family, missing, suite.renderer, chosen), child):
                size += _kept(found, family, planned, writer)
                rendered += isinstance(found, Truth)
                progress(len(writer.done), len(planned), family.label)
    if not writer.done:
        why = next(iter(writer.failed.values())).reason
        raise InputError(f"suite {suite.name}", "a scene that can be rendered", "none", why)
    return {
        "out": str(folder),
        "scenes": len(planned),
        "rendered": rendered,
        "taken_over": taken_over,
        "failed": len(writer.failed),
        "seconds": round(time.perf_counter() - started, 3),
        "bytes": size,
    }


def about(suite: Suite, variant: Variant) -> dict[str, Any]:
    """What `dataset.json` says of where the truths come from."""
    packages = ("malus", "mitsuba", "drjit", "numpy")
    return {
        "suite": suite.model_dump(mode="json"),
        "versions": {name: version(name) for name in packages}
        | {"python": platform.python_version()},
        "variant": {"name": variant.name, "reason": variant.reason},
    }


def _origin(family: FamilyPlan, suite: Suite, variant: Variant) -> str:
    """Hash of what decides a truth besides its scene: the family's renders and who made them."""
    return content_id([family.id, suite.renderer, variant.name, version("malus")])


@dataclass(frozen=True)
class Order:
    """Some scenes of a family that shall be rendered."""

    family: FamilyPlan
    scenes: Sequence[Scene]
    renderer: str
    variant: Variant


def _is_left(scene: Scene, writer: DatasetWriter, retry_failed: bool) -> bool:
    failed = writer.failed.get(scene.id)
    return scene.id not in writer.done and (failed is None or retry_failed or failed.mendable)


def _rendered(order: Order) -> Iterator[Truth | Failure]:
    """The truth of each scene, or why there is none."""
    made = FamilyResult()
    with made.guard():
        found = truths(order.family, order.scenes, order.renderer, order.variant, made, errors=True)
        for _, truth in found:
            yield truth
    yield from made.failures


def _found(order: Order, child: WorkerProcess | None) -> Iterator[Truth | Failure]:
    """As `_rendered`, in the child where there is one; what crashes it is tried again."""
    if not order.scenes:
        return
    if child is None:
        yield from _rendered(order)
        return
    left, reason = {scene.id: scene for scene in order.scenes}, ""
    for _ in range(ATTEMPTS):
        try:
            for found in child.stream(_rendered, replace(order, scenes=tuple(left.values()))):
                if isinstance(found, Truth):
                    del left[found.scene.id]
                yield found
            return
        except Died as death:
            reason = f"{death}, {ATTEMPTS} times"
    yield from (Failure(name, None, reason) for name in left)


def _kept(
    found: Truth | Failure, family: FamilyPlan, planned: Mapping[str, str], writer: DatasetWriter
) -> int:
    """Write a truth, or record why there is none; the number of bytes written.

    A failure without a scene is one of all scenes of the family that have no truth.
    """
    if isinstance(found, Truth):
        writer.add(found, planned[found.scene.id])
        return sum(file.stat().st_size for file in (writer.folder / found.scene.id).iterdir())
    names = [scene.id for scene in family.scenes] if found.scene is None else [found.scene]
    for name in names:
        if name not in writer.done:
            writer.fail(
                FailedScene(
                    scene=name,
                    origin=planned[name],
                    label=family.label,
                    reason=found.reason,
                    mendable=found.mendable,
                )
            )
    return 0
