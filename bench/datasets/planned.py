"""What of a suite a dataset, or one of its parts, shall hold."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from malus.bench.datasets.maps_and_frames import Additions
from malus.bench.running.plan import FamilyPlan, drawn_families, plan
from malus.renderers.datasets.part_list import Part, PlannedScene
from malus.renderers.mitsuba.surface_maps import check_variant
from malus.renderers.variant import Variant, made_by
from malus.scenes.core.errors import InputError
from malus.scenes.core.model import content_id
from malus.scenes.materials.measured import Measured
from malus.scenes.suite import Suite


@dataclass(frozen=True)
class PlannedDataset:
    """Families to render, every scene of theirs by its id, and the part of the whole they are."""

    families: list[FamilyPlan]
    scenes: dict[str, PlannedScene]
    part: Part


def planned_dataset(suite: Suite, variant: Variant, part: str | None = None) -> PlannedDataset:
    """Plan of a dataset; a part `"3/16"` has every 16th random scene, or family, from the third.

    Raises
    ------
    InputError
        For a part that is none, for random scenes that are alike, for a value of a disjoint
        axis in two splits, and for maps in the scalar variant.
    """
    check_variant(suite.maps, variant, f"suite {suite.name}, key maps")
    number, count = _numbers(part)
    renders = _renders(suite, variant)
    if suite.random is not None:
        families, scenes = _random(suite, variant, number, count)
        planned, in_all = len(families), suite.random.count
    else:
        every = plan(suite)
        families, scenes = _of_axes(every, suite, variant, number, count)
        planned, in_all = len(scenes), sum(len(family.scenes) for family in every)
    whole = Part(number=number, count=count, planned=planned, in_all=in_all, renders=renders)
    return PlannedDataset(families, scenes, whole)


def _random(
    suite: Suite, variant: Variant, number: int, count: int
) -> tuple[list[FamilyPlan], dict[str, PlannedScene]]:
    """Random scenes of a part, each a family of its own, those of a measured material together."""
    drawn = drawn_families(suite, number, count)
    scenes = {
        each.scene_id: PlannedScene(_origin(each.family, suite, variant), each.index, each.split)
        for each in drawn
    }
    return sorted((each.family for each in drawn), key=_measured_file), scenes


def _measured_file(family: FamilyPlan) -> tuple[str, str]:
    surface = family.scenes[0].surface
    return (surface.path, surface.digest) if isinstance(surface, Measured) else ("", "")


def _of_axes(
    every: Sequence[FamilyPlan], suite: Suite, variant: Variant, number: int, count: int
) -> tuple[list[FamilyPlan], dict[str, PlannedScene]]:
    """Families of a part of a suite of axes; scenes have numbers where there are several parts."""
    places = {id(family): place for place, family in enumerate(every)}
    families = list(every[number - 1 :: count])
    firsts = list(accumulate((len(family.scenes) for family in every), initial=0))
    scenes = {}
    for family in families:
        origin, first = _origin(family, suite, variant), firsts[places[id(family)]]
        for index, scene in enumerate(family.scenes, first):
            scenes[scene.id] = PlannedScene(origin, index if count > 1 else None)
    return families, scenes


def _origin(family: FamilyPlan, suite: Suite, variant: Variant) -> str:
    """Hash of what decides a truth besides its scene: the family's renders and who made them."""
    added = Additions.of(suite).identity()
    parts = [family.id, suite.renderer, variant.name, made_by(suite.renderer)]
    return content_id([*parts, added] if added else parts)


def _renders(suite: Suite, variant: Variant) -> str:
    """Hash of what decides all scenes but their count, and who renders them."""
    content = suite.identity
    if suite.random is not None:
        del content["random"]["count"]
    return content_id([content, variant.name, made_by(suite.renderer)])


def _numbers(part: str | None) -> tuple[int, int]:
    """Number and count of a part such as `"3/16"`."""
    if part is None:
        return 1, 1
    match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", part)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        hint = "parts are counted from 1"
        raise InputError("part", "a part of several, such as 3/16", repr(part), hint)
    return int(match[1]), int(match[2])
