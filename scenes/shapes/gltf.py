"""Rewrite glTF files that trimesh would read as another mesh, and refuse what neither can read.

It takes integers that stand for -1 to 1 or 0 to 1 for lengths, and reads a sparse accessor without
the values that it replaces. Fans, instances, poses and unknown extensions it leaves out.
"""

from __future__ import annotations

import base64
import json
import struct
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any

import numpy as np

from malus.scenes.core.arrays import AnyArray

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_FLOAT, _UINT32 = 5126, 5125
_FAN = 6
_GLB_HEAD = 20
"""Bytes of a .glb before its JSON: mark, version, length, and length and kind of the JSON."""
_USED = ("POSITION", "NORMAL", "TEXCOORD_0")
_HARMLESS = (
    "KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp",
    "KHR_mesh_quantization", "MSFT_texture_dds",
)  # fmt: skip
"""Required extensions, or how their names begin, that leave the triangles what they are."""
_DRACO, _INSTANCES = "KHR_draco_mesh_compression", "EXT_mesh_gpu_instancing"
_HINTS = {
    _DRACO: "export it without compression, or install DracoPy",
    _INSTANCES: "export every instance as an object of its own",
}
_APPLY = "apply the pose in the program that wrote the file, and export it again"


class UnreadGltf(ValueError):
    """What of a glTF file is not read; `hint` says what to do about it."""

    def __init__(self, words: str, hint: str) -> None:
        super().__init__(words)
        self.hint = hint


def gltf_with_plain_numbers(content: bytes) -> bytes:
    """A glTF or GLB file whose vertices and indices are plain floats and integers.

    Source: Khronos, glTF 2.0 specification, sections 3.6.2 (accessors) and 3.7 (meshes).

    Raises
    ------
    UnreadGltf
        For triangles that are compressed, a fan, instances by extension, a skin or morph targets.
    ValueError
        For a file that is none.
    """
    is_binary = content[:4] == b"glTF"
    tree, rest = _of_glb(content) if is_binary else (json.loads(content), b"")
    _check(tree)
    buffers = _Buffers(tree, rest[8:])
    for primitive in _primitives(tree):
        attributes = primitive["attributes"]
        for name in [name for name in _USED if name in attributes]:
            buffers.make_plain(attributes[name], _FLOAT)
        if "indices" in primitive:
            buffers.make_plain(primitive["indices"], _UINT32)
    if not buffers.added:
        return content
    buffers.append()
    text = json.dumps(tree).encode()
    return _glb(text, rest) if is_binary else text


def _of_glb(content: bytes) -> tuple[Any, bytes]:
    """The JSON of a .glb, and the chunks behind it."""
    version, _, length, kind = struct.unpack_from("<III4s", content, 4)
    if version != 2:
        raise UnreadGltf(f"version {version} of glTF", "export it as glTF 2")
    end = _GLB_HEAD + length
    if kind != b"JSON" or end > len(content):
        raise ValueError("no JSON at its beginning, or a part of it")
    return json.loads(content[_GLB_HEAD:end]), content[end:]


def _glb(text: bytes, rest: bytes) -> bytes:
    text += b" " * (-len(text) % 4)
    total = _GLB_HEAD + len(text) + len(rest)
    return struct.pack("<4sIII4s", b"glTF", 2, total, len(text), b"JSON") + text + rest


def _primitives(tree: Any) -> list[Any]:
    return [part for mesh in tree.get("meshes", []) for part in mesh["primitives"]]


def _check(tree: Any) -> None:
    """Raises UnreadGltf for what would be left out, or stand elsewhere, in silence."""
    for name in tree.get("extensionsRequired", []):
        is_read = name.startswith(_HARMLESS) or (name == _DRACO and find_spec("DracoPy"))
        if not is_read:
            hint = _HINTS.get(name, "export it without this extension")
            raise UnreadGltf(f"the required extension {name}", hint)
    for node in tree.get("nodes", []):
        if _INSTANCES in node.get("extensions", {}):
            raise UnreadGltf(f"the extension {_INSTANCES}", _HINTS[_INSTANCES])
        if "skin" in node and "mesh" in node:
            raise UnreadGltf("a skin, which moves the vertices by a skeleton", _APPLY)
        _check_weights(node)
    for mesh in tree.get("meshes", []):
        _check_weights(mesh)
    if any(part.get("mode") == _FAN for part in _primitives(tree)):
        raise UnreadGltf("a triangle fan", "export it as triangles")


def _check_weights(owner: Any) -> None:
    if any(owner.get("weights", [])):
        raise UnreadGltf("morph targets, which move the vertices", _APPLY)


@dataclass
class _Buffers:
    """Buffers of a file, `binary` that of a .glb, and what is added to them."""

    tree: Any
    binary: bytes
    added: bytearray = field(default_factory=bytearray)
    decoded: dict[int, bytes] = field(default_factory=dict)

    def make_plain(self, number: int, component: int) -> None:
        """Replace an accessor that is sparse or normalised by one of floats, or of indices."""
        accessor = self.tree["accessors"][number]
        is_normalised = accessor.get("normalized", False) and accessor["componentType"] != _FLOAT
        if not is_normalised and "sparse" not in accessor:
            return
        values = self._values(accessor)
        if is_normalised:
            largest = np.iinfo(values.dtype).max
            values = np.maximum(values.astype(np.float64) / largest, -1.0)
        data = values.astype(_TYPES[component]).tobytes()
        view = {
            "buffer": len(self.tree["buffers"]),
            "byteOffset": len(self.added),
            "byteLength": len(data),
        }
        self.added += data
        self.tree["bufferViews"].append(view)
        self.tree["accessors"][number] = {
            "bufferView": len(self.tree["bufferViews"]) - 1,
            "componentType": component,
            "count": accessor["count"],
            "type": accessor["type"],
        }

    def append(self) -> None:
        """Write what was added as one more buffer."""
        data = base64.b64encode(self.added).decode()
        uri = f"data:application/octet-stream;base64,{data}"
        self.tree["buffers"].append({"byteLength": len(self.added), "uri": uri})

    def _values(self, accessor: Any) -> AnyArray:
        """Values (count, components) of an accessor, those that a sparse one replaces too."""
        dtype, width = np.dtype(_TYPES[accessor["componentType"]]), _WIDTHS[accessor["type"]]
        values: AnyArray = np.zeros((accessor["count"], width), dtype)
        if "bufferView" in accessor:
            values = self._rows(accessor, dtype, accessor["count"], width)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            counted = np.dtype(_TYPES[sparse["indices"]["componentType"]])
            places = self._rows(sparse["indices"], counted, sparse["count"], 1)[:, 0]
            values[places] = self._rows(sparse["values"], dtype, sparse["count"], width)
        return values

    def _rows(self, part: Any, dtype: np.dtype[Any], count: int, width: int) -> AnyArray:
        """A copy of the numbers (count, width) in a view of a buffer."""
        view = self.tree["bufferViews"][part["bufferView"]]
        start = view.get("byteOffset", 0) + part.get("byteOffset", 0)
        strides = (view.get("byteStride", dtype.itemsize * width), dtype.itemsize)
        data = self._buffer(view["buffer"])
        return np.ndarray((count, width), dtype, data, start, strides).copy()

    def _buffer(self, number: int) -> bytes:
        if number not in self.decoded:
            uri = self.tree["buffers"][number].get("uri")
            if uri is not None and "base64," not in uri:
                raise KeyError(uri)  # another file, none of which is opened
            in_text = b"" if uri is None else base64.b64decode(uri.partition("base64,")[2])
            self.decoded[number] = self.binary if uri is None else in_text
        return self.decoded[number]
