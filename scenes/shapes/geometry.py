"""Triangle meshes, and shapes of our own with exact normals.

Every shape is closed, faces outwards and fits the unit sphere. Its vertex normals are those of the
smooth surface, not averages over faces. With the default of 81920 triangles the interpolated normal
of torus and blob is within 0.03° of the exact one, and the surface within 3e-4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.scenes.core.errors import InputError
from malus.scenes.shapes.radial import (
    RadialSurface,
    blob_radius,
    radial_normals,
    superquadric_radius,
)
from malus.scenes.shapes.tessellation import FloatArray, fitted, icosahedral_grid, torus_grid

_SUBDIVISIONS = 6
"""20 · 4⁶ = 81920 triangles."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles in the world's frame, wound anticlockwise as seen from outside.

    `vertices` (n, 3) float32, `faces` (m, 3) uint32, `normals` (n, 3) float32 of unit length, or
    None for flat shading; `uv` (n, 2) float32, texture coordinates, or None. The arrays are made
    read-only.

    Raises
    ------
    ValueError
        For another shape or dtype, or an index outside the vertices.

    Examples
    --------
    >>> corner = np.eye(3, dtype=np.float32)
    >>> len(TriangleMesh(corner, np.array([[0, 1, 2]], dtype=np.uint32)).faces)
    1
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    normals: NDArray[np.float32] | None = None
    uv: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        """Check the arrays and freeze them."""
        _check_array(self.vertices, "vertices", np.float32)
        _check_array(self.faces, "faces", np.uint32)
        if self.normals is not None:
            _check_array(self.normals, "normals", np.float32)
            if self.normals.shape != self.vertices.shape:
                raise ValueError(f"expected one normal a vertex, found {self.normals.shape}")
        if self.uv is not None and len(self.uv) != len(self.vertices):
            raise ValueError(f"expected texture coordinates a vertex, found {self.uv.shape}")
        if self.faces.size and self.faces.max() >= len(self.vertices):
            raise ValueError(f"faces: index {self.faces.max()} of {len(self.vertices)} vertices")


def torus(
    major: float = 0.7, minor: float = 0.3, tilt: float = 0.0, rings: int = 320, sides: int = 128
) -> TriangleMesh:
    """Torus about the z axis, turned by `tilt` radians about +x, scaled to the unit sphere.

    Only the ratio of the radii matters. Raises InputError unless 0 < minor < major.

    Examples
    --------
    >>> len(torus().faces)
    81920
    """
    if not 0 < minor < major < math.inf:
        hint = "make the minor radius positive and less than the major one"
        raise InputError("torus", "0 < minor < major", f"major {major}, minor {minor}", hint)
    around, across, faces = torus_grid(rings, sides)
    radial = np.stack([np.cos(around), np.sin(around), np.zeros_like(around)], axis=1)
    axial = np.array([0.0, 0.0, 1.0])
    normals = np.cos(across)[:, None] * radial + np.sin(across)[:, None] * axial
    points = (major * radial + minor * normals) / (major + minor)
    turn = _rotation_about_x(tilt)
    return _finished(points @ turn.T, normals @ turn.T, faces)


def blob(seed: int = 0, amplitude: float = 0.5, subdivisions: int = _SUBDIVISIONS) -> TriangleMesh:
    """Smooth star-shaped blob of seven bumps, centred and scaled to the unit sphere.

    `amplitude` is the height of the highest bump in mean radii. Equal seeds give equal blobs on
    every machine. Raises InputError unless 0 <= amplitude <= 1 and seed >= 0.

    Examples
    --------
    >>> len(blob(seed=3).faces)
    81920
    """
    if not 0 <= amplitude <= 1:
        raise InputError("blob", "0 <= amplitude <= 1", f"{amplitude}", "choose lower bumps")
    if seed < 0:
        raise InputError("blob", "seed >= 0", f"{seed}", "choose another seed")
    return _radial_mesh(lambda d: blob_radius(d, seed, amplitude), subdivisions)


def superquadric(
    e1: float = 0.5, e2: float = 0.5, subdivisions: int = _SUBDIVISIONS
) -> TriangleMesh:
    """Superquadric about z, scaled to the unit sphere; exponents of 1 make a sphere.

    Small exponents make boxes: the interpolated normal is within 0.03° at 0.5, 0.3° at 0.2 and
    1.3° at 0.1. Exponents above 1 make creases, where it is off by several degrees; 2 is an
    octahedron. Raises InputError unless both are in 0.1 to 2. Source: A. H. Barr, "Superquadrics
    and Angle-Preserving Transformations" (1981), inside-outside function.

    Examples
    --------
    >>> len(superquadric(1.0, 1.0, subdivisions=2).faces)
    320
    """
    if not (0.1 <= e1 <= 2 and 0.1 <= e2 <= 2):
        hint = "choose exponents in that range; 1 is a sphere"
        raise InputError("superquadric", "e1 and e2 in 0.1 to 2", f"e1 {e1}, e2 {e2}", hint)
    return _radial_mesh(lambda d: superquadric_radius(d, e1, e2), subdivisions)


def _radial_mesh(surface: RadialSurface, subdivisions: int) -> TriangleMesh:
    directions, faces = icosahedral_grid(subdivisions)
    radius, gradient = surface(directions)
    normals = radial_normals(directions, radius, gradient)
    return _finished(fitted(directions * radius[:, None]), normals, faces)


def _rotation_about_x(angle: float) -> FloatArray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def _finished(points: FloatArray, normals: FloatArray, faces: NDArray[np.uint32]) -> TriangleMesh:
    return TriangleMesh(points.astype(np.float32), faces, normals.astype(np.float32))


def _check_array(array: NDArray[Any], name: str, dtype: type[np.generic]) -> None:
    if array.dtype != dtype or array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(
            f"{name}: expected (n, 3) {dtype.__name__}, found {array.shape} {array.dtype}"
        )
    array.setflags(write=False)
