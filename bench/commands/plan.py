"""`malus plan`: what a run will do, what it leaves out and why, and what that will cost."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from malus.bench.running.plan import FamilyPlan, plan, plan_record, savings
from malus.bench.scoring.extra_metrics import get_metrics
from malus.reconstruct import get_method
from malus.renderers.families.adaptive import Renders, first_samples, relative_error
from malus.renderers.families.family import render_family
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.variant import Variant, choose
from malus.scenes.scene import Sampling
from malus.scenes.suite import Suite, load_suite

BYTES_A_VALUE = 4
IMAGES_A_TRUTH = 5
"""Stokes images that a stored scene holds: both lobes, both noises, the standard error."""


def predicted_seconds(
    families: Sequence[FamilyPlan], variant: Variant, renderer: str = "mitsuba"
) -> float:
    """Seconds of rendering, from rendering one family on this machine, in miniature by Mitsuba."""
    sample = max(families, key=lambda family: family.specular_images)
    if renderer == "torrance-sparrow":
        started = time.perf_counter()
        for scene in sample.scenes:
            render_torrance_sparrow(scene)
        return len(families) * (time.perf_counter() - started)
    few = Sampling(samples=max(2, sample.sampling.samples // 16 // 2 * 2), seed=1)
    seconds = []
    for _ in range(2):  # the first one compiles kernels
        started = time.perf_counter()
        rendered = render_family(sample.scenes, few, variant, errors=False)
        seconds.append(time.perf_counter() - started)
    ratio = _expected_samples(sample, rendered, few) / few.samples
    # Half of the miniature's time is work that does not grow with the samples (measured).
    return len(families) * seconds[-1] * 0.5 * (1.0 + ratio)


def _expected_samples(family: FamilyPlan, miniature: Renders, few: Sampling) -> float:
    """Samples a pixel that a family will take; noise falls as the root of their number."""
    most, target = family.sampling.samples, family.sampling.target
    if target is None:
        return most
    error = relative_error(miniature, family.scenes)
    return min(most, max(first_samples(family.sampling), few.samples * (error / target) ** 2))


def dataset_bytes(suite: Suite, families: Sequence[FamilyPlan]) -> int:
    """Bytes of the Stokes images of every scene, before compression."""
    scenes = sum(len(family.scenes) for family in families)
    values = suite.camera.resolution**2 * len(suite.wavelengths_nm) * 3
    return scenes * values * IMAGES_A_TRUTH * BYTES_A_VALUE


def plan_command(name: str, backend: str) -> None:
    """Print the plan of a suite."""
    suite = load_suite(name)
    for reference in suite.methods:
        get_method(reference)
    get_metrics(suite.metrics)
    variant = choose(backend)
    families = plan(suite)
    scenes = sum(len(family.scenes) for family in families)
    console = Console()
    console.print(
        f"{suite.name}: {scenes} scenes in {len(families)} families, "
        f"{len(suite.wavelengths_nm)} bands, variant {variant.name}",
        highlight=False,
    )
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("what")
    table.add_column("done", justify="right")
    table.add_column("instead of", justify="right")
    table.add_column("why nothing is lost")
    for saving in savings(suite, families):
        table.add_row(saving.what, str(saving.done), str(saving.instead_of), saving.why)
    console.print(table)
    seconds = predicted_seconds(families, variant, suite.renderer)
    gigabytes = dataset_bytes(suite, families) / 1e9
    record = plan_record(suite, families, seconds)
    console.print(
        f"{record['renders']} renders instead of {record['without_plan']}; about {seconds:.0f} s "
        f"here instead of {record['seconds_without']:.0f} s. A stored dataset: about "
        f"{gigabytes:.2f} GB before compression",
        highlight=False,
    )
