"""`malus plan`: what a run will do, what it leaves out and why, and what that will cost."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from malus.bench.plan import FamilyPlan, plan
from malus.renderers.family import render_family
from malus.renderers.translate import CONVEX
from malus.renderers.variant import Variant, choose
from malus.scenes.lights import Distant, Uniform
from malus.scenes.polarisation import PAPER_ANGLES_DEG
from malus.scenes.scene import Sampling
from malus.scenes.suite import Suite, load_suite

BYTES_A_VALUE = 4
IMAGES_A_TRUTH = 5
"""Stokes images that a stored scene holds: both lobes, both noises, the standard error."""


@dataclass(frozen=True)
class Saving:
    """Something that is left out: how many of how many, and why nothing is lost."""

    what: str
    done: int
    instead_of: int
    why: str


def savings(suite: Suite, families: Sequence[FamilyPlan]) -> list[Saving]:
    """What the plan leaves out.

    Examples
    --------
    >>> found = savings(load_suite("quick"), plan(load_suite("quick")))
    >>> found[0].done < found[0].instead_of
    True
    """
    scenes = sum(len(family.scenes) for family in families)
    bands, angles = len(suite.wavelengths_nm), len(PAPER_ANGLES_DEG)
    nodes = sum(family.nodes for family in families)
    fixed = sum(family.scenes[0].surface.body == "unpolarised" for family in families)
    bodies = nodes - sum(f.nodes - 1 for f in families if _body_is_fixed(f))
    convex = sum(family.scenes[0].shape.kind in CONVEX for family in families)
    single = sum(isinstance(f.scenes[0].light, Distant | Uniform) for f in families)
    traces = len(families)
    return [
        Saving(
            "polariser images", scenes * bands, scenes * bands * angles,
            "a Stokes image holds every angle exactly",
        ),
        Saving(
            "interface images", nodes, scenes * bands,
            "a render is a smooth function of the index: Chebyshev nodes, error measured",
        ),
        Saving(
            "body images", bodies, scenes * bands,
            f"the same; {fixed} families have a body that does not depend on the index",
        ),
        Saving(
            "traces of the camera's rays", traces, nodes + bodies,
            "one hit is shaded by every node and both lobes",
        ),
        Saving(
            "families with shadow rays", traces - convex, traces,
            "a convex shape casts no shadow on itself",
        ),
        Saving(
            "families that sample both light and surface", traces - single, traces,
            "a distant light has one direction, a uniform one no place",
        ),
    ]  # fmt: skip


def _body_is_fixed(family: FamilyPlan) -> bool:
    return family.scenes[0].surface.body == "unpolarised"


def predicted_seconds(families: Sequence[FamilyPlan], variant: Variant) -> float:
    """Seconds of rendering, from rendering one family in miniature on this machine."""
    sample = max(families, key=lambda family: family.nodes)
    few = Sampling(samples=max(2, sample.sampling.samples // 16 // 2 * 2), seed=1)
    seconds = []
    for _ in range(2):  # the first one compiles kernels
        started = time.perf_counter()
        render_family(sample.scenes, few, variant, errors=False)
        seconds.append(time.perf_counter() - started)
    ratio = sample.sampling.samples / few.samples
    # Half of the miniature's time is work that does not grow with the samples (measured).
    return len(families) * seconds[-1] * 0.5 * (1.0 + ratio)


def dataset_bytes(suite: Suite, families: Sequence[FamilyPlan]) -> int:
    """Bytes of the Stokes images of every scene, before compression."""
    scenes = sum(len(family.scenes) for family in families)
    values = suite.camera.resolution**2 * len(suite.wavelengths_nm) * 3
    return scenes * values * IMAGES_A_TRUTH * BYTES_A_VALUE


def plan_command(name: str, backend: str) -> None:
    """Print the plan of a suite."""
    suite = load_suite(name)
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
    seconds = predicted_seconds(families, variant)
    gigabytes = dataset_bytes(suite, families) / 1e9
    console.print(
        f"rendering about {seconds:.0f} s here; a stored dataset about {gigabytes:.2f} GB "
        "before compression",
        highlight=False,
    )
