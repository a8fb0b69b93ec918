"""Rewrite OBJ, OFF and STL files that trimesh would read as another mesh.

It cuts every polygon into a fan, which a concave one is not. Of OBJ it counts negative indices from
the end of the file instead of from where they stand, takes index 0 for the last vertex, and drops
lines that are indented or have tabs. A binary STL of another length than its header says it takes
for text without faces.
"""

from __future__ import annotations

import codecs
import re
from dataclasses import dataclass, field

import numpy as np

from malus.scenes.shapes.polygons import cut_polygons

_MARK = b"\xef\xbb\xbf"
"""What some programs write before UTF-8."""
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""And before UTF-16, as PowerShell does."""
_LINE_END = re.compile(rb"\r\n?")
_CONTINUED = re.compile(rb"\\\n")
_NO_ELEMENT = re.compile(rb"(?m)^ +| *#[^\n]*")
"""Blanks before a line, and comments."""
_SUSPECT = re.compile(rb"(?m)^f(?:(?: +[^ \n]+){4}|[^\n]*[ /]-)")
_ELEMENT = re.compile(rb"(?m)^(v|vt|vn|f)( [^\n]*)")
_VERTEX = re.compile(rb"(?m)^v ")
_FACE = re.compile(rb"(?m)^f ([^\n]*)")
_NO_POSITION = re.compile(rb"/[^ \n]*")
"""Texture coordinate and normal of a corner."""
_COMMENT = re.compile(r"#[^\n]*")


_STL_HEAD, _STL_TRIANGLE = 84, 50
"""Bytes of a binary STL file before its triangles, which end with their number, and of each."""


class WrongCorner(ValueError):
    """A face of an OBJ file with an index that no vertex has.

    Attributes
    ----------
    number, index, vertices : int
        Number of the face from 1, its wrong index, and the number of vertices that it can name.
    """

    def __init__(self, number: int, index: int, vertices: int) -> None:
        super().__init__(f"face {number} with the index {index}")
        self.number, self.index, self.vertices = number, index, vertices


def obj_with_triangles(content: bytes) -> bytes:
    """An OBJ file with plain lines, its negative indices counted and its concave polygons cut.

    Raises
    ------
    UncutFace
        For a polygon that crosses itself.
    WrongCorner
        For a face with the index 0, or one beyond the vertices.
    ValueError
        For numbers that are none.

    Examples
    --------
    >>> arrow = b"v 0 0 0\\nv 2 1 0\\nv 0 2 0\\nv 1 1 0\\n"
    >>> obj_with_triangles(arrow + b"f -4 -3 -2 -1\\n").splitlines()[4:]
    [b'f 4 1 2', b'f 2 3 4']
    """
    content = _plain_lines(content)
    _check_corners(content)
    if _SUSPECT.search(content) is None:
        return content
    reader = _ObjReader()
    for match in _ELEMENT.finditer(content):
        reader.read(match)
    rewritten, end = [], 0
    for (start, after), lines in sorted(reader.replaced().items()):
        rewritten += [content[end:start], lines]
        end = after
    return b"".join([*rewritten, content[end:]])


def _plain_lines(content: bytes) -> bytes:
    """The same elements, each in one line that begins with its name and a blank."""
    if content.startswith(_UTF16):
        content = content.decode("utf-16").encode()
    content = _LINE_END.sub(b"\n", content.removeprefix(_MARK))
    return _NO_ELEMENT.sub(b"", _CONTINUED.sub(b" ", content).replace(b"\t", b" "))


def _check_corners(content: bytes) -> None:
    """Check that every index of every face is that of a vertex."""
    vertices = len(_VERTEX.findall(content))
    faces = [_NO_POSITION.sub(b"", face).split() for face in _FACE.findall(content)]
    indices = np.array([index for face in faces for index in face], dtype=bytes).astype(np.int64)
    wrong = np.flatnonzero((indices == 0) | (abs(indices) > vertices))
    if wrong.size:
        ends = np.cumsum([len(face) for face in faces])
        number = int(np.searchsorted(ends, wrong[0], side="right")) + 1
        raise WrongCorner(number, int(indices[wrong[0]]), vertices)


@dataclass
class _ObjReader:
    """Positions so far, faces, and numbers of positions, texture coordinates and normals."""

    positions: list[list[float]] = field(default_factory=list)
    counts: dict[bytes, int] = field(default_factory=lambda: dict.fromkeys((b"v", b"vt", b"vn"), 0))
    faces: list[list[bytes]] = field(default_factory=list)
    spans: list[tuple[int, int]] = field(default_factory=list)
    counted: set[int] = field(default_factory=set)

    def read(self, match: re.Match[bytes]) -> None:
        """Take the element of a line."""
        kind, words = match[1], match[2].split()
        if kind == b"f":
            if b"-" in match[2]:
                self.counted.add(len(self.faces))
                words = [self._counted(word) for word in words]
            self.faces.append(words)
            self.spans.append(match.span())
            return
        self.counts[kind] += 1
        if kind == b"v":
            self.positions.append([float(word) for word in words[:3]])

    def _counted(self, word: bytes) -> bytes:
        """A corner `1/2/3` of a face with its indices counted from the beginning of the file."""
        indices = word.split(b"/")
        for place, kind in enumerate(self.counts):
            if place < len(indices) and indices[place].startswith(b"-"):
                index = self.counts[kind] + 1 + int(indices[place])
                if index < 1:
                    number, wrong = len(self.faces) + 1, int(indices[place])
                    raise WrongCorner(number, wrong, self.counts[kind])
                indices[place] = b"%d" % index
        return b"/".join(indices)

    def replaced(self) -> dict[tuple[int, int], bytes]:
        """The lines that replace a face, by where it stands in the file."""
        cut = _cut(self.positions, [self._numbers(face) for face in self.faces])
        lines = {}
        for face in self.counted | cut.keys():
            corners = self.faces[face]
            parts = [[corners[k] for k in part] for part in cut[face]] if face in cut else [corners]
            lines[self.spans[face]] = b"\n".join(b"f " + b" ".join(part) for part in parts)
        return lines

    def _numbers(self, face: list[bytes]) -> list[int]:
        if len(face) == 3:
            return []  # nothing to cut
        return [int(corner.partition(b"/")[0]) - 1 for corner in face]


def off_with_triangles(content: bytes) -> bytes:
    """An OFF file with its concave polygons cut.

    Raises
    ------
    UncutFace
        For a polygon that crosses itself.
    ValueError
        For numbers that are none.

    Examples
    --------
    >>> arrow = b"OFF\\n4 1 0\\n0 0 0\\n2 1 0\\n0 2 0\\n1 1 0\\n4 0 1 2 3\\n"
    >>> off_with_triangles(arrow).splitlines()[-2:]
    [b'3 3 0 1', b'3 1 2 3']
    """
    text = _COMMENT.sub("", content.decode("utf-8", "replace"))
    lines = [line.split() for line in re.split("C?OFF", text, maxsplit=1)[-1].splitlines()]
    lines = [line for line in lines if line]
    first = 1 + int(lines[0][0])
    faces = [line[1 : 1 + int(line[0])] for line in lines[first : first + int(lines[0][1])]]
    positions = [[float(word) for word in line[:3]] for line in lines[1:first]]
    cut = _cut(positions, [[int(corner) for corner in face] for face in faces])
    if not cut:
        return content
    triangles = [
        corners
        for number, face in enumerate(faces)
        for corners in ([[face[k] for k in part] for part in cut.get(number, [])] or [face])
    ]
    body = [*lines[1:first], *([str(len(corners)), *corners] for corners in triangles)]
    head = ["OFF", f"{first - 1} {len(triangles)} 0"]
    return "\n".join([*head, *map(" ".join, body), ""]).encode()


def stl_by_its_count(content: bytes) -> bytes:
    """An STL file; of a binary one as many triangles as its header counts, and nothing behind.

    Raises
    ------
    ValueError
        For a binary file that is cut.

    Examples
    --------
    >>> one = bytes(80) + b"\\1\\0\\0\\0" + bytes(50)
    >>> stl_by_its_count(one + b"!") == one
    True
    """
    count = int.from_bytes(content[_STL_HEAD - 4 : _STL_HEAD], "little")
    length = _STL_HEAD + _STL_TRIANGLE * count
    if b"facet" in content.lower():  # text, unless it is a binary file's header
        return content if len(content) < length else content[:length]
    if len(content) < length:
        raise ValueError(f"{len(content)} of {length} bytes: the file is cut")
    return content[:length]


def _cut(positions: list[list[float]], faces: list[list[int]]) -> dict[int, list[list[int]]]:
    """Triangles of the polygons that have to be cut, by the place of a face in the file."""
    if max(map(len, faces), default=0) < 4:
        return {}
    cut = cut_polygons(np.array(positions, np.float64).reshape(-1, 3), faces)
    return {face: triangles.tolist() for face, triangles in cut.items()}
