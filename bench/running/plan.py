"""What a run will do: scenes grouped into families that share their renders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from malus.renderers.families.family import FamilyKey
from malus.renderers.families.nodes import family_nodes
from malus.renderers.families.patterned import with_part
from malus.renderers.mitsuba.translate import CONVEX
from malus.scenes.core.model import content_id
from malus.scenes.lights.lights import Distant, Uniform
from malus.scenes.polarisation import PAPER_ANGLES_DEG
from malus.scenes.scene import Sampling, Scene
from malus.scenes.suite import Suite


@dataclass(frozen=True)
class FamilyPlan:
    """Scenes that come from the same renders, and the number of those.

    Attributes
    ----------
    interface, body : int
        Stokes images of the interface and of the body at the indices that are rendered.
    traces : int
        How often the camera's rays are traced.
    """

    scenes: tuple[Scene, ...]
    sampling: Sampling
    interface: int
    body: int
    traces: int = 1

    @property
    def id(self) -> str:
        """Hash of what decides the family's truths."""
        parts = [scene.id for scene in self.scenes]
        return content_id([parts, self.sampling.model_dump(mode="json")])

    @property
    def label(self) -> str:
        """What the family is, for progress and errors."""
        first = self.scenes[0]
        return f"{first.label}, {first.light.label}, {first.surface.label}"


def plan(suite: Suite) -> list[FamilyPlan]:
    """Families of a suite, in the order that keeps together what serves several of them.

    Methods keep tables of a roughness, renderers the table of a measured material.

    Examples
    --------
    >>> from malus.scenes import load_suite
    >>> families = plan(load_suite("quick"))
    >>> len(families), len(families[0].scenes)
    (8, 2)
    """
    groups: dict[FamilyKey, list[Scene]] = {}
    for scene in suite.scenes():
        groups.setdefault(FamilyKey.of(scene), []).append(scene)
    ordered = sorted(groups.items(), key=lambda group: (group[0].alpha, _file(group[0])))
    return [_family(key, scenes, suite.sampling) for key, scenes in ordered]


def _file(key: FamilyKey) -> str:
    return "" if key.measured is None else key.measured.path


def _family(key: FamilyKey, scenes: Sequence[Scene], sampling: Sampling) -> FamilyPlan:
    if key.room:  # nothing is interpolated: every band of both lobes is rendered
        bands = len(key.room.wavelengths_nm)
        return FamilyPlan(tuple(scenes), sampling, bands, bands, traces=bands)
    if key.pattern:
        parts = [
            _family(FamilyKey.of(one[0]), one, sampling)
            for one in ([with_part(s, i) for s in scenes] for i in range(len(key.parts)))
        ]
        counts = (sum(p.interface for p in parts), sum(p.body for p in parts))
        return FamilyPlan(tuple(scenes), sampling, *counts, traces=len(parts))
    interface = len(family_nodes(scenes).rendered)
    body = interface if key.body == "polarised" else 1
    return FamilyPlan(tuple(scenes), sampling, interface, body)


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
