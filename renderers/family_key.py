"""Families of scenes: those whose truths come from the same renders."""

from __future__ import annotations

from dataclasses import dataclass

from malus.scenes.camera import Camera
from malus.scenes.lights.lights import Light
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.surface import AnyBody, Patterned
from malus.scenes.scene import Scene
from malus.scenes.shapes.patterns import Pattern
from malus.scenes.shapes.shapes import Shape


@dataclass(frozen=True)
class FamilyKey:
    """Everything that scenes of one family have in common."""

    shape: Shape
    camera: Camera
    light: Light
    alpha: float
    body: AnyBody
    room: Scene | None = None
    pattern: Pattern | None = None
    parts: tuple[tuple[float, AnyBody], ...] = ()
    measured: Measured | None = None

    @classmethod
    def of(cls, scene: Scene) -> FamilyKey:
        """The key of a scene's family: all of the scene but the material, the bands and the albedo.

        A scene with surroundings is a family of its own, `room`. Surfaces in a `pattern` have a
        roughness and a body each, `parts`; `alpha` and `body` are then those of the first. A
        `measured` material has neither, and the index that methods are given changes no render.
        """
        surface = scene.surface
        if isinstance(surface, Measured):
            table = surface.model_copy(update={"eta": None})
            return cls(scene.shape, scene.camera, scene.light, 0.0, "none", measured=table)
        if isinstance(surface, Patterned):
            pattern, surfaces = surface.pattern, surface.surfaces
        else:
            pattern, surfaces = None, (surface,)
        return cls(
            scene.shape,
            scene.camera,
            scene.light,
            surfaces[0].alpha,
            surfaces[0].body,
            room=scene if scene.surroundings else None,
            pattern=pattern,
            parts=tuple((part.alpha, part.body) for part in surfaces) if pattern else (),
        )
