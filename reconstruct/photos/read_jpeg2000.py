"""JPEG 2000 pictures, with all their bits: Pillow would cut them to eight."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from malus.reconstruct.photos.picture import Picture, check_size, from_codes, transfer_of
from malus.scenes.core.errors import InputError, reading

_CODESTREAM = b"\xff\x4f\xff\x51"
"""Start of a code stream and of its sizes."""
_SRGB, _GREY = 16, 17
_OTHERS = {12: "CMYK inks", 14: "CIELAB", 18: "luminance and chroma", 21: "ROMM RGB"}
"""Numbers of colour spaces in a box of them: of those that are read, and names of others."""
_STRAIGHT, _PREMULTIPLIED = 1, 2
"""Kinds of opacity in a box of channel definitions."""


def read_jpeg2000(path: Path, linear: bool) -> Picture:
    """A JPEG 2000 file or code stream of 8 to 16 bits. Raises InputError."""
    import imagecodecs

    with reading(str(path), "a whole JPEG 2000 file", "save it again"):
        data = path.read_bytes()
        offset = data.index(_CODESTREAM)
        width, height, left, top = struct.unpack_from(">4I", data, offset + 8)
        check_size(path, width - left, height - top)
        channels, depth = struct.unpack_from(">HB", data, offset + 40)
        bits = (depth & 0x7F) + 1
        head = _header(data[:offset])
        profile, form = _colours(head)
        if depth & 0x80 or not 8 <= bits <= 16:
            form = f"{bits} bits, signed" if depth & 0x80 else f"{bits} bits"
        opacity = _opacity(head.get(b"cdef", b""))
        if not form and any(channel != channels - 1 for channel in opacity):
            form = "an opacity that is not the last channel"
        if channels > 4 or form:
            refused = form or f"{channels} channels"
            raise InputError(
                str(path), "grey or RGB of 8 to 16 bits", refused, "convert it to PNG or TIFF"
            )
        codes = np.asarray(imagecodecs.jpeg2k_decode(data))
    transfer = transfer_of(profile, bits, linear, path)
    metadata: dict[str, Any] = {"icc_profile": profile} if profile else {}
    if opacity:
        metadata["cdef"] = head[b"cdef"]
    premultiplied = _PREMULTIPLIED in opacity.values()
    return from_codes(codes, "JPEG2000", transfer, metadata, premultiplied)


def boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Type and content of the boxes that a file, or a box of boxes, consists of.

    Examples
    --------
    >>> list(boxes(b"\\0\\0\\0\\x0acolr12"))
    [(b'colr', b'12')]
    """
    offset = 0
    while offset + 8 <= len(data):
        length, name = struct.unpack_from(">I4s", data, offset)
        header = 8
        if length == 1 and offset + 16 <= len(data):
            (length,) = struct.unpack_from(">Q", data, offset + 8)
            header = 16
        end = len(data) if length == 0 else offset + length
        if end <= offset:
            return
        yield name, data[offset + header : end]
        offset = end


def _header(head: bytes) -> dict[bytes, bytes]:
    """Content of the boxes in a file's header, of each kind the first; none of a code stream."""
    whole = b"".join(content for name, content in boxes(head) if name == b"jp2h")
    found: dict[bytes, bytes] = {}
    for name, content in boxes(whole):
        found.setdefault(name, content)
    return found


def _opacity(definition: bytes) -> dict[int, int]:
    """Channels that are opacity, and of which kind, by the box of channel definitions."""
    found = {}
    for start in range(2, len(definition) - 5, 6):
        channel, kind, _ = struct.unpack_from(">3H", definition, start)
        if kind in (_STRAIGHT, _PREMULTIPLIED):
            found[channel] = kind
    return found


def _colours(head: dict[bytes, bytes]) -> tuple[bytes | None, str | None]:
    """The colour profile in a file's header, if there is one, and a form that is not read."""
    if b"pclr" in head:
        return None, "a palette"
    value = head.get(b"colr", b"")
    if value[:1] in (b"\x02", b"\x03"):
        return value[3:], None
    if value[:1] == b"\x01":
        (space,) = struct.unpack_from(">I", value, 3)
        if space not in (_SRGB, _GREY):
            return None, _OTHERS.get(space, f"colour space {space} of JPEG 2000")
    return None, None
