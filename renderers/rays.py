"""The camera's rays: their random streams, and the frame of the Stokes vectors it sees."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from malus.renderers.lobes import HALVES


def streams(mi: ModuleType, pixel: Any, half: Any, seed: int) -> tuple[Any, Any]:
    """Independent streams of a pixel and half: one for the rays, one for the shading."""
    import drjit as dr

    found = []
    for purpose in range(2):
        index = (pixel * HALVES + half) * 2 + purpose
        state, sequence = mi.sample_tea_32(index, dr.opaque(mi.UInt32, seed))
        stream = mi.PCG32()
        stream.seed(mi.UInt64(state), mi.UInt64(sequence))
        found.append(stream)
    return found[0], found[1]


def camera_ray(mi: ModuleType, sensor: Any, resolution: int, pixel: Any, random: Any) -> Any:
    """A ray through a random point of every pixel; pixels count row by row from the top."""
    offset = mi.Point2f(random.next_float32(), random.next_float32())
    corner = mi.Point2f(pixel % resolution, pixel // resolution)
    ray, _ = sensor.sample_ray(0.0, 0.0, (corner + offset) / resolution, mi.Point2f(0.5))
    return ray


def to_camera_frame(mi: ModuleType, sensor: Any, ray: Any) -> Any:
    """Mueller rotation from Mitsuba's frame for the ray to +x of the image."""
    import drjit as dr

    up = sensor.world_transform() @ mi.Vector3f(0, 1, 0)
    horizontal = dr.normalize(dr.cross(ray.d, up))
    current = mi.mueller.stokes_basis(-ray.d)
    return mi.mueller.rotate_stokes_basis(-ray.d, current, horizontal)
