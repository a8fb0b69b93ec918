"""Objects of scenes with surroundings as Mitsuba shapes; another band needs no new kernel.

Several surfaces on one object are a chain of Mitsuba's `blendbsdf`. Its weights are a texture of
our own, which gives the share of the next surface at a position in space.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from malus.renderers.mitsuba.patterns import SurfaceNumber, check_coordinates, surface_number
from malus.renderers.mitsuba.translate import diffuse_bsdf, mesh_object, specular_bsdf, tessellated
from malus.scenes.core.arrays import Float64Array
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.surface import (
    Conductor,
    Dielectric,
    Patterned,
    Surface,
    anisotropic,
)
from malus.scenes.shapes.patterns import ImageTexture, Pattern
from malus.scenes.shapes.shapes import Plane, Sphere
from malus.scenes.surroundings import Placed

_ETA, _K, _BODY, _LAMBERT = "eta.value", "k.value", "diffuse_reflectance.value", "reflectance.value"


class SurfaceBSDF:
    """The BSDF of a surface, set to one band after the other.

    A `polarised` body is part of Mitsuba's `pplastic`. An `unpolarised` one is Mitsuba's `diffuse`;
    the sum of both lobes is twice their mean, a `blendbsdf` of both at twice the reflectance.
    """

    def __init__(self, mi: ModuleType, surface: Dielectric | Conductor) -> None:
        self.mi, self.surface = mi, surface
        if isinstance(surface, Conductor):
            self.bsdf = mi.load_dict(specular_bsdf(1.5 + 1j, surface.facets))
            self.parts = [(self.bsdf, _ETA), (self.bsdf, _K)]
        elif surface.body == "polarised":
            # The factor of the specular lobe stays at its default: Mitsuba makes one object of two
            # equal textures, and a change of the albedo would change both.
            self.bsdf = mi.load_dict(specular_bsdf(1.5, surface.facets))
            self.parts = [(self.bsdf, _ETA), (self.bsdf, _BODY)]
        else:
            twice = {"specular_reflectance": {"type": "uniform", "value": 2.0}}
            specular = mi.load_dict(specular_bsdf(1.5, surface.facets) | twice)
            diffuse = mi.load_dict(diffuse_bsdf(1.5, surface.facets, "unpolarised"))
            blend = {"type": "blendbsdf", "weight": 0.5, "specular": specular, "diffuse": diffuse}
            self.bsdf = mi.load_dict(blend)
            self.parts = [(specular, _ETA), (diffuse, _LAMBERT)]

    @property
    def count(self) -> int:
        """Number of Mitsuba's BSDFs that it is made of."""
        return len({id(bsdf) for bsdf, _ in self.parts} | {id(self.bsdf)})

    def set_band(self, eta: float | complex, albedo: float) -> None:
        """Set index and albedo; for a conductor n and k."""
        import drjit as dr

        values = (eta.real, eta.imag if isinstance(eta, complex) else albedo)
        for (bsdf, key), value in zip(self.parts, values, strict=True):
            parameters = self.mi.traverse(bsdf)
            factor = 2.0 if key == _LAMBERT else 1.0
            parameters[key] = dr.opaque(self.mi.Float, factor * value)
            parameters.update()


def parts_of(surface: Surface) -> tuple[Dielectric | Conductor, ...]:
    """The surfaces of an object: one, or those of its pattern."""
    assert not isinstance(surface, Measured)  # scenes with surroundings refuse them
    return surface.surfaces if isinstance(surface, Patterned) else (surface,)


def object_bsdf(mi: ModuleType, placed: Placed) -> tuple[Any, list[SurfaceBSDF]]:
    """The BSDF of a whole object, and the BSDFs of its surfaces."""
    bsdfs = [SurfaceBSDF(mi, part) for part in parts_of(placed.surface)]
    if isinstance(placed.surface, Patterned):
        check_coordinates(placed.surface.pattern, placed.shape)
    whole = bsdfs[0].bsdf
    for index, next_surface in enumerate(bsdfs[1:]):
        weight = _share_of_next(mi, pattern_on(mi, placed), index)
        blend = {"type": "blendbsdf", "weight": weight, "first": whole, "second": next_surface.bsdf}
        whole = mi.load_dict(blend)
    return whole, bsdfs


def pattern_on(mi: ModuleType, placed: Placed) -> SurfaceNumber:
    """Surface numbers of an object in the scene: the pattern moves, turns and grows with it."""
    import drjit as dr

    assert isinstance(placed.surface, Patterned)
    number_at = surface_number(mi, placed.surface.pattern, len(placed.surface.surfaces))
    own_of = to_own_frame(mi, placed)
    if isinstance(placed.shape, Plane) and _is_planar(placed.surface.pattern):
        # Along z a plane is a line: a picture lies on its face, upright on a wall.
        def number_on_face(hit: Any) -> Any:
            own = own_of(hit.p)
            return number_at(SimpleNamespace(p=mi.Point3f(own.x, -own.z, 0.0)))

        return number_on_face
    # Rounding must not decide on which side of a boundary at y = 0 a plane lies. The factor is
    # data, so that planes and other shapes share a kernel.
    thickness = dr.opaque(mi.Float, 0.0 if isinstance(placed.shape, Plane) else 1.0)

    def number_in_scene(hit: Any) -> Any:
        own = own_of(hit.p)
        point = mi.Point3f(own.x, thickness * own.y, own.z)
        return number_at(SimpleNamespace(p=point, uv=hit.uv))

    return number_in_scene


def _is_planar(pattern: Pattern) -> bool:
    return isinstance(pattern, ImageTexture) and pattern.projection == "planar"


def to_own_frame(mi: ModuleType, placed: Placed) -> Callable[[Any], Any]:
    """The function that takes points of the world to the frame of an object's shape."""
    import drjit as dr

    # Opaque: another place needs no new kernel.
    rows = [
        mi.Vector3f(*(dr.opaque(mi.Float, value) for value in row))
        for row in (placed.rotation.T / placed.scale).tolist()
    ]
    centre = mi.Point3f(*(dr.opaque(mi.Float, float(value)) for value in placed.position))

    def own(point: Any) -> Any:
        away = mi.Vector3f(point - centre)
        return mi.Point3f(*(dr.dot(row, away) for row in rows))

    return own


def _share_of_next(mi: ModuleType, number_at: SurfaceNumber, index: int) -> Any:
    """A texture in 0..1: the share of the surfaces after that of `index`."""
    texture = _share_of_next_class(mi)(mi.Properties())
    texture.number_at, texture.index = number_at, index
    return texture


@functools.cache
def _share_of_next_class(mi: ModuleType) -> Any:
    """The class of the texture: one for all, as each would be garbage only a collection removes."""
    import drjit as dr

    class ShareOfNext(mi.Texture):  # type: ignore[misc, name-defined]
        number_at: SurfaceNumber
        index: int

        def eval_1(self, hit: Any, active: Any = True) -> Any:  # noqa: ARG002
            return dr.clip(self.number_at(hit) - self.index, 0.0, 1.0)

        def to_string(self) -> str:
            return f"ShareOfNext[{self.index}]"

    return ShareOfNext


def placed_object(mi: ModuleType, placed: Placed, bsdf: Any) -> Any:
    """An object at its position, as a Mitsuba shape with `bsdf`."""
    if isinstance(placed.shape, Sphere):
        return mi.load_dict({"type": "sphere", "bsdf": bsdf} | _ball(mi, placed))
    if isinstance(placed.shape, Plane):
        return mi.load_dict({"type": "rectangle", "to_world": _upright(mi, placed), "bsdf": bsdf})
    mesh = tessellated(placed.shape)
    turn = placed.rotation.astype(np.float32)
    moved = placed.scale * mesh.vertices @ turn.T + np.array(placed.position, np.float32)
    normals = None if mesh.normals is None else mesh.normals @ turn.T
    return mesh_object(mi, replace(mesh, vertices=moved.astype(np.float32), normals=normals), bsdf)


def _ball(mi: ModuleType, placed: Placed) -> dict[str, Any]:
    """Position and size of a sphere; and how it is turned, which brushed metal shows."""
    if not anisotropic(placed.surface):
        return {"center": list(placed.position), "radius": placed.scale}
    return {"to_world": _to_world(mi, placed, placed.rotation)}


def _upright(mi: ModuleType, placed: Placed) -> Any:
    """Transform of Mitsuba's rectangle, which faces +z, to the plane, which faces +y unturned."""
    facing_up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return _to_world(mi, placed, placed.rotation @ facing_up)


def _to_world(mi: ModuleType, placed: Placed, rotation: Float64Array) -> Any:
    """Transform of an object by a rotation, then by its size and position."""
    whole = np.eye(4)
    whole[:3, :3] = placed.scale * rotation
    whole[:3, 3] = placed.position
    return mi.ScalarTransform4f(whole)
