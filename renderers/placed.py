"""Objects of scenes with surroundings as Mitsuba shapes, whose bands need no new kernel."""

from __future__ import annotations

import functools
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from malus.renderers.translate import body_bsdf, interface_bsdf, mesh_object, tessellated
from malus.scenes.shapes import Plane, Sphere
from malus.scenes.surface import Conductor, Dielectric
from malus.scenes.surroundings import Placed

_ETA, _K, _BODY, _LAMBERT = "eta.value", "k.value", "diffuse_reflectance.value", "reflectance.value"


class Painted:
    """The BSDF of a surface, set to one band after the other.

    A `polarised` body is part of Mitsuba's `pplastic`. An `unpolarised` one is Mitsuba's `diffuse`,
    and its sum with the interface is `_added`, because Mitsuba has no BSDF for sums.
    """

    def __init__(self, mi: ModuleType, surface: Dielectric | Conductor) -> None:
        self.mi, self.surface = mi, surface
        if isinstance(surface, Conductor):
            self.bsdf = mi.load_dict(interface_bsdf(1.5 + 1j, surface.alpha))
            self.parts = [(self.bsdf, _ETA), (self.bsdf, _K)]
        elif surface.body == "polarised":
            # The mirror's factor stays at its default: Mitsuba makes one object of two equal
            # textures, and a change of the albedo would change both.
            self.bsdf = mi.load_dict(interface_bsdf(1.5, surface.alpha))
            self.parts = [(self.bsdf, _ETA), (self.bsdf, _BODY)]
        else:
            interface = mi.load_dict(interface_bsdf(1.5, surface.alpha))
            body = mi.load_dict(body_bsdf(1.5, surface.alpha, "unpolarised"))
            self.bsdf = _added(mi, mi.variant())(interface, body)
            self.parts = [(interface, _ETA), (body, _LAMBERT)]

    def set_band(self, eta: float | complex, albedo: float) -> None:
        """Change index and albedo; a conductor has none, but its k."""
        import drjit as dr

        values = (eta.real, eta.imag if isinstance(eta, complex) else albedo)
        for (bsdf, key), value in zip(self.parts, values, strict=True):
            parameters = self.mi.traverse(bsdf)
            parameters[key] = dr.opaque(self.mi.Float, value)
            parameters.update()


@functools.cache
def _added(mi: ModuleType, variant: str) -> Any:
    """The class, one a variant, of BSDFs that are the sum of an interface and a body.

    Directions are drawn from either with equal probability; the density is the mean of both.
    Mitsuba's own `blendbsdf` returns the density of the one that was drawn, which biases a path
    tracer that combines it with the density of the light.
    """
    import drjit as dr

    assert mi.variant() == variant

    class Added(mi.BSDF):  # type: ignore[misc, name-defined]
        """Light mirrored by the interface plus light that left the body."""

        def __init__(self, interface: Any, body: Any) -> None:
            super().__init__(mi.Properties())
            self.interface, self.body = interface, body
            flags = interface.flags() | body.flags()
            self.m_components, self.m_flags = [flags], flags

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any) -> Any:
            first = sample1 < 0.5
            drawn, _ = self.interface.sample(ctx, si, 2 * sample1, sample2, active & first)
            other, _ = self.body.sample(ctx, si, 2 * sample1 - 1, sample2, active & ~first)
            drawn = dr.select(first, drawn, other)
            drawn.pdf = self.pdf(ctx, si, drawn.wo, active)
            usable = active & (drawn.pdf > 0)
            value = self.eval(ctx, si, drawn.wo, usable)
            return drawn, dr.select(usable, value / drawn.pdf, 0.0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
            return self.interface.eval(ctx, si, wo, active) + self.body.eval(ctx, si, wo, active)

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
            parts = (self.interface, self.body)
            mirrored, scattered = (part.pdf(ctx, si, wo, active) for part in parts)
            return 0.5 * (mirrored + scattered)

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
            return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

        def to_string(self) -> str:
            return "Added[]"

    return Added


def placed_object(mi: ModuleType, placed: Placed, bsdf: Any) -> Any:
    """The object where it stands, as a Mitsuba shape that carries `bsdf`."""
    if isinstance(placed.shape, Sphere):
        ball = {"type": "sphere", "center": list(placed.position), "radius": placed.scale}
        return mi.load_dict(ball | {"bsdf": bsdf})
    if isinstance(placed.shape, Plane):
        return mi.load_dict({"type": "rectangle", "to_world": _upright(mi, placed), "bsdf": bsdf})
    mesh = tessellated(placed.shape)
    turn = placed.rotation.astype(np.float32)
    moved = placed.scale * mesh.vertices @ turn.T + np.array(placed.position, np.float32)
    normals = None if mesh.normals is None else mesh.normals @ turn.T
    return mesh_object(mi, replace(mesh, vertices=moved.astype(np.float32), normals=normals), bsdf)


def _upright(mi: ModuleType, placed: Placed) -> Any:
    """Mitsuba's rectangle faces +z; a plane faces +y before it is turned."""
    whole = np.eye(4)
    facing_up = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    whole[:3, :3] = placed.scale * placed.rotation @ facing_up
    whole[:3, 3] = placed.position
    return mi.ScalarTransform4f(whole)
