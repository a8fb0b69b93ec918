"""What the faces of a mesh say about it: shared vertices, edges, orientation, normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int64]


def merged_indices(vertices: FloatArray, distance: float) -> Indices:
    """For each vertex (n, 3) in the unit sphere, the first one in the same cell of `distance`.

    Raises ValueError for a distance below 2e-6, as three cell numbers share one 64-bit key.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1e-9]])
    >>> merged_indices(corners, 2e-6).tolist()
    [0, 1, 0]
    """
    if distance < 2e-6:
        raise ValueError(f"expected a distance of at least 2e-6, found {distance}")
    # 1.5 cells either side of the unit sphere stay below 2^20 of 2^21 cells an axis.
    x, y, z = (np.rint(vertices / distance).astype(np.int64) + (1 << 20)).T
    _, first, inverse = np.unique((x << 42) | (y << 21) | z, return_index=True, return_inverse=True)
    return np.asarray(first[inverse.ravel()])


def thin(vertices: FloatArray, faces: Indices, height: float) -> NDArray[np.bool_]:
    """Whether a triangle (m, 3) has an index twice or its least height is below `height`.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> thin(corners, np.array([[0, 1, 2], [0, 1, 3], [0, 0, 3]]), 1e-7).tolist()
    [True, False, True]
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return np.asarray(repeated | (twice_area <= height * longest))


def defects_of_edges(faces: Indices) -> list[str]:
    """Words for edges of triangles (m, 3) without exactly two faces of opposite direction.

    Examples
    --------
    >>> defects_of_edges(np.array([[0, 1, 2]]))
    ['open: 3 edges have only one face']
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    size = int(faces.max()) + 1
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, inverse, sharing = np.unique(low * size + high, return_inverse=True, return_counts=True)
    net = np.bincount(inverse.ravel(), weights=np.where(start < end, 1.0, -1.0))
    found = {
        "open: {} edges have only one face": sharing == 1,
        "not a surface: {} edges have more than two faces": sharing > 2,
        # Of two faces that agree, one runs along their edge forwards and one backwards.
        "inconsistent: {} edges between faces wound in opposite senses": (sharing == 2)
        & (net != 0),
    }
    return [words.format(bad.sum()) for words, bad in found.items() if bad.any()]


def signed_volume(vertices: FloatArray, faces: Indices) -> float:
    """Volume inside a closed surface by the divergence theorem, negative if it is inside out.

    Examples
    --------
    >>> corners = np.vstack([np.zeros(3), np.eye(3)])
    >>> faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> round(6 * signed_volume(corners, faces), 12)
    1.0
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def face_normals(vertices: FloatArray, faces: Indices) -> FloatArray:
    """Unit normals (m, 3) of triangles wound anticlockwise; NaN for one without area.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> face_normals(corners, np.array([[0, 1, 2]])).tolist()
    [[0.0, 0.0, 1.0]]
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return _unit(np.cross(b - a, c - a))


def angle_weighted_normals(vertices: FloatArray, faces: Indices) -> FloatArray:
    """Unit normals (n, 3) at vertices: face normals weighted by the angle of the face there.

    Independent of how a flat part is cut into triangles. A vertex whose faces cancel, or that has
    none, takes the normal of its last face, or +z. Source: Thürmer and Wüthrich (1998).

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> angle_weighted_normals(corners, np.array([[0, 1, 2]]))[2].tolist()
    [0.0, 0.0, 1.0]
    """
    of_faces = face_normals(vertices, faces)
    sums, last = np.zeros_like(vertices), np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    for corner in range(3):
        here, after, before = (faces[:, (corner + k) % 3] for k in range(3))
        angle = _angle(vertices[after] - vertices[here], vertices[before] - vertices[here])
        for axis in range(3):
            weights = angle * of_faces[:, axis]
            sums[:, axis] += np.bincount(here, weights, minlength=len(vertices))
        last[here] = of_faces
    cancelled = np.linalg.norm(sums, axis=1) < 1e-9  # rounding of angles of order 1
    return _unit(np.where(cancelled[:, None], last, sums))


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    # atan2 keeps its precision for thin angles, where arccos loses half the digits.
    sine = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.arctan2(sine, np.einsum("ij,ij->i", a, b)))


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def outward_normals(
    normals: FloatArray, vertices: FloatArray, faces: Indices, defects: list[str]
) -> FloatArray:
    """The file's normals on the outer side of its faces; those still behind are reported."""
    of_faces = face_normals(vertices, faces)
    agreement = np.einsum("ijk,ik->ij", normals[faces], of_faces)
    if agreement.mean() < 0:
        defects.append("inverted normals: they pointed against the faces and were turned")
        normals, agreement = -normals, -agreement
    behind = (agreement < 0).any(axis=1)
    if behind.any():
        defects.append(f"normals: {behind.sum()} faces have one that points behind them")
    return normals
