"""How far shapes reach down: where they touch the floor that they stand on."""

from __future__ import annotations

import functools
import math

from malus.scenes.shapes import geometry
from malus.scenes.shapes.lathe import lathe
from malus.scenes.shapes.shapes import (
    Blob,
    Lathe,
    MeshFile,
    Plane,
    ShapeOrPlane,
    Sphere,
    Superquadric,
    Torus,
)


@functools.lru_cache(maxsize=1 << 15)
def lowest(shape: ShapeOrPlane) -> float:
    """Height of a shape's lowest point before it is scaled, -1 to 0; from a coarse mesh.

    Blobs, superquadrics and tori are within 0.005 of it; superquadrics with an exponent below 0.2,
    whose corners a coarse mesh cuts, within 0.01.

    Raises
    ------
    InputError
        For a mesh file that cannot be read.

    Examples
    --------
    >>> lowest(Sphere())
    -1.0
    """
    match shape:
        case Sphere():
            return -1.0
        case Plane():
            return 0.0
        case Torus():
            mesh = geometry.torus(shape.major, shape.minor, math.radians(shape.tilt_deg), 64, 32)
        case Blob():
            mesh = geometry.blob(shape.seed, subdivisions=4)
        case Superquadric():
            mesh = geometry.superquadric(shape.e1, shape.e2, shape.stretch, subdivisions=4)
        case Lathe():
            mesh = lathe(shape.seed, sides=8)
        case MeshFile():
            from malus.scenes.shapes.meshes import load_mesh

            mesh = load_mesh(shape.checked(), shape.shading, shape.up)[0]
    return float(mesh.vertices[:, 1].min())
