"""Rays of the camera: their random numbers, and the frame of the Stokes vectors along them."""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any, Self

from malus.renderers.mitsuba.lobe_samples import HALVES

_PURPOSES = 2


def streams(mi: ModuleType, number: Any, seed: Any) -> tuple[Any, Any]:
    """Independent streams of random numbers: one for the rays, one for the shading.

    `number` is that of `stream_number`: each pixel and half of its samples has its own.
    """
    generators = []
    for purpose in range(_PURPOSES):
        state, sequence = mi.sample_tea_32(number * _PURPOSES + purpose, seed)
        generator = mi.PCG32()
        generator.seed(mi.UInt64(state), mi.UInt64(sequence))
        generators.append(generator)
    return generators[0], generators[1]


def stream_number(pixel: Any, half: Any) -> Any:
    """Number of the streams of a pixel and a half of its samples."""
    return pixel * HALVES + half


@dataclass
class Film:
    """The square film of a camera: rays through its points.

    Mitsuba 3.9's orthographic camera hides the transform from its film from functions that Dr.Jit
    freezes; `to_camera` is a copy of it, None for other cameras. Rays end at the distance `far`,
    before a lamp that stands in the same scene; None is infinitely far.
    """

    sensor: Any
    resolution: int
    to_camera: Any | None = None
    far: Any | None = None

    @classmethod
    def of(cls, sensor: Any, resolution: int, far: Any | None = None) -> Self:
        """The film of a Mitsuba sensor."""
        orthographic = sensor.class_name() == "OrthographicCamera"
        inverse = sensor.projection_transform().inverse() if orthographic else None
        return cls(sensor, resolution, inverse, far)

    def ray_through(self, mi: ModuleType, position: Any) -> Any:
        """A ray through a position on the film, (0, 0) upper left and (1, 1) lower right."""
        ray, _ = self.sensor.sample_ray(0.0, 0.0, position, mi.Point2f(0.5))
        if self.far is not None:
            ray.maxt = mi.Float(self.far)
        return ray

    def ray(self, mi: ModuleType, pixel: Any, random: Any) -> Any:
        """A ray through a random point of every pixel; pixels count row by row from the top."""
        offset = mi.Point2f(random.next_float32(), random.next_float32())
        corner = mi.Point2f(pixel % self.resolution, pixel // self.resolution)
        position = (corner + offset) / self.resolution
        ray = self.ray_through(mi, position)
        if self.to_camera is not None:
            near = self.to_camera @ mi.Point3f(position.x, position.y, 0.0)
            ray.o = self.sensor.world_transform() @ near
        return ray


def to_camera_frame(mi: ModuleType, sensor: Any, ray: Any) -> Any:
    """Mueller matrix that turns Stokes vectors from Mitsuba's frame of a ray to +x of the image."""
    import drjit as dr

    up = sensor.world_transform() @ mi.Vector3f(0, 1, 0)
    horizontal = dr.normalize(dr.cross(ray.d, up))
    current = mi.mueller.stokes_basis(-ray.d)
    return mi.mueller.rotate_stokes_basis(-ray.d, current, horizontal)
