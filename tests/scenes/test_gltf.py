"""glTF as programs of the web write it: from bytes that are packed here after the specification."""

from __future__ import annotations

import base64
import copy
import json
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from malus.scenes import InputError
from malus.scenes.shapes.mesh_files import read_mesh_file

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 0.5, 0], [0, 0, 0.25]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
UV = np.array([[0, 0], [1, 0], [0, 1], [0.5, 0.25]])
FLOAT, INT16, UINT16, UINT8 = (5126, "<f4"), (5122, "<i2"), (5123, "<u2"), (5121, "<u1")


class Gltf:
    """A tetrahedron whose accessors are changed before it is written."""

    def __init__(self) -> None:
        self.data = b""
        self.tree: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [],
            "materials": [{}],
            "accessors": [],
            "bufferViews": [],
        }
        self.position = self.accessor(CORNERS, FLOAT)
        self.indices = self.accessor(FACES.reshape(-1, 1), UINT16)
        self.add_mesh(self.position)

    def view(self, values: np.ndarray, dtype: str, gap: int = 0) -> int:
        """A view of rows, each followed by so many bytes that belong to nobody."""
        rows = b"".join(row.astype(dtype).tobytes() + b"\xee" * gap for row in values)
        self.data += b"\xee" * (-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(rows)}
        if gap:
            view["byteStride"] = len(rows) // len(values)
        self.data += rows
        self.tree["bufferViews"].append(view)
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, kind: tuple[int, str], gap: int = 0, **keys: Any) -> int:
        shape = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}[values.shape[1]]
        view = self.view(values, kind[1], gap)
        self.tree["accessors"].append(
            {"bufferView": view, "componentType": kind[0], "count": len(values), "type": shape}
            | keys
        )
        return len(self.tree["accessors"]) - 1

    def add_mesh(self, position: int, **attributes: int) -> dict[str, Any]:
        primitive = {
            "attributes": {"POSITION": position} | attributes,
            "indices": self.indices,
            "material": 0,
        }
        self.tree["meshes"].append({"primitives": [primitive]})
        return primitive

    def saved(self, path: Path) -> Path:
        tree = copy.deepcopy(self.tree)
        tree["buffers"] = [{"byteLength": len(self.data)}]
        if path.suffix == ".gltf":
            text = base64.b64encode(self.data).decode()
            tree["buffers"][0]["uri"] = f"data:application/gltf-buffer;base64,{text}"
            path.write_text(json.dumps(tree))
            return path
        head, data = json.dumps(tree).encode(), self.data + b"\0" * (-len(self.data) % 4)
        head += b" " * (-len(head) % 4)
        total = 12 + 8 + len(head) + 8 + len(data)
        path.write_bytes(
            struct.pack("<4sII", b"glTF", 2, total)
            + (struct.pack("<I4s", len(head), b"JSON") + head)
            + (struct.pack("<I4s", len(data), b"BIN\0") + data)
        )
        return path


@pytest.mark.parametrize("name", ["a.glb", "a.gltf"])
def test_integers_that_stand_for_shares_are_divided(tmp_path: Path, name: str) -> None:
    """Taken for lengths they made one object 32767 times as large as the other."""
    file = Gltf()
    shares = file.accessor(np.rint(CORNERS * 32767), INT16, gap=2, normalized=True)
    uv = file.accessor(np.rint(UV * 65535), UINT16, normalized=True)
    file.add_mesh(shares, TEXCOORD_0=uv)
    plain = file.accessor(UV, FLOAT)
    file.tree["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = plain
    file.tree["nodes"] = [{"mesh": 0}, {"mesh": 1, "scale": [2, 2, 2]}]
    file.tree["scenes"][0]["nodes"] = [0, 1]
    file.tree["extensionsRequired"] = ["KHR_mesh_quantization"]
    mesh = read_mesh_file(file.saved(tmp_path / name))
    rounding = 1e-4  # half a code of 1/32767, twice as large in the second object
    by_size = sorted(mesh.vertices.reshape(2, 4, 3), key=np.max)
    np.testing.assert_allclose(by_size, [CORNERS, 2 * CORNERS], atol=rounding)
    assert mesh.uv is not None
    upwards = UV * [1, -1] + [0, 1]  # in glTF v runs down from the upper edge
    np.testing.assert_allclose(mesh.uv.reshape(2, 4, 2), [upwards, upwards], atol=rounding)
    np.testing.assert_array_equal(mesh.faces, np.concatenate([FACES, FACES + 4]))


def test_integers_that_are_lengths_stay(tmp_path: Path) -> None:
    file = Gltf()
    lengths = file.accessor(CORNERS * 4, INT16, gap=2)
    file.tree["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = lengths
    np.testing.assert_array_equal(
        read_mesh_file(file.saved(tmp_path / "a.glb")).vertices, 4 * CORNERS
    )


@pytest.mark.parametrize("from_zeros", [False, True])
def test_a_sparse_accessor_replaces_some_values(tmp_path: Path, from_zeros: bool) -> None:
    file = Gltf()
    position = file.tree["accessors"][file.position]
    places, values = np.array([[1], [3]]), np.array([[7.0, 0, 0], [0, 0, 9.0]])
    position["sparse"] = {
        "count": 2,
        "indices": {"bufferView": file.view(places, "<u1"), "componentType": UINT8[0]},
        "values": {"bufferView": file.view(values, "<f4")},
    }
    expected = np.zeros_like(CORNERS) if from_zeros else CORNERS.copy()
    expected[[1, 3]] = values
    if from_zeros:
        del position["bufferView"]
    vertices = read_mesh_file(file.saved(tmp_path / "a.glb")).vertices
    np.testing.assert_array_equal(vertices, expected)


def _required(name: str) -> dict[str, Any]:
    return {"extensionsUsed": [name], "extensionsRequired": [name]}


INSTANCES = {"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {}}}}


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        (_required("KHR_draco_mesh_compression"), "export it without compression"),
        (_required("EXT_meshopt_compression"), "the required extension EXT_meshopt_compression"),
        (_required("VENDOR_hull"), "the required extension VENDOR_hull"),
        ({"nodes": [{"mesh": 0} | INSTANCES]}, "export every instance as an object of its own"),
        ({"nodes": [{"mesh": 0, "skin": 0}]}, "found a skin, which moves the vertices"),
        ({"nodes": [{"mesh": 0, "weights": [0, 0.5]}]}, "found morph targets"),
    ],
)
def test_what_would_be_left_out_is_refused(tmp_path: Path, keys: dict[str, Any], told: str) -> None:
    file = Gltf()
    file.tree |= keys
    with pytest.raises(InputError, match=re.escape(told)):
        read_mesh_file(file.saved(tmp_path / "a.glb"))


def test_what_leaves_triangles_alone_is_read(tmp_path: Path) -> None:
    file = Gltf()
    file.tree |= _required("KHR_materials_ior")
    file.tree["nodes"][0]["weights"] = [0.0]
    file.tree["nodes"].append({"skin": 0})
    mesh = read_mesh_file(file.saved(tmp_path / "a.glb"))
    np.testing.assert_array_equal(mesh.vertices, CORNERS)


def test_a_fan_beside_triangles_is_refused(tmp_path: Path) -> None:
    """It was left out: half of an object was taken for all of it."""
    file = Gltf()
    file.tree["meshes"][0]["primitives"].append(file.add_mesh(file.position) | {"mode": 6})
    with pytest.raises(InputError, match="found a triangle fan; export it as triangles"):
        read_mesh_file(file.saved(tmp_path / "a.glb"))


def test_the_first_version_is_refused_by_name(tmp_path: Path) -> None:
    path = Gltf().saved(tmp_path / "a.glb")
    data = bytearray(path.read_bytes())
    data[4] = 1
    path.write_bytes(data)
    with pytest.raises(InputError, match="found version 1 of glTF; export it as glTF 2"):
        read_mesh_file(path)
