"""Patterns in Dr.Jit code: which of an object's surfaces a hit lies on."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np

from malus.renderers.mitsuba.rays import Film
from malus.renderers.mitsuba.translate import tessellated
from malus.scenes.core.arrays import Float32Array
from malus.scenes.core.errors import InputError
from malus.scenes.shapes.patterns import (
    Checker,
    ImageTexture,
    Noise,
    Pattern,
    Spots,
    Stripes,
)
from malus.scenes.shapes.shapes import MeshFile, ShapeOrPlane

SurfaceNumber = Callable[[Any], Any]
"""Maps hits to a surface's number in 0..count − 1; in between, a mixture of both neighbours."""


def surface_number(mi: ModuleType, pattern: Pattern, count: int) -> SurfaceNumber:
    """The function that gives the number of the surface at a hit, for a pattern of `count`."""
    import drjit as dr

    def turn(number: Any) -> Any:
        return mi.Float(number - count * dr.floor((number + 0.5) / count))

    match pattern:
        case Checker():
            return lambda hit: turn(sum(dr.floor(hit.p[axis] / pattern.size) for axis in range(3)))
        case Stripes():
            across = "xyz".index(pattern.axis)
            return lambda hit: turn(dr.floor(hit.p[across] / pattern.width))
        case Spots():
            return lambda hit: _spots(mi, pattern, count, hit.p)
        case Noise():
            return _noise(mi, pattern, count)
    return _image(mi, pattern, count)


def _spots(mi: ModuleType, pattern: Spots, count: int, point: Any) -> Any:
    import drjit as dr

    cell = dr.floor(point / pattern.spacing)
    away = point - pattern.spacing * (cell + 0.5)
    others = count - 1
    number = cell.x + cell.y + cell.z
    number = 1.0 + number - others * dr.floor((number + 0.5) / others)
    return dr.select(dr.norm(away) < pattern.radius, number, 0.0)


def _noise(mi: ModuleType, pattern: Noise, count: int) -> SurfaceNumber:
    """The surface in whose part of the field's normal distribution its value at a hit lies."""
    import drjit as dr

    # Opaque: another seed or size needs no new kernel.
    waves = [[dr.opaque(mi.Float, value) for value in row] for row in pattern.waves().tolist()]

    def number(hit: Any) -> Any:
        p = hit.p
        field = sum(a * dr.sin(x * p.x + y * p.y + z * p.z + phase) for x, y, z, phase, a in waves)
        share = 0.5 + 0.5 * dr.erf(field * math.sqrt(0.5))
        if pattern.soft:
            return share * (count - 1.0)
        return dr.clip(dr.floor(share * count), 0.0, count - 1.0)

    return number


def _image(mi: ModuleType, pattern: ImageTexture, count: int) -> SurfaceNumber:
    import drjit as dr

    values = mi.TensorXf(np.ascontiguousarray(pattern.grey()[..., None]) * (count - 1))
    own = pattern.projection == "uv"
    texture = mi.Texture2f(values, wrap_mode=dr.WrapMode.Repeat if own else dr.WrapMode.Clamp)

    def uv(hit: Any) -> Any:
        return mi.Point2f(hit.uv.x, 1.0 - hit.uv.y)

    def planar(hit: Any) -> Any:
        return mi.Point2f(0.5 + 0.5 * hit.p.x, 0.5 - 0.5 * hit.p.y)

    def spherical(hit: Any) -> Any:
        return spherical_coordinates(mi, hit.p)

    project = {"planar": planar, "spherical": spherical, "uv": uv}[pattern.projection]
    return lambda hit: texture.eval(project(hit))[0]


def spherical_coordinates(mi: ModuleType, point: Any) -> Any:
    """Longitude from -z and angle from +y of points, both in 0..1."""
    import drjit as dr

    turn = dr.atan2(-point.x, -point.z) / (2 * math.pi)
    polar = dr.safe_acos(point.y * dr.rcp(dr.maximum(dr.norm(point), 1e-9))) / math.pi
    return mi.Point2f(turn - dr.floor(turn), polar)


def check_coordinates(pattern: Pattern, shape: ShapeOrPlane) -> None:
    """Check that a mesh has the texture coordinates that a pattern asks for.

    Raises
    ------
    InputError
        If it has none.
    """
    if isinstance(pattern, ImageTexture) and pattern.projection == "uv":
        assert isinstance(shape, MeshFile)  # a scene allows uv only for meshes
        if tessellated(shape).uv is None:
            hint = "export the mesh with them, or choose another projection"
            raise InputError(f"mesh {shape.file}", "texture coordinates for uv", "none", hint)


def has_surface(
    mi: ModuleType, pattern: Pattern, count: int, index: int
) -> Callable[[Any, Any], Any]:
    """The function that says whether a hit has the surface of that index.

    Where two surfaces are mixed, a random number decides.

    The same random numbers give every hit exactly one surface.
    """
    import drjit as dr

    number_at = surface_number(mi, pattern, count)
    mixed = isinstance(pattern, ImageTexture) or (isinstance(pattern, Noise) and pattern.soft)

    def belongs(hit: Any, random: Any) -> Any:
        number = number_at(hit)
        if mixed:
            number = dr.minimum(dr.floor(number + random.next_float32()), count - 1.0)
        return number == float(index)

    return belongs


def surface_shares(
    mi: ModuleType, film: Film, scene: Any, number_at: SurfaceNumber, count: int
) -> Float32Array:
    """Share (pixels, count) of each surface in the area of a pixel, from 4 × 4 rays a pixel.

    They do not depend on samples or seed. Off the object the share of the first surface is 1.
    """
    import drjit as dr

    resolution = film.resolution
    thread = dr.arange(mi.UInt32, 16 * resolution**2)
    pixel, step = thread % resolution**2, thread // resolution**2
    corner = mi.Point2f(pixel % resolution, pixel // resolution)
    offset = mi.Point2f((mi.Float(step % 4) + 0.5) / 4, (mi.Float(step // 4) + 0.5) / 4)
    hit = scene.ray_intersect(film.ray_through(mi, (corner + offset) / resolution))
    number = number_at(hit)
    near = [dr.maximum(1.0 - dr.abs(number - index), 0.0) for index in range(count)]
    near = [dr.select(hit.is_valid(), share, 0.0) for share in near]
    dr.eval(near)  # by one kernel
    shares = np.stack(
        [np.asarray(share).reshape(16, -1).sum(axis=0, dtype=np.float64) for share in near], axis=-1
    )
    shares[shares.sum(axis=1) == 0, 0] = 1.0
    return np.asarray(shares / shares.sum(axis=1, keepdims=True), dtype=np.float32)
