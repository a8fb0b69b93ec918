"""What a run will do: scenes grouped into families that share their renders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from malus.renderers.families.family import FamilyKey
from malus.renderers.families.nodes import family_nodes
from malus.renderers.families.patterned import with_part
from malus.scenes.core.model import content_id
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
