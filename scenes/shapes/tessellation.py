"""Grids of triangles, and fitting points to the unit sphere."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Faces = NDArray[np.uint32]

_GOLDEN = (1.0 + math.sqrt(5.0)) / 2.0

_ICOSAHEDRON = (
    (0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11),
    (1, 5, 9), (5, 11, 4), (11, 10, 2), (10, 7, 6), (7, 1, 8),
    (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9),
    (4, 9, 5), (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1),
)  # fmt: skip


def icosahedral_grid(subdivisions: int) -> tuple[FloatArray, Faces]:
    """Nearly uniform unit directions (n, 3) and outward triangles (20 · 4^subdivisions, 3).

    Raises ValueError unless 0 <= subdivisions <= 9.

    Examples
    --------
    >>> directions, faces = icosahedral_grid(1)
    >>> len(directions), len(faces)
    (42, 80)
    """
    if not 0 <= subdivisions <= 9:
        raise ValueError(f"expected 0 to 9 subdivisions, found {subdivisions}")
    short, long = (1.0, _GOLDEN)
    signs = [(-1, 1), (1, 1), (-1, -1), (1, -1)]
    flat = [(a * short, b * long, 0.0) for a, b in signs]
    points = np.array([np.roll(corner, turn) for turn in (0, 1, 2) for corner in flat])
    directions, faces = _unit(points), np.array(_ICOSAHEDRON, dtype=np.int64)
    for _ in range(subdivisions):
        directions, faces = _subdivided(directions, faces)
    return directions, faces.astype(np.uint32)


def torus_grid(rings: int, sides: int) -> tuple[FloatArray, FloatArray, Faces]:
    """Angles around the axis and around the tube, both (rings · sides,), and their triangles.

    Raises ValueError for fewer than 3 rings or sides.

    Examples
    --------
    >>> len(torus_grid(4, 3)[2])
    24
    """
    if rings < 3 or sides < 3:
        raise ValueError(f"expected at least 3 rings and 3 sides, found {rings} and {sides}")
    i, j = (index.ravel() for index in np.indices((rings, sides)))
    here, after = i * sides, (i + 1) % rings * sides
    up = (j + 1) % sides
    a, b, c, d = here + j, after + j, after + up, here + up
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    around, across = (np.asarray(k * (2 * math.pi / n)) for k, n in ((i, rings), (j, sides)))
    return around.astype(np.float64), across.astype(np.float64), faces.astype(np.uint32)


def fitted(points: FloatArray) -> FloatArray:
    """Points (n, 3) moved and scaled: bounding box about the origin, farthest point at radius 1.

    Raises ValueError unless the largest side of the bounding box is positive and finite.

    Examples
    --------
    >>> fitted(np.array([[4.0, 1.0, 1.0], [8.0, 1.0, 1.0]])).tolist()
    [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    """
    low, high = points.min(axis=0), points.max(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        extent = float((high - low).max())
    if not 0 < extent < math.inf:
        raise ValueError(f"expected a positive finite extent, found {extent}")
    # Divided first, so that neither sums nor squares of extreme coordinates overflow.
    centred = (points / extent) - (low / extent + high / extent) / 2
    radius = np.linalg.norm(centred, axis=1).max()
    return np.asarray(centred / radius)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _subdivided(
    directions: FloatArray, faces: NDArray[np.int64]
) -> tuple[FloatArray, NDArray[np.int64]]:
    a, b, c = faces.T
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    keys, inverse = np.unique(edges[:, 0] * len(directions) + edges[:, 1], return_inverse=True)
    first, second = np.divmod(keys, len(directions))
    middles = _unit(directions[first] + directions[second])
    ab, bc, ca = inverse.reshape(3, -1) + len(directions)
    corners = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    finer = np.concatenate([np.stack(corner, axis=1) for corner in corners])
    return np.concatenate([directions, middles]), finer
