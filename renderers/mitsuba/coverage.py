"""Masks: the pixels that an object covers entirely, because it is hit at all four corners.

A mask from random samples would gain and lose pixels at the object's outline with every seed, and
the scores of those pixels would change with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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


BESIDE = ((0.0083, 0.0037), (-0.0037, 0.0083), (-0.0083, -0.0037), (0.0037, -0.0083))
"""Places around a corner, in pixels, that tell whether an edge of a mesh lets its ray through."""


def inside(mi: ModuleType, scene: Any, resolution: int, far: bool = False) -> BoolArray:
    """Whether the only shape of `scene` is hit at all four corners of each pixel (resolution²,)."""
    sensor = scene.sensors()[0]

    def index_at(x: Float32Array, y: Float32Array) -> Int32Array:
        if mi.variant().startswith("scalar"):
            places = zip(x, y, strict=True)
            rays = (sensor.sample_ray(0, 0, [a, b], [0.5, 0.5])[0] for a, b in places)
            hit = np.array([scene.ray_test(ray) for ray in rays])
        else:
            ray, _ = sensor.sample_ray(0.0, 0.0, mi.Point2f(x, y), mi.Point2f(0.5))
            hit = np.asarray(meets(scene, ray, far))
        return np.where(hit, 0, -1).astype(np.int32)

    return _same_at_corners(index_at, resolution) == 0


def _same_at_corners(
    index_at: Callable[[Float32Array, Float32Array], Int32Array], resolution: int
) -> Int32Array:
    """Number (pixels,) of the object at all four corners of each pixel, or -1.

    `index_at` gives the number of the object at places (x, y) of the film, each in 0..1, or -1.
    Rays exactly through an edge of a mesh may meet neither of its faces. Where all places around a
    corner show one object, the corner does.
    """
    corner = np.linspace(0.0, 1.0, resolution + 1, dtype=np.float32)
    x, y = (grid.ravel() for grid in np.meshgrid(corner, corner))
    index = index_at(x, y)
    doubtful = np.flatnonzero(_between_others(index.reshape(len(corner), -1)))
    if len(doubtful):
        places = (np.float32(shift) / np.float32(resolution) for shift in np.transpose(BESIDE))
        across, down = (
            np.add.outer(step, at[doubtful]).ravel()
            for step, at in zip(places, (x, y), strict=True)
        )
        around = index_at(across, down).reshape(len(BESIDE), -1)
        alike = (around == around[0]).all(axis=0)
        index[doubtful] = np.where(alike, around[0], index[doubtful])
    index = index.reshape(len(corner), -1)
    first, others = index[:-1, :-1], (index[1:, :-1], index[:-1, 1:], index[1:, 1:])
    same = np.logical_and.reduce([first == other for other in others])
    return np.where(same, first, -1).ravel().astype(np.int32)


def _between_others(index: Int32Array) -> BoolArray:
    """Where an object is on both sides of a corner, in its row or column, but not at it.

    Examples
    --------
    >>> _between_others(np.array([[-1, 0, -1, 0, -1]], np.int32))[0].tolist()
    [False, False, True, False, False]
    """
    result = np.zeros(index.shape, dtype=bool)
    for number in range(int(index.max(initial=-1)) + 1):
        here = index == number
        for axis in (0, 1):
            before = np.logical_or.accumulate(here, axis=axis)
            after = np.flip(np.logical_or.accumulate(np.flip(here, axis), axis=axis), axis)
            result |= before & after & ~here
    return result


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

    own = np.asarray(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(list(shapes))))

    def index_at(x: Float32Array, y: Float32Array) -> Int32Array:
        hit = scene.ray_intersect_preliminary(film.ray_through(mi, mi.Point2f(x, y)))
        # Compared here and not in the kernel, which is then the same for every number of shapes.
        pointers = np.asarray(dr.reinterpret_array(mi.UInt32, hit.shape))
        index = np.full(len(x), -1, dtype=np.int32)
        for number, pointer in enumerate(own):
            index[pointers == pointer] = number
        return index

    return _same_at_corners(index_at, film.resolution)
