"""Which pixels the object covers entirely, whatever the samples: those whose corners all hit it.

A mask that asked the random samples would gain and lose pixels of the rim from seed to seed, and
scores that live at the rim would jump with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.renderers.mitsuba.rays import Film

Mask = NDArray[np.bool_]


def inside(mi: ModuleType, scene: Any, resolution: int) -> Mask:
    """Pixels (resolution²,) whose four corners hit the only shape of `scene`."""
    corner = np.linspace(0.0, 1.0, resolution + 1, dtype=np.float32)
    x, y = (grid.ravel() for grid in np.meshgrid(corner, corner))
    sensor = scene.sensors()[0]
    if mi.variant().startswith("scalar"):
        rays = (sensor.sample_ray(0, 0, [a, b], [0.5, 0.5])[0] for a, b in zip(x, y, strict=True))
        hit = np.array([scene.ray_test(ray) for ray in rays])
    else:
        ray, _ = sensor.sample_ray(0.0, 0.0, mi.Point2f(x, y), mi.Point2f(0.5))
        hit = np.asarray(scene.ray_test(ray))
    hit = hit.reshape(resolution + 1, resolution + 1)
    return (hit[:-1, :-1] & hit[1:, :-1] & hit[:-1, 1:] & hit[1:, 1:]).ravel()


def covering(mi: ModuleType, film: Film, scene: Any, shapes: Sequence[Any]) -> NDArray[np.int32]:
    """Index (pixels,) in `shapes` of the one that all four corners of a pixel hit, or -1."""
    import drjit as dr

    resolution = film.resolution
    corner = np.linspace(0.0, 1.0, resolution + 1, dtype=np.float32)
    x, y = (grid.ravel() for grid in np.meshgrid(corner, corner))
    ray = film.ray_through(mi, mi.Point2f(x, y))
    hit = scene.ray_intersect_preliminary(ray).shape
    index = dr.full(mi.Int32, -1, len(x))
    for number, shape in enumerate(shapes):
        index = dr.select(hit == mi.ShapePtr(shape), number, index)
    at = np.asarray(index).reshape(resolution + 1, resolution + 1)
    others = (at[1:, :-1], at[:-1, 1:], at[1:, 1:])
    same = np.logical_and.reduce([at[:-1, :-1] == other for other in others])
    return np.where(same, at[:-1, :-1], -1).ravel().astype(np.int32)
