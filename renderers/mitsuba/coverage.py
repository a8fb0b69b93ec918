"""Masks: the pixels that an object covers entirely, because it is hit at all four corners.

A mask from random samples would gain and lose pixels at the object's outline with every seed, and
the scores of those pixels would change with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np

from malus.renderers.mitsuba.rays import Film
from malus.scenes.camera import Camera
from malus.scenes.core.arrays import BoolArray, Float32Array, Int32Array, IntArray
from malus.scenes.core.errors import InputError
from malus.scenes.shapes.shapes import MeshFile, Shape

FAR = 20.0
"""Distance of a camera beyond which `ray_test` errs at the outline of a sphere of radius 1: in 6 of
1000 points along it at 50, in a tenth of the picture at 2000; from 9999 on it meets nothing."""


def meets(scene: Any, ray: Any, far: bool) -> Any:
    """Whether rays of a camera meet the scene; one that is `far` takes slower, exact ones."""
    return scene.ray_intersect_preliminary(ray).is_valid() if far else scene.ray_test(ray)


def inside(mi: ModuleType, scene: Any, resolution: int, far: bool = False) -> BoolArray:
    """Whether the only shape of `scene` is hit at all four corners of each pixel (resolution²,)."""
    corner = np.linspace(0.0, 1.0, resolution + 1, dtype=np.float32)
    x, y = (grid.ravel() for grid in np.meshgrid(corner, corner))
    sensor = scene.sensors()[0]
    if mi.variant().startswith("scalar"):
        rays = (sensor.sample_ray(0, 0, [a, b], [0.5, 0.5])[0] for a, b in zip(x, y, strict=True))
        hit = np.array([scene.ray_test(ray) for ray in rays])
    else:
        ray, _ = sensor.sample_ray(0.0, 0.0, mi.Point2f(x, y), mi.Point2f(0.5))
        hit = np.asarray(meets(scene, ray, far))
    hit = hit.reshape(resolution + 1, resolution + 1)
    return (hit[:-1, :-1] & hit[1:, :-1] & hit[:-1, 1:] & hit[1:, 1:]).ravel()


def check_seen(touched: BoolArray | IntArray, shape: Shape) -> None:
    """Refuse a shape that no ray meets, as where the camera looks through the hole of a ring.

    Raises
    ------
    InputError
        If no pixel is touched. Of no rays at all, Dr.Jit makes no kernel but ends the process.
    """
    if not touched.any():
        hint = "use a camera that sees it, or more resolution"
        raise InputError(shape.label, "an object that covers a pixel", "none", hint)


LEAST_FACING = 0.1
"""Share of a mesh's pixels that have to show the outer side of a face."""


def check_facing(normals: Float32Array, pixels: IntArray, camera: Camera, shape: Shape) -> None:
    """Refuse a mesh file of which the camera sees backs, from which no light comes.

    An open mesh may be inside out: nothing tells its outer side but the order of its corners.

    Parameters
    ----------
    normals : (P, 3)
        Mean normals of pixels, in the world.
    pixels : (P,)
        Their flat indices into the image.

    Raises
    ------
    InputError
        If fewer than `LEAST_FACING` of the pixels have a normal towards the camera.
    """
    if not isinstance(shape, MeshFile) or not len(pixels):
        return
    view = camera.view_directions()
    toward = camera.axes[2] if view is None else view.reshape(-1, 3)[pixels] @ camera.axes
    behind = float(np.mean((normals * toward).sum(axis=-1) <= 0))
    if behind > 1.0 - LEAST_FACING:
        expected = "faces wound anticlockwise as seen from outside"
        found = f"backs of faces, which are dark, in {behind:.0%} of its pixels"
        hint = "flip the faces in the program that wrote it, or move the camera"
        raise InputError(f"mesh {shape.file}", expected, found, hint)


def covering(mi: ModuleType, film: Film, scene: Any, shapes: Sequence[Any]) -> Int32Array:
    """Index (pixels,) in `shapes` of the one that all four corners of a pixel hit, or -1."""
    import drjit as dr

    resolution = film.resolution
    corner = np.linspace(0.0, 1.0, resolution + 1, dtype=np.float32)
    x, y = (grid.ravel() for grid in np.meshgrid(corner, corner))
    ray = film.ray_through(mi, mi.Point2f(x, y))
    hit = np.asarray(dr.reinterpret_array(mi.UInt32, scene.ray_intersect_preliminary(ray).shape))
    # Compared here and not in the kernel, which is then the same for every number of shapes.
    own = np.asarray(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(list(shapes))))
    index = np.full(len(x), -1, dtype=np.int32)
    for number, pointer in enumerate(own):
        index[hit == pointer] = number
    corners = index.reshape(resolution + 1, resolution + 1)
    upper_left, others = corners[:-1, :-1], (corners[1:, :-1], corners[:-1, 1:], corners[1:, 1:])
    same = np.logical_and.reduce([upper_left == other for other in others])
    return np.where(same, upper_left, -1).ravel().astype(np.int32)
