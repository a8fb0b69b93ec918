"""What a plan leaves out, why nothing is lost by it, and what it would have cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from malus.bench.running.plan import FamilyPlan
from malus.renderers.mitsuba.translate import CONVEX
from malus.scenes.lights.lights import Distant, Uniform
from malus.scenes.polarisation import PAPER_ANGLES_DEG
from malus.scenes.scene import Scene
from malus.scenes.suite import Suite

LOBES = 2


@dataclass(frozen=True)
class Saving:
    """Something that is left out.

    Attributes
    ----------
    what, why : str
        What it is, and why nothing is lost.
    done, instead_of : int
        How many of it are done, of how many.
    renders : int
        Images of one lobe that are not rendered for this reason; 0 where only rays are saved.
    """

    what: str
    done: int
    instead_of: int
    why: str
    renders: int = 0


def savings(suite: Suite, families: Sequence[FamilyPlan]) -> list[Saving]:
    """What the plan leaves out.

    The renders add up: those that are done and those left out are one for every scene, band,
    polariser angle and lobe.

    Examples
    --------
    >>> from malus.bench.running.plan import plan
    >>> from malus.scenes import load_suite
    >>> found = savings(load_suite("quick"), plan(load_suite("quick")))
    >>> found[0].done < found[0].instead_of
    True
    """
    images = _images(suite, families)
    angles = len(PAPER_ANGLES_DEG)
    exact = Saving(
        "polariser images", images, images * angles,
        "a Stokes image holds every angle exactly", LOBES * images * (angles - 1),
    )  # fmt: skip
    if suite.renderer == "torrance-sparrow":
        return [exact]
    return [exact, *_indices(families, images), *_rays(families)]


def _images(suite: Suite, families: Sequence[FamilyPlan]) -> int:
    return sum(len(family.scenes) for family in families) * len(suite.wavelengths_nm)


def _indices(families: Sequence[FamilyPlan], images: int) -> list[Saving]:
    interface = sum(family.interface for family in families)
    body = sum(family.body for family in families)
    fixed = sum(_has_fixed_body(family.scenes[0]) for family in families)
    return [
        Saving(
            "interface images", interface, images,
            "a render is a smooth function of the index: Chebyshev nodes, error measured",
            images - interface,
        ),
        Saving(
            "body images", body, images,
            f"the same; {fixed} families have a body that does not depend on the index",
            images - body,
        ),
    ]  # fmt: skip


def _rays(families: Sequence[FamilyPlan]) -> list[Saving]:
    count, traces = len(families), sum(family.traces for family in families)
    images = sum(family.interface + family.body for family in families)
    convex = sum(_is_convex(family.scenes[0]) for family in families)
    single = sum(isinstance(f.scenes[0].light, Distant | Uniform) for f in families)
    return [
        Saving(
            "traces of the camera's rays", traces, images,
            "one hit is shaded by every node and both lobes",
        ),
        Saving(
            "families with shadow rays", count - convex, count,
            "a convex shape casts no shadow on itself",
        ),
        Saving(
            "families that sample both light and surface", count - single, count,
            "a distant light has one direction, a uniform one no place",
        ),
    ]  # fmt: skip


def _has_fixed_body(scene: Scene) -> bool:
    return scene.surroundings is None and scene.surface.body != "polarised"


def _is_convex(scene: Scene) -> bool:
    return scene.surroundings is None and scene.shape.kind in CONVEX


def plan_record(suite: Suite, families: Sequence[FamilyPlan], seconds: float) -> dict[str, Any]:
    """What `run.json` says under `plan`.

    Parameters
    ----------
    suite : Suite
    families : FamilyPlans
    seconds : float
        Measured time of the renders that were done.

    Returns
    -------
    dict
        `renders` and `without_plan`, numbers of images of one lobe; `seconds`, measured, and
        `seconds_without`, an estimate: as many renders as there are without a plan, each at the
        measured time of one. Less than it would take, for the renders of a family share one trace.
        `left_out`, a list of Savings.
    """
    left_out = savings(suite, families)
    without = LOBES * _images(suite, families) * len(PAPER_ANGLES_DEG)
    renders = without - sum(saving.renders for saving in left_out)
    return {
        "renders": renders,
        "without_plan": without,
        "seconds": round(seconds, 3),
        "seconds_without": round(seconds * without / renders, 3),
        "left_out": [asdict(saving) for saving in left_out],
    }
