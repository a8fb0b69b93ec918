"""What a run will do: scenes grouped into families that share their renders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from malus.renderers.family import FamilyKey
from malus.renderers.nodes import node_count
from malus.scenes.model import content_id
from malus.scenes.scene import Sampling, Scene
from malus.scenes.suite import Suite


@dataclass(frozen=True)
class FamilyPlan:
    """Scenes that come from the same renders, and the number of those."""

    scenes: tuple[Scene, ...]
    sampling: Sampling
    nodes: int

    @property
    def id(self) -> str:
        """Hash of what decides the family's truths."""
        parts = [scene.id for scene in self.scenes]
        return content_id([parts, self.sampling.model_dump(mode="json")])

    @property
    def label(self) -> str:
        """What the family is, for progress and errors."""
        first = self.scenes[0]
        return f"{first.shape.label}, {first.light.label}, {first.surface.label}"


def plan(suite: Suite) -> list[FamilyPlan]:
    """Families of a suite, those of one roughness together: methods keep tables of a roughness.

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
    ordered = sorted(groups.items(), key=lambda group: group[0].alpha)
    return [_family(scenes, suite.sampling) for _, scenes in ordered]


def _family(scenes: Sequence[Scene], sampling: Sampling) -> FamilyPlan:
    indices = [float(value) for scene in scenes for value in scene.eta]
    return FamilyPlan(tuple(scenes), sampling, node_count(min(indices), max(indices)))
