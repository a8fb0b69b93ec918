"""Read the triangles of mesh files, through trimesh where it reads their kind."""

from __future__ import annotations

import contextlib
import io
import logging
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError, reading
from malus.scenes.shapes.gltf import UnreadGltf, gltf_with_plain_numbers
from malus.scenes.shapes.ply import MeshArrays, holds_strips, read_ply
from malus.scenes.shapes.polygons import UncutFace, cut_polygons
from malus.scenes.shapes.text_meshes import (
    WrongCorner,
    obj_with_triangles,
    off_with_triangles,
    stl_by_its_count,
)

LARGEST_FILE_BYTES = 2 << 30

_OPTIONAL_READERS = {
    "3mf": "lxml and networkx",
    "dae": "pycollada",
    "zae": "pycollada",
    "xaml": "lxml",
    "3dxml": "lxml and networkx",
    "step": "cascadio",
    "stp": "cascadio",
}
"""What trimesh needs for formats that it does not read alone."""

_WHOLE = "check that the file is whole and needs no other file"
_HINTS = {"gltf": "export it as .glb, or with embedded buffers: no other file is opened"}

_REWRITTEN = {
    "obj": obj_with_triangles,
    "off": off_with_triangles,
    "stl": stl_by_its_count,
    "glb": gltf_with_plain_numbers,
    "gltf": gltf_with_plain_numbers,
}
"""Formats of which trimesh would read another mesh."""

_NOWHERE = logging.NullHandler()


def read_mesh_file(file: Path) -> MeshArrays:
    """All meshes of a file as one, where its scene places them; raises InputError otherwise."""
    from trimesh.exchange.load import mesh_formats

    kind = file.suffix.lower().lstrip(".")
    formats = sorted(mesh_formats())
    _check_file(file)
    if kind not in formats:
        expected = f"a mesh file ({', '.join(formats)})"
        hint = "convert it, to PLY say"
        if kind in _OPTIONAL_READERS:
            hint = f"install {_OPTIONAL_READERS[kind]}, with which trimesh reads it, or {hint}"
        raise InputError(f"mesh {file}", expected, repr(file.suffix), hint)
    parts = _parts_of_ply(file) if kind == "ply" else _parts_of_scene(file, kind)
    if not parts:
        hint = "give a file that holds triangles"
        raise InputError(f"mesh {file}", "a mesh with faces", "no faces", hint)
    return _joined(parts)


def _parts_of_ply(file: Path) -> list[MeshArrays]:
    """The mesh of a PLY file, by our own reader where trimesh does not read its kind."""
    with reading(f"mesh {file}", "a readable file", "check the path"), file.open("rb") as stream:
        strips = holds_strips(stream.read(1 << 16))
    try:
        if not strips:
            return _parts_of_scene(file, "ply")
    except InputError:
        # Binary faces of unlike length are a wrong length of the file to trimesh.
        strips = True
    with _reading(file, "ply"):
        mesh = read_ply(file.read_bytes())
    return [mesh] if len(mesh.faces) else []


def _parts_of_scene(file: Path, kind: str) -> list[MeshArrays]:
    """Every mesh that trimesh reads in a file."""
    from trimesh.exchange.load import load_scene

    # What trimesh logs of missing textures would go to the error stream.
    logging.getLogger("trimesh").addHandler(_NOWHERE)
    # NaN and infinity pass here without a warning: _centred refuses them by name.
    with _reading(file, kind), file.open("rb") as stream:
        rewrite = _REWRITTEN.get(kind)
        source = stream if rewrite is None else io.BytesIO(rewrite(stream.read()))
        # An empty resolver: nothing outside this one file is opened.
        scene = load_scene(source, file_type=kind, resolver={}, process=False)
        if kind == "ply" and _has_wrong_fans(scene):
            raise ValueError("concave faces")  # which our own reader cuts
        return list(_parts(scene))


@contextlib.contextmanager
def _reading(file: Path, kind: str) -> Iterator[None]:
    """Turn what goes wrong on a broken file into one InputError, without warnings."""
    # NaN and infinity pass here without a warning: _centred refuses them by name.
    with (
        reading(f"mesh {file}", f"a readable {kind} file", _HINTS.get(kind, _WHOLE)),
        np.errstate(all="ignore"),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        try:
            yield
        except UncutFace as face:
            where, expected = f"mesh {file}, face {face.number}", "a face that can be cut"
            hint = "cut it into triangles in the program that wrote the file"
            raise InputError(where, expected, str(face), hint) from None
        except UnreadGltf as part:
            expected = "a mesh of plain triangles, at rest"
            raise InputError(f"mesh {file}", expected, str(part), part.hint) from None
        except WrongCorner as face:
            expected = f"vertices from 1 to {face.vertices} in face {face.number}"
            hint = "count the vertices of the file from 1, or back from the face as -1, -2, ..."
            raise InputError(f"mesh {file}", expected, str(face.index), hint) from None


def _has_wrong_fans(scene: Any) -> bool:
    """Whether trimesh cut a concave polygon of a PLY file into a fan."""
    for mesh in scene.geometry.values():
        elements = mesh.metadata.get("_ply_raw", {})
        faces = elements.get("face", {}).get("data")
        names = getattr(getattr(faces, "dtype", None), "names", None) or faces or ()
        for name in {"vertex_indices", "vertex_index"}.intersection(names):
            rows = faces[name]
            if getattr(rows.dtype, "names", None):  # lists of one length, behind that length
                rows = rows["f1"]
            if rows.ndim == 2 and rows.shape[1] == 3:
                continue
            data = elements["vertex"]["data"]
            vertices = np.stack([np.ravel(data[axis]) for axis in "xyz"], axis=-1)
            if cut_polygons(vertices.astype(np.float64), rows):
                return True
    return False


def _parts(scene: Any) -> Iterator[MeshArrays]:
    """Every mesh of a trimesh scene, in its place; trimesh's Scene.to_mesh loses the normals."""
    for node in scene.graph.nodes_geometry:
        placement, name = scene.graph[node]
        mesh = scene.geometry[name]
        if len(getattr(mesh, "faces", ())):
            # Asking for vertex_normals would compute some; the file's own are in the cache.
            normals = mesh.vertex_normals if "vertex_normals" in mesh._cache else None
            uv = getattr(mesh.visual, "uv", None)
            yield _placed(np.asarray(placement), mesh.vertices, mesh.faces, normals, uv)


def _placed(
    placement: Float64Array, vertices: Any, faces: Any, normals: Any, uv: Any
) -> MeshArrays:
    """One mesh in the scene's coordinates; a reflection also turns the winding of the faces."""
    linear, shift = placement[:3, :3], placement[:3, 3]
    reflected = np.linalg.det(linear) < 0
    faces = np.asarray(faces, dtype=np.int64)
    return MeshArrays(
        np.asarray(vertices, dtype=np.float64) @ linear.T + shift,
        faces[:, ::-1] if reflected else faces,
        # A normal is a covector: it goes with the inverse transpose.
        None if normals is None else np.asarray(normals, dtype=np.float64) @ np.linalg.inv(linear),
        uv if np.shape(uv) == (len(vertices), 2) and np.isfinite(uv).all() else None,
    )


def _joined(parts: list[MeshArrays]) -> MeshArrays:
    """All parts as one mesh; normals and uv only where every part has them."""
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    normals = [part.normals for part in parts if part.normals is not None]
    uv = [part.uv for part in parts if part.uv is not None]
    return MeshArrays(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate(normals) if len(normals) == len(parts) else None,
        np.concatenate(uv) if len(uv) == len(parts) else None,
    )


def _check_file(file: Path) -> None:
    where = f"mesh {file}"
    with reading(where, "a readable file", "check the path"):
        is_other = file.exists() and not file.is_file()
        size = file.stat().st_size
    if is_other:
        raise InputError(where, "a file", "a folder or device", "check the path")
    if size > LARGEST_FILE_BYTES:
        limit = f"at most {LARGEST_FILE_BYTES / 2**30:g} GiB"
        raise InputError(where, limit, f"{size / 2**30:.1f} GiB", "simplify the mesh")
