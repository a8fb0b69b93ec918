"""Read mesh files through trimesh, repair what can be repaired, and describe their defects."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from malus.scenes.core.arrays import BoolArray, Float64Array, IntArray
from malus.scenes.core.errors import InputError
from malus.scenes.shapes.geometry import TriangleMesh, fitted, unit_vectors
from malus.scenes.shapes.mesh_files import read_mesh_file
from malus.scenes.shapes.ply import MeshArrays
from malus.scenes.shapes.shapes import Axis, Crease, Shading


def merged_indices(vertices: Float64Array, distance: float) -> IntArray:
    """Index of the first vertex in the same cubic cell, for each vertex (n, 3) in the unit sphere.

    Cells have edges of `distance`.

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


def is_thin(vertices: Float64Array, faces: IntArray, height: float) -> BoolArray:
    """Whether triangles (m, 3) have an index twice or a least height below `height`; bool (m,).

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> is_thin(corners, np.array([[0, 1, 2], [0, 1, 3], [0, 0, 3]]), 1e-7).tolist()
    [True, False, True]
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return np.asarray(repeated | (twice_area <= height * longest))


def defects_of_edges(faces: IntArray) -> list[str]:
    """Descriptions of bad edges of triangles (m, 3): open, of many faces, or of unlike winding.

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
    bad_edges = {
        "open: {} edges have only one face": sharing == 1,
        "not a surface: {} edges have more than two faces": sharing > 2,
        # Of two faces that agree, one runs along their edge forwards and one backwards.
        "inconsistent: {} edges between faces wound in opposite senses": (sharing == 2)
        & (net != 0),
    }
    return [words.format(bad.sum()) for words, bad in bad_edges.items() if bad.any()]


def signed_volume(vertices: Float64Array, faces: IntArray) -> float:
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


def face_normals(vertices: Float64Array, faces: IntArray) -> Float64Array:
    """Unit normals (m, 3) of triangles wound anticlockwise; NaN for one without area.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> face_normals(corners, np.array([[0, 1, 2]])).tolist()
    [[0.0, 0.0, 1.0]]
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return unit_vectors(np.cross(b - a, c - a))


def angle_weighted_normals(vertices: Float64Array, faces: IntArray) -> Float64Array:
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
    return unit_vectors(np.where(cancelled[:, None], last, sums))


def smooth_groups(vertices: Float64Array, faces: IntArray, crease: float) -> IntArray:
    """For each corner of triangles (m, 3), the number of the smooth part of the surface round it.

    Corners at one vertex share a number where edges lead from one face to the other that have two
    faces whose normals differ by at most `crease`, radians.

    Examples
    --------
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> faces = np.array([[0, 1, 2], [0, 3, 1]])  # at right angles
    >>> [1 + int(smooth_groups(corners, faces, angle).max()) for angle in (1.0, 2.0)]
    [6, 4]
    """
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(start, end) * (int(faces.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    one, other = order[first[count == 2]], order[first[count == 2] + 1]
    normals = face_normals(vertices, faces)
    angle = _angle(normals[one // 3], normals[other // 3])
    smooth = angle <= crease
    one, other = one[smooth], other[smooth]
    # Edge k of a face runs from its corner k to the next: two faces share both of its ends.
    ends = [np.stack([edge, edge - edge % 3 + (edge + 1) % 3]) for edge in (one, other)]
    turned = start[one] != start[other]
    ends[1] = np.where(turned, ends[1][::-1], ends[1])
    size = faces.size
    links = sparse.coo_array(
        (np.ones(ends[0].size, bool), (ends[0].ravel(), ends[1].ravel())), shape=(size, size)
    )
    return connected_components(links, directed=False)[1].reshape(-1, 3).astype(np.int64)


def _angle(a: Float64Array, b: Float64Array) -> Float64Array:
    # atan2 keeps its precision for thin angles, where arccos loses half the digits.
    sine = np.linalg.norm(np.cross(a, b), axis=1)
    return np.asarray(np.arctan2(sine, np.einsum("ij,ij->i", a, b)))


def outward_normals(
    normals: Float64Array, vertices: Float64Array, faces: IntArray, defects: list[str]
) -> Float64Array:
    """Normals (n, 3) turned to the outer side of the faces; adds what was wrong to `defects`."""
    of_faces = face_normals(vertices, faces)
    agreement = np.einsum("ijk,ik->ij", normals[faces], of_faces)
    if agreement.mean() < 0:
        defects.append("inverted normals: they pointed against the faces and were turned")
        normals, agreement = -normals, -agreement
    behind = (agreement < 0).any(axis=1)
    if behind.any():
        defects.append(f"normals: {behind.sum()} faces have one that points behind them")
    return normals


NO_NORMALS = "no normals in the file"
"""A defect only where the file's normals are asked for."""

HUGE_FACES = 5_000_000
"""More faces than this are reported as a defect."""

_MERGE_DISTANCE = 2e-6
"""In the unit sphere: thirty float32 steps, a thousandth of a pixel of an image 1000 wide."""

_THINNEST = 1e-7
"""Height of a triangle in the unit sphere below which float32 cannot hold its orientation."""


_TURNS: dict[Axis, Float64Array] = {
    "x": np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "y": np.eye(3),
    "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
}
"""Rotations that turn an axis of a file to +y: about z, and about x as programs export it."""


def load_mesh(
    path: str | Path, shading: Shading = "smooth", up: Axis = "y"
) -> tuple[TriangleMesh, list[str]]:
    """Read a mesh file, centred and scaled to the unit sphere, and describe its defects.

    Parameters
    ----------
    path : str or Path
        Any mesh format trimesh reads: OBJ, PLY, STL, GLB, ... Files that it refers to (materials,
        textures, buffers) are never opened. Of glTF skins, morph targets, triangle fans, instances
        and compression are refused.
    shading : {"smooth", "flat", "file"} or Crease
        Normals: averages over the faces round a vertex weighted by their angles, none, or the
        file's own; with a `Crease`, averages that do not cross edges sharper than it.
    up : {"x", "y", "z"}
        Axis of the file that becomes +y.

    Returns
    -------
    The mesh and a list of defects, empty for a sound one. Degenerate faces are dropped and closed
    meshes that are inside out are turned, both reported; everything else is only reported.

    Raises
    ------
    InputError
        For a file that is missing, too large, unreadable or no mesh; a mesh without faces or
        extent, with NaN, infinite or missing vertices; "file" where the file has no usable normals.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "one.obj")
    ...     _ = file.write_text("v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n")
    ...     mesh, defects = load_mesh(file)
    >>> len(mesh.faces), defects[0]
    (1, 'open: 3 edges have only one face')
    """
    file = Path(path)
    if not isinstance(shading, Crease) and shading not in ("smooth", "flat", "file"):
        expected, hint = "shading smooth, flat or file, or a Crease", "choose one of them"
        raise InputError(f"mesh {file}", expected, repr(shading), hint)
    if up not in _TURNS:
        raise InputError(f"mesh {file}", "up x, y or z", repr(up), "choose one of them")
    arrays = _centred(_turned(read_mesh_file(file), up), file)
    if shading == "file" and arrays.normals is None:
        raise InputError(f"mesh {file}", "normals in the file", "none", "choose shading smooth")
    return _without_defects(arrays, shading, file)


def _turned(arrays: MeshArrays, up: Axis) -> MeshArrays:
    """The mesh with one of its axes turned to +y."""
    if up == "y":
        return arrays
    turn = _TURNS[up].T
    normals = None if arrays.normals is None else arrays.normals @ turn
    return replace(arrays, vertices=arrays.vertices @ turn, normals=normals)


def _centred(arrays: MeshArrays, file: Path) -> MeshArrays:
    """The mesh without unused vertices, checked and moved into the unit sphere."""
    where, count = f"mesh {file}", len(arrays.vertices)
    if arrays.faces.min() < 0 or arrays.faces.max() >= count:
        found = f"faces that refer to others than its {count}"
        raise InputError(where, "faces between existing vertices", found, "export it again")
    used, faces = np.unique(arrays.faces, return_inverse=True)
    vertices = arrays.vertices[used]
    bad = ~np.isfinite(vertices).all(axis=1)
    if bad.any():
        found = f"{bad.sum()} of {len(vertices)} vertices with NaN or infinity"
        raise InputError(where, "finite coordinates", found, "export it again")
    try:
        vertices = fitted(vertices)
    except ValueError as error:
        found = str(error).rpartition("found ")[2]
        hint = "give a mesh that is larger than a point"
        raise InputError(where, "a positive finite extent", found, hint) from None
    normals = None if arrays.normals is None else arrays.normals[used]
    uv = None if arrays.uv is None else arrays.uv[used]
    return MeshArrays(vertices, faces.reshape(-1, 3), normals, uv)


def _without_defects(
    arrays: MeshArrays, shading: Shading, file: Path
) -> tuple[TriangleMesh, list[str]]:
    """The mesh without degenerate faces and not inside out, and the defects that it had."""
    defects: list[str] = []
    merged_to = merged_indices(arrays.vertices, _MERGE_DISTANCE)
    merged = merged_to[arrays.faces]
    sound = ~is_thin(arrays.vertices, merged, _THINNEST)
    if not sound.all():
        defects.append(f"degenerate: {(~sound).sum()} faces without area dropped")
    if not sound.any():
        raise InputError(f"mesh {file}", "faces with area", "none", "give another mesh")
    merged, faces = merged[sound], arrays.faces[sound]
    edge_defects = defects_of_edges(merged)
    defects += edge_defects
    if not edge_defects and signed_volume(arrays.vertices, merged) < 0:
        defects.append("inverted: the faces pointed inwards and were turned")
        merged, faces = merged[:, ::-1], faces[:, ::-1]
    if arrays.normals is None:
        defects.append(NO_NORMALS)
    if len(merged) > HUGE_FACES:
        defects.append(f"huge: {len(merged)} faces")
    if shading == "file":
        assert arrays.normals is not None  # load_mesh refused it
        unit_normals = _unit_normals(arrays.normals, faces, file)
        normals = outward_normals(unit_normals, arrays.vertices, faces, defects)
        return _compact(arrays.vertices, faces, normals, arrays.uv), defects
    if isinstance(shading, Crease):
        return _creased(arrays, merged, faces, shading), defects
    smooth = angle_weighted_normals(arrays.vertices, merged) if shading == "smooth" else None
    if arrays.uv is None:
        return _compact(arrays.vertices, merged, smooth), defects
    # At a seam of the texture one position has several coordinates: its vertices are not merged.
    smooth = None if smooth is None else smooth[merged_to]
    return _compact(arrays.vertices[merged_to], faces, smooth, arrays.uv), defects


def _creased(arrays: MeshArrays, merged: IntArray, faces: IntArray, crease: Crease) -> TriangleMesh:
    """A mesh with a vertex for each smooth part round a point, and for each place in the texture.

    `merged` (m, 3) are indices after vertices of one position were merged, `faces` before.
    """
    groups = smooth_groups(arrays.vertices, merged, math.radians(crease.crease_deg))
    positions = np.empty((int(groups.max()) + 1, 3))
    positions[groups] = arrays.vertices[merged]
    normals = angle_weighted_normals(positions, groups)
    if arrays.uv is None:
        return _compact(positions, groups, normals)
    keys = np.stack([groups.ravel(), faces.ravel()], axis=1)
    (group, vertex), corners = _unique_rows(keys)
    return _compact(positions[group], corners.reshape(-1, 3), normals[group], arrays.uv[vertex])


def _unique_rows(keys: IntArray) -> tuple[IntArray, IntArray]:
    """Columns (2, distinct rows) of the distinct rows of pairs (n, 2), and where each is (n,)."""
    rows, where = np.unique(keys, axis=0, return_inverse=True)
    return rows.T, where.ravel()


def _unit_normals(normals: Float64Array, faces: IntArray, file: Path) -> Float64Array:
    """The file's normals at unit length; raises InputError where one of a face has no direction."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    bad = ~(np.isfinite(length[faces]) & (length[faces] > 0)).all(axis=(1, 2))
    if bad.any():
        found = f"{bad.sum()} faces with a normal that is zero, NaN or infinite"
        raise InputError(f"mesh {file}", "usable normals", found, "choose shading smooth")
    return np.asarray(normals / np.where(length > 0, length, 1.0))


def _compact(
    vertices: Float64Array,
    faces: IntArray,
    normals: Float64Array | None,
    uv: Float64Array | None = None,
) -> TriangleMesh:
    """A mesh in single precision of the vertices that faces use."""
    used, renumbered = np.unique(faces, return_inverse=True)
    return TriangleMesh(
        vertices[used].astype(np.float32),
        renumbered.reshape(-1, 3).astype(np.uint32),
        None if normals is None else normals[used].astype(np.float32),
        None if uv is None else uv[used].astype(np.float32),
    )
