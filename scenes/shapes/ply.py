"""Read what trimesh cannot of PLY files: triangle strips, and binary faces of unlike length.

Source: Greg Turk, "The PLY Polygon File Format" (1994). Stanford's scans store strips.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from malus.scenes.core.arrays import AnyArray, Float64Array, IntArray
from malus.scenes.shapes.polygons import cut_polygons

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_END = re.compile(rb"(?:^|\n)end_header[^\n]*\n")
_UV_NAMES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
_LARGEST_HEADER = 1 << 16
_MOST_ROWS = 1 << 31

Lists = list[AnyArray]
Columns = dict[str, AnyArray | Lists]


@dataclass(frozen=True)
class Property:
    """A number of each row of an element, or a list of them with the type of its length."""

    name: str
    dtype: np.dtype[np.generic]
    length: np.dtype[np.generic] | None = None


@dataclass(frozen=True)
class Element:
    """A table of the file: vertices, faces, strips."""

    name: str
    rows: int
    properties: tuple[Property, ...]


@dataclass(frozen=True)
class MeshArrays:
    """A file's vertices (n, 3), triangles (m, 3), and its normals (n, 3) and uv (n, 2), if any.

    Examples
    --------
    >>> text = b"ply\\nformat ascii 1.0\\nelement vertex 4\\nproperty float x\\nproperty float y\\n"
    >>> text += b"property float z\\nelement tristrips 1\\nproperty list int int vertex_indices\\n"
    >>> mesh = read_ply(text + b"end_header\\n0 0 0\\n1 0 0\\n0 1 0\\n1 1 0\\n4 0 1 2 3\\n")
    >>> mesh.faces.tolist()
    [[0, 1, 2], [2, 1, 3]]
    """

    vertices: Float64Array
    faces: IntArray
    normals: Float64Array | None
    uv: Float64Array | None


def holds_strips(head: bytes) -> bool:
    """Whether the header of a PLY file tells of triangle strips.

    Examples
    --------
    >>> holds_strips(b"ply\\nelement tristrips 1\\nend_header\\n")
    True
    """
    return re.search(rb"\nelement[ \t]+tristrips[ \t]+0*[1-9]", _header(head)[0]) is not None


def read_ply(content: bytes) -> MeshArrays:
    """The triangles of a PLY file: of polygons, and of strips, which turn every other triangle.

    Raises
    ------
    UncutFace
        For a polygon that crosses itself.
    ValueError
        For a file that is cut, longer than its header tells, or without vertices.
    """
    header, start = _header(content)
    order, elements = _elements(header)
    rows = _AsciiRows(content[start:]) if not order else _BinaryRows(content, start)
    columns = {element.name: rows.columns(element) for element in elements}
    rows.check_end()
    vertex = columns.get("vertex", {})
    if not {"x", "y", "z"} <= set(vertex):
        raise ValueError("no vertices with x, y and z")
    vertices = np.asarray(_numbers(vertex, ("x", "y", "z")))
    faces = _polygons(vertices, columns.get("face", {}))
    triangles = [faces, _strips(columns.get("tristrips", {}))]
    normals = _numbers(vertex, ("nx", "ny", "nz"))
    uv = [_numbers(vertex, names) for names in _UV_NAMES]
    return MeshArrays(
        vertices,
        np.concatenate(triangles),
        normals,
        next((pair for pair in uv if pair is not None), None),
    )


def _header(content: bytes) -> tuple[bytes, int]:
    """The header with newlines alone between its lines, and where the data begin."""
    end = _END.search(content, 0, _LARGEST_HEADER)
    if end is None:
        return b"", 0
    return content[: end.end()].replace(b"\r", b""), end.end()


def _elements(header: bytes) -> tuple[str, list[Element]]:
    """Order of the bytes, empty for text, and the tables that the header declares."""
    order: str | None = None
    elements: list[Element] = []
    for line in header.decode("ascii", "replace").splitlines():
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            order = _ORDERS.get(words[1])
        elif words[:1] == ["element"] and len(words) == 3:
            rows = int(words[2])
            if not 0 <= rows <= _MOST_ROWS:
                raise ValueError(f"{rows} rows of an element")
            elements.append(Element(words[1], rows, ()))
        elif words[:1] == ["property"] and elements:
            last = elements[-1]
            added = (*last.properties, _property(words, order or ""))
            elements[-1] = Element(last.name, last.rows, added)
    if order is None:
        raise ValueError("no header with a known format")
    return order, elements


def _property(words: Sequence[str], order: str) -> Property:
    if len(words) not in (3, 5) or any(word not in _TYPES for word in _type_words(words)):
        raise ValueError(f"{' '.join(words)[:60]!r} for a property")
    types = [np.dtype(order + _TYPES[word]) for word in _type_words(words)]
    return Property(words[-1], types[-1], types[0] if len(types) > 1 else None)


def _type_words(words: Sequence[str]) -> Sequence[str]:
    """`float` of `property float x`, `uchar` and `int` of `property list uchar int name`."""
    return words[2:4] if words[1] == "list" else words[1:2]


class _Rows:
    """Reads tables one after the other."""

    def columns(self, element: Element) -> Columns:
        """The values of each property: an array (rows,), or a list of arrays for a list."""
        if all(part.length is None for part in element.properties):
            return self.plain(element)
        lists: dict[str, Lists] = {part.name: [] for part in element.properties}
        for _ in range(element.rows):
            for part in element.properties:
                lists[part.name].append(self.item(part))
        return dict(lists)

    def plain(self, element: Element) -> Columns:
        raise NotImplementedError

    def item(self, part: Property) -> AnyArray:
        raise NotImplementedError

    def check_end(self) -> None:
        raise NotImplementedError


class _AsciiRows(_Rows):
    """Tables in text."""

    def __init__(self, text: bytes) -> None:
        self._values, self._next = np.array(text.split(), dtype=np.float64), 0

    def _taken(self, count: int) -> AnyArray:
        self._next += count
        if count < 0 or self._next > len(self._values):
            raise ValueError("the file is cut")
        return self._values[self._next - count : self._next]

    def plain(self, element: Element) -> Columns:
        width = len(element.properties)
        table = self._taken(element.rows * width).reshape(element.rows, width)
        return {part.name: table[:, k] for k, part in enumerate(element.properties)}

    def item(self, part: Property) -> AnyArray:
        count = 1 if part.length is None else _count(self._taken(1)[0])
        return self._taken(count).astype(part.dtype)

    def check_end(self) -> None:
        if self._next < len(self._values):
            raise ValueError("the file is longer than its header tells")


class _BinaryRows(_Rows):
    """Tables in binary."""

    def __init__(self, content: bytes, start: int) -> None:
        self._content, self._next = content, start

    def _taken(self, dtype: np.dtype[np.generic], count: int) -> AnyArray:
        size = dtype.itemsize * count
        if count < 0 or self._next + size > len(self._content):
            raise ValueError("the file is cut")
        values = np.frombuffer(self._content, dtype, count, self._next)
        self._next += size
        return values

    def plain(self, element: Element) -> Columns:
        if not element.properties:
            return {}
        table = self._taken(
            np.dtype([(str(k), part.dtype) for k, part in enumerate(element.properties)]),
            element.rows,
        )
        return {part.name: table[str(k)] for k, part in enumerate(element.properties)}

    def item(self, part: Property) -> AnyArray:
        count = 1 if part.length is None else _count(self._taken(part.length, 1)[0])
        return self._taken(part.dtype, count)

    def check_end(self) -> None:
        if self._next < len(self._content):
            raise ValueError("the file is longer than its header tells")


def _count(value: float) -> int:
    if not 0 <= value < _MOST_ROWS:
        raise ValueError(f"a list of the length {value}")
    return int(value)


def _numbers(vertex: Columns, names: Sequence[str]) -> Float64Array | None:
    """Columns side by side (n, names), or None where one is missing."""
    if not set(names) <= set(vertex):
        return None
    return np.stack([np.ravel(np.asarray(vertex[name], np.float64)) for name in names], axis=-1)


def _indices(columns: Columns) -> list[IntArray]:
    """The lists of vertex indices, whose name is not the same in all files."""
    for name in ("vertex_indices", "vertex_index"):
        if name in columns:
            return [np.asarray(row, np.int64) for row in columns[name]]
    return []


def _polygons(vertices: Float64Array, face: Columns) -> IntArray:
    """Triangles (m, 3) of polygons: from the first corner, or cut where they are concave."""
    rows = _indices(face)
    cut = cut_polygons(vertices, rows)
    parts = [
        row[cut[place]]
        if place in cut
        else np.column_stack([np.full(len(row) - 2, row[0]), row[1:-1], row[2:]])
        for place, row in enumerate(rows)
        if len(row) > 2
    ]
    return np.concatenate(parts) if parts else np.zeros((0, 3), np.int64)


def _strips(tristrips: Columns) -> IntArray:
    """Triangles (m, 3) of strips, of which every other one runs the other way; −1 begins anew."""
    parts = []
    for row in _indices(tristrips):
        for strip in np.split(row, np.flatnonzero(row < 0)):
            run = strip[strip >= 0]
            triangles = np.column_stack([run[:-2], run[1:-1], run[2:]])
            triangles[1::2] = triangles[1::2, [1, 0, 2]]
            parts.append(triangles)
    joined = np.concatenate(parts) if parts else np.zeros((0, 3), np.int64)
    # Strips are joined by triangles that have one corner twice.
    return joined[(joined != np.roll(joined, 1, axis=1)).all(axis=1)]
