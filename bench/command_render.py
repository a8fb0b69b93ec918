"""`malus render`: the truths of a suite as a dataset, family by family, and nothing else."""

from __future__ import annotations

import json
import platform
import sys
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from malus.bench.command_run import overridden
from malus.bench.plan import FamilyPlan, plan
from malus.bench.results import prepare_folder
from malus.renderers.dataset import DatasetWriter
from malus.renderers.family import render_family
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, choose
from malus.scenes.model import content_id
from malus.scenes.suite import Suite, load_suite

Show = Callable[[int, int, str], None]


def _silent(done: int, total: int, label: str) -> None:
    """Show nothing."""


def render_for_command_line(
    name: str, out: Path, overrides: dict[str, Any], backend: str, as_json: bool
) -> None:
    """Render a suite for the command line."""
    variant = choose(backend)
    suite = overridden(load_suite(name), overrides, variant)
    console = Console(stderr=True)
    done = with_progress(
        console, "scenes", lambda show: render_dataset(suite, out, variant, progress=show)
    )
    if as_json:
        sys.stdout.write(json.dumps(done) + "\n")
        return
    console.print(
        f"{done['scenes']} scenes in {out}: {done['rendered']} rendered, {done['taken_over']} taken"
        f" over; {done['seconds']:.1f} s, {done['bytes'] / 1e6:.1f} MB written",
        highlight=False,
    )


def render_dataset(
    suite: Suite,
    out: Path | str,
    variant: Variant | None = None,
    progress: Show = _silent,
) -> dict[str, Any]:
    """Write the truths of a suite to a folder; scenes that are there are taken over.

    Parameters
    ----------
    suite : Suite
    out : path of a folder
    variant : Variant, optional
        By default the fastest that works.
    progress : function of (scenes done, scenes in all, label of the next family)

    Returns
    -------
    dict of scenes, rendered, taken_over, seconds and bytes (of what was rendered).

    Raises
    ------
    InputError
        A folder that cannot be written, a scene that cannot be rendered.
    """
    started = time.perf_counter()
    folder = prepare_folder(Path(out))
    chosen = variant or choose()
    families = plan(suite)
    planned = {
        scene.id: _origin(family, suite, chosen) for family in families for scene in family.scenes
    }
    rendered = size = 0
    with DatasetWriter(folder, planned, about(suite, chosen)) as writer:
        taken_over = len(writer.done)
        for family in families:
            progress(len(writer.done), len(planned), family.label)
            for truth in _missing_truths(family, suite, chosen, writer):
                writer.add(truth, planned[truth.scene.id])
                size += sum(f.stat().st_size for f in (folder / truth.scene.id).iterdir())
                rendered += 1
                progress(len(writer.done), len(planned), family.label)
    return {
        "out": str(folder),
        "scenes": len(planned),
        "rendered": rendered,
        "taken_over": taken_over,
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


def with_progress(console: Console, what: str, work: Callable[[Show], Any]) -> Any:
    """Do some work under a progress bar on stderr, and return what it returns."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=None)
        return work(
            lambda done, total, label: bar.update(
                task, completed=done, total=total, description=label
            )
        )


def _origin(family: FamilyPlan, suite: Suite, variant: Variant) -> str:
    """Hash of what decides a truth besides its scene: the family's renders and who made them."""
    return content_id([family.id, suite.renderer, variant.name, version("malus")])


def _missing_truths(
    family: FamilyPlan, suite: Suite, variant: Variant, writer: DatasetWriter
) -> Iterator[Truth]:
    missing = [scene for scene in family.scenes if scene.id not in writer.done]
    if not missing:
        return
    if suite.renderer == "torrance-sparrow":
        yield from map(render_torrance_sparrow, missing)
        return
    # All of the family is rendered, because its nodes in η follow from all of its scenes.
    rendered = render_family(family.scenes, family.sampling, variant)
    yield from map(rendered.truth, missing)
