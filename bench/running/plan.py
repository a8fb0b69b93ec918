"""Plan of a run: scenes grouped into families that share their renders, and what that saves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from malus.renderers.families.bounced import needs_paths
from malus.renderers.families.family import FamilyKey
from malus.renderers.families.nodes import family_nodes, nodes_by_albedo
from malus.renderers.families.patterned import with_part
from malus.renderers.mitsuba.lighting import radiance_map_of
from malus.scenes.core.errors import InputError
from malus.scenes.core.model import content_id
from malus.scenes.lights.lights import Distant, Uniform
from malus.scenes.materials.surface import Facets
from malus.scenes.polarisation import PAPER_ANGLES_DEG
from malus.scenes.random_suite.splits import SplitName, check_leaks
from malus.scenes.scene import Sampling, Scene, may_be_circular
from malus.scenes.shapes.shapes import CONVEX
from malus.scenes.suite import Suite


@dataclass(frozen=True)
class FamilyPlan:
    """Scenes that are interpolated from the same renders, and the number of those.

    Attributes
    ----------
    specular_images, diffuse_images : int
        Stokes images of each lobe that are rendered: one for every index that is rendered.
    traces : int
        Number of times that the camera's rays are traced.
    interpolated : bool
        Whether images are interpolated in the index; else each index is rendered once.
    """

    scenes: tuple[Scene, ...]
    sampling: Sampling
    specular_images: int
    diffuse_images: int
    traces: int = 1
    interpolated: bool = False

    @cached_property
    def scene_ids(self) -> tuple[str, ...]:
        """Ids of the scenes, in their order; each is a hash of all that a scene is."""
        return tuple(scene.id for scene in self.scenes)

    @cached_property
    def id(self) -> str:
        """Hash of what decides the family's truths."""
        return content_id([list(self.scene_ids), self.sampling.model_dump(mode="json")])

    @property
    def label(self) -> str:
        """Shape, light and surface of the family, for progress and errors."""
        first = self.scenes[0]
        return f"{first.label}, {first.light.label}, {first.surface.label}"


def plan(suite: Suite) -> list[FamilyPlan]:
    """Families of a suite, ordered so that cached tables are used again.

    Methods keep tables of a roughness, renderers the table of a measured material. Each random
    scene is a family of its own, with a seed of its own: what is rendered follows from it alone.

    Examples
    --------
    >>> from malus.scenes import load_suite
    >>> families = plan(load_suite("quick"))
    >>> len(families), len(families[0].scenes)
    (8, 2)
    """
    if suite.random is not None:
        return sorted((drawn.family for drawn in drawn_families(suite)), key=_by_tables)
    groups: dict[FamilyKey, list[Scene]] = {}
    for scene in suite.scenes():
        groups.setdefault(FamilyKey.of(scene), []).append(scene)
    ordered = sorted(groups.items(), key=lambda group: (group[0].facets, _measured_file(group[0])))
    return [_family(key, scenes, suite.sampling) for key, scenes in ordered]


def _by_tables(family: FamilyPlan) -> tuple[Facets, tuple[str, str]]:
    key = FamilyKey.of(family.scenes[0])
    return key.facets, _measured_file(key)


@dataclass(frozen=True)
class DrawnFamily:
    """A random scene as a family of its own, with its number and its split."""

    index: int
    split: SplitName | None
    family: FamilyPlan
    scene_id: str


def drawn_families(suite: Suite, number: int = 1, count: int = 1) -> list[DrawnFamily]:
    """The random scenes of a suite, or of part `number` of `count`: every `count`-th one.

    Raises
    ------
    InputError
        Where two scenes are equal, or a value of a disjoint axis is in two splits.
    """
    assert suite.random is not None
    assert suite.draws is not None
    draws, drawn, known = suite.draws, [], dict[str, int]()
    for index in range(number - 1, suite.random.count, count):
        scene = draws.scene(index)
        name = scene.id
        if known.setdefault(name, index) != index:
            expected, found = "scenes that differ", f"scene {index} equal to scene {known[name]}"
            hint = "draw a range in place of choices, or fewer scenes"
            raise InputError(f"suite {suite.name}", expected, found, hint)
        family = family_of_scene(scene, suite.sampling)
        drawn.append(DrawnFamily(index, draws.split(index), family, name))
    if suite.splits is not None:
        check_leaks(
            ((d.family.scenes[0], d.scene_id, d.split) for d in drawn if d.split), suite.splits
        )
    return drawn


SEEDS = 1 << 28
"""Number of seeds of a render."""


def family_of_scene(scene: Scene, sampling: Sampling) -> FamilyPlan:
    """Plan of one scene that shares no render; its noise is that of no other scene.

    With one seed for all, the noise of a data set would be one pattern, which a network learns.
    """
    seed = (sampling.seed + int(scene.id, 16)) % SEEDS
    return _family(FamilyKey.of(scene), [scene], sampling.model_copy(update={"seed": seed}))


def stages(families: Sequence[FamilyPlan]) -> list[int]:
    """Number of the stage of each family: its shape, camera and radiance map, loaded once."""
    numbers: dict[Any, int] = {}
    first_scenes = (family.scenes[0] for family in families)
    keys = [(scene.shape, scene.camera, radiance_map_of(scene.light)) for scene in first_scenes]
    return [numbers.setdefault(key, len(numbers)) for key in keys]


def by_stage(families: Sequence[FamilyPlan]) -> list[FamilyPlan]:
    """Families of one stage together, in the order in which the stages first come."""
    numbered = sorted(enumerate(stages(families)), key=lambda pair: pair[1])
    return [families[position] for position, _ in numbered]


def _measured_file(key: FamilyKey) -> tuple[str, str]:
    return ("", "") if key.measured is None else (key.measured.path, key.measured.digest)


def _family(key: FamilyKey, scenes: Sequence[Scene], sampling: Sampling) -> FamilyPlan:
    """Plan of the scenes of one family: how many images and traces they need."""
    if key.room:  # nothing is interpolated: every band of both lobes is rendered
        bands = len(key.room.wavelengths_nm)
        return FamilyPlan(tuple(scenes), sampling, bands, bands, traces=bands)
    if needs_paths(scenes[0], sampling):
        bands = len(scenes) * len(scenes[0].wavelengths_nm)
        if key.pattern:
            return FamilyPlan(tuple(scenes), sampling, bands, bands, traces=bands)
        by_albedo = nodes_by_albedo(scenes)
        images, between = len(by_albedo.rendered), any(n.is_interpolated for n in by_albedo.nodes)
        return FamilyPlan(tuple(scenes), sampling, images, images, images, between)
    if key.pattern:
        parts = [
            _family(FamilyKey.of(part_scenes[0]), part_scenes, sampling)
            for part_scenes in ([with_part(s, i) for s in scenes] for i in range(len(key.parts)))
        ]
        counts = (sum(p.specular_images for p in parts), sum(p.diffuse_images for p in parts))
        between = any(part.interpolated for part in parts)
        return FamilyPlan(tuple(scenes), sampling, *counts, len(parts), between)
    nodes = family_nodes(scenes)
    specular = len(nodes.rendered)
    diffuse = specular if key.body == "polarised" else 1
    return FamilyPlan(tuple(scenes), sampling, specular, diffuse, 1, nodes.is_interpolated)


LOBES = 2
"""Specular and diffuse light are rendered apart."""


def plan_record(suite: Suite, families: Sequence[FamilyPlan], seconds: float) -> dict[str, Any]:
    """Record of the plan, for `run.json`.

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
        `left_out`, the omitted work by kind.
    """
    omitted = savings(suite, families)
    without = LOBES * _images(suite, families) * len(PAPER_ANGLES_DEG)
    renders = without - sum(kind.renders for kind in omitted)
    return {
        "renders": renders,
        "without_plan": without,
        "seconds": round(seconds, 3),
        "seconds_without": round(seconds * without / renders, 3),
        "left_out": [asdict(kind) for kind in omitted],
    }


@dataclass(frozen=True)
class OmittedWork:
    """One kind of work that a plan omits: images or rays that need not be computed.

    Attributes
    ----------
    what, why : str
        The kind of work, and why nothing is lost without it.
    done, instead_of : int
        Number that is done, and number without a plan.
    renders : int
        Images of one lobe that are not rendered for this reason; 0 where only rays are saved.
    """

    what: str
    done: int
    instead_of: int
    why: str
    renders: int = 0


def savings(suite: Suite, families: Sequence[FamilyPlan]) -> list[OmittedWork]:
    """Work that the plan omits, by kind.

    The renders add up: those that are done and those omitted are one for every scene, band,
    polariser angle and lobe.

    Examples
    --------
    >>> from malus.bench.running.plan import plan
    >>> from malus.scenes import load_suite
    >>> omitted = savings(load_suite("quick"), plan(load_suite("quick")))
    >>> omitted[0].done < omitted[0].instead_of
    True
    """
    images = _images(suite, families)
    angles = len(PAPER_ANGLES_DEG)
    exact = OmittedWork(
        "polariser images", images, images * angles,
        "a Stokes image holds every angle exactly", LOBES * images * (angles - 1),
    )  # fmt: skip
    if suite.renderer == "torrance-sparrow":
        return [exact]
    return [exact, *_indices(families, images), *_rays(families), *_paths(families)]


def _images(suite: Suite, families: Sequence[FamilyPlan]) -> int:
    """Stokes images of all scenes and bands."""
    return sum(len(family.scenes) for family in families) * len(suite.wavelengths_nm)


def _indices(families: Sequence[FamilyPlan], images: int) -> list[OmittedWork]:
    """Images that are interpolated in the index instead of rendered."""
    specular = sum(family.specular_images for family in families)
    diffuse = sum(family.diffuse_images for family in families)
    fixed = sum(_has_fixed_body(family) for family in families)
    why = "equal indices are rendered once"
    if any(family.interpolated for family in families):
        why = "a render is a smooth function of the index: Chebyshev nodes, error measured"
    fixed_body = f"; {fixed} families have a body that does not depend on the index"
    return [
        OmittedWork("specular images", specular, images, why, images - specular),
        OmittedWork("diffuse images", diffuse, images, why + fixed_body, images - diffuse),
    ]


def _rays(families: Sequence[FamilyPlan]) -> list[OmittedWork]:
    """Rays that are not traced or sampled."""
    count, traces = len(families), sum(family.traces for family in families)
    images = sum(family.specular_images + family.diffuse_images for family in families)
    convex = sum(_is_convex(family.scenes[0]) for family in families)
    single = sum(isinstance(f.scenes[0].light, Distant | Uniform) for f in families)
    return [
        OmittedWork(
            "traces of the camera's rays", traces, images,
            "one hit is shaded by every node and both lobes",
        ),
        OmittedWork(
            "families with shadow rays", count - convex, count,
            "a convex shape casts no shadow on itself",
        ),
        OmittedWork(
            "families that sample both light and surface", count - single, count,
            "a distant light has one direction, a uniform one no place",
        ),
    ]  # fmt: skip


def _paths(families: Sequence[FamilyPlan]) -> list[OmittedWork]:
    """Reflections that are not traced, and Stokes components that are not kept."""
    count, scenes = len(families), [family.scenes[0] for family in families]
    depths = [family.sampling.depth(scene) for family, scene in zip(families, scenes, strict=True)]
    bouncing = [scene for scene, depth in zip(scenes, depths, strict=True) if depth > 2]
    by_band = sum(not _is_interpolated(scene) for scene in bouncing)
    why = "light is reflected once unless max_depth is larger, and a sphere lights no other point"
    if bouncing:
        why += (
            f"; {len(bouncing) - by_band} of them are interpolated in the index, at every albedo: "
            f"their images are smooth in it; {by_band} are rendered by band: several objects, "
            "patterns and metals have no one real index"
        )
    circular = sum(map(may_be_circular, scenes, depths))
    return [
        OmittedWork("families whose light bounces", len(bouncing), count, why),
        OmittedWork(
            "families with s3", circular, count,
            "zero unless a metal mirrors light that is polarised already",
        ),
    ]  # fmt: skip


def _is_interpolated(scene: Scene) -> bool:
    return scene.surroundings is None and scene.surface.kind == "dielectric"


def _has_fixed_body(family: FamilyPlan) -> bool:
    scene = family.scenes[0]
    direct = scene.surroundings is None and not needs_paths(scene, family.sampling)
    return direct and scene.surface.body != "polarised"


def _is_convex(scene: Scene) -> bool:
    return scene.surroundings is None and scene.shape.kind in CONVEX
