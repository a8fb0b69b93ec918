"""Cut polygons into triangles: fans where these are right, ears where a polygon is concave.

Readers of meshes cut every polygon into a fan from its first corner. In a concave polygon the fan
covers what lies outside, and some of its triangles face the other way.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from malus.scenes.core.arrays import BoolArray, Float64Array, IntArray

MOST_CORNERS = 2000
"""Most corners of a concave polygon: cutting ears takes the cube of their number at worst."""

_ROUNDING = 1e-6
"""Part of a polygon's area by which a triangle may face the other way: coordinates are float32."""


class UncutFace(ValueError):
    """A concave face that cannot be cut into triangles; `number` is its own, from 1."""

    def __init__(self, words: str, number: int) -> None:
        super().__init__(words)
        self.number = number


def wrong_fans(corners: Float64Array) -> BoolArray:
    """Which polygons (m, n, 3) of n corners each a fan from the first corner does not cover; (m,).

    Examples
    --------
    >>> arrow = [[0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]]
    >>> wrong_fans(np.array([arrow, np.roll(arrow, 1, axis=0)], float)).tolist()
    [True, False]
    """
    first, others = corners[:, :1], corners[:, 1:]
    triangles = np.cross(others[:, :-1] - first, others[:, 1:] - first)
    whole = triangles.sum(axis=1)
    size = np.linalg.norm(triangles, axis=2).sum(axis=1)
    area = np.linalg.norm(whole, axis=1)
    along = np.einsum("mti,mi->mt", triangles, whole)
    least = along.min(axis=1, initial=0.0)
    # Two halves of a bow tie cancel, and have no side that could be the outer one.
    crossed = (area < _ROUNDING * size) & (size > 0)
    return np.asarray((least < -_ROUNDING * size * area) | crossed)


def cut_polygons(
    vertices: Float64Array, polygons: Sequence[Sequence[int] | IntArray]
) -> dict[int, IntArray]:
    """Cut the polygons of which a fan from the first corner is wrong.

    Those that name a vertex that is not there are left to whoever uses them.

    Parameters
    ----------
    vertices : (n, 3)
    polygons : sequence of vertex numbers, any number each

    Returns
    -------
    For the place of each such polygon its triangles (corners - 2, 3), as places of its corners.

    Raises
    ------
    UncutFace
        For a concave polygon that crosses itself or has more than `MOST_CORNERS` corners.

    Examples
    --------
    >>> arrow = np.array([[0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]], float)
    >>> cut_polygons(arrow, [[3, 0, 1, 2], [0, 1, 2, 3]])[1].tolist()
    [[3, 0, 1], [1, 2, 3]]
    """
    sizes = np.array([len(polygon) for polygon in polygons], np.int64)
    triangles: dict[int, IntArray] = {}
    for size in np.unique(sizes[sizes > 3]):
        places = np.flatnonzero(sizes == size)
        numbers = np.array([polygons[place] for place in places.tolist()], np.int64)
        there = ((numbers >= 0) & (numbers < len(vertices))).all(axis=1)
        places, corners = places[there], vertices[numbers[there]]
        wrong = wrong_fans(corners)
        for place, points in zip(places[wrong].tolist(), corners[wrong], strict=True):
            try:
                triangles[place] = _triangles(points)
            except ValueError as error:
                raise UncutFace(str(error), place + 1) from None
    return triangles


def _triangles(corners: Float64Array) -> IntArray:
    if len(corners) > MOST_CORNERS:
        raise ValueError(f"a concave one of {len(corners)} corners")
    return _ears(_in_plane(corners))


def _in_plane(corners: Float64Array) -> Float64Array:
    """Corners (n, 2) in the plane of a polygon, anticlockwise, in units of its extent."""
    centred = corners - corners.mean(axis=0)
    centred /= np.abs(centred).max(initial=0.0) or 1.0
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(axis=0)
    length = np.linalg.norm(normal)
    if not length > _ROUNDING:
        raise ValueError("one that crosses itself")
    normal /= length
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    return np.stack([centred @ across, centred @ np.cross(normal, across)], axis=1)


def _ears(points: Float64Array) -> IntArray:
    """Triangles of a simple polygon (n, 2), anticlockwise: one corner is cut off after the other.

    Source: Meisters, "Polygons have ears", American Mathematical Monthly 82 (1975).
    """
    left = list(range(len(points)))
    triangles = []
    while len(left) > 3:
        k = _next_ear(points, np.array(left))
        triangles.append((left[k - 1], left[k], left[(k + 1) % len(left)]))
        # The search goes on behind the ear, lest all triangles meet in one corner.
        left = left[k + 1 :] + left[:k]
    triangles.append((left[0], left[1], left[2]))
    ears = np.array(triangles, np.int64)
    if (_turn(*(points[ears[:, corner]] for corner in range(3))) < -_ROUNDING).any():
        raise ValueError("one that crosses itself")
    return ears


def _next_ear(points: Float64Array, left: IntArray) -> int:
    """Place in `left` of a corner that can be cut off: the first, or else one without area."""
    corners = points[left]
    before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    turns = _turn(before, corners, after)
    # Only what is not convex can lie in the triangle of a convex corner.
    others = corners[turns <= _ROUNDING]
    for k in np.flatnonzero(turns > _ROUNDING):
        triangle = before[k], corners[k], after[k]
        sides = [_turn(p, q, others) for p, q in pairwise((*triangle, before[k]))]
        inside = np.min(sides, axis=0, initial=np.inf) >= -(_ROUNDING**2)
        # A corner may stand twice, where a hole is joined to the outline.
        apart = ~np.logical_or.reduce([(others == corner).all(axis=1) for corner in triangle])
        if not (inside & apart).any():
            return int(k)
    flat = np.flatnonzero(np.abs(turns) <= _ROUNDING)
    if not flat.size:
        raise ValueError("one that crosses itself")
    return int(flat[0])


def _turn(a: Float64Array, b: Float64Array, c: Float64Array) -> Float64Array:
    """Twice the area (...) of triangles, positive where they are anticlockwise."""
    first, second = b - a, c - a
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
