"""Families of scenes: those whose truths come from the same renders."""

from __future__ import annotations

from dataclasses import dataclass

from malus.scenes.camera import Camera
from malus.scenes.lights.lights import Light
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.surface import AnyBody, Facets, Patterned
from malus.scenes.scene import Scene
from malus.scenes.shapes.patterns import Pattern
from malus.scenes.shapes.shapes import Shape

_UNKNOWN = Facets((0.0, 0.0))
"""Stands for the facets of a measured material."""


@dataclass(frozen=True)
class FamilyKey:
    """Everything that scenes of one family have in common."""

    shape: Shape
    camera: Camera
    light: Light
    facets: Facets
    body: AnyBody
    room: Scene | None = None
    pattern: Pattern | None = None
    parts: tuple[tuple[Facets, AnyBody], ...] = ()
    measured: Measured | None = None

    @classmethod
    def of(cls, scene: Scene) -> FamilyKey:
        """The key of a scene's family: all of the scene but the material, the bands and the albedo.

        A scene with surroundings is a family of its own, `room`. Surfaces in a `pattern` have a
        facets and a body each, `parts`; `facets` and `body` are then those of the first. A
        `measured` material has neither, and the index that methods are given changes no render.
        """
        surface = scene.surface
        if isinstance(surface, Measured):
            table = surface.model_copy(update={"eta": None})
            return cls(scene.shape, scene.camera, scene.light, _UNKNOWN, "none", measured=table)
        if isinstance(surface, Patterned):
            pattern, surfaces = surface.pattern, surface.surfaces
        else:
            pattern, surfaces = None, (surface,)
        return cls(
            scene.shape,
            scene.camera,
            scene.light,
            surfaces[0].facets,
            surfaces[0].body,
            room=scene if scene.surroundings else None,
            pattern=pattern,
            parts=tuple((part.facets, part.body) for part in surfaces) if pattern else (),
        )
