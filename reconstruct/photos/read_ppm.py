"""PPM and PGM pictures of 8 to 16 bits, whose largest code need not be a power of 2 less 1."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from malus.reconstruct.photos.picture import Picture, check_size, from_codes
from malus.reconstruct.photos.tone_curves import linear_codes, srgb_codes
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError, reading

_GAP = rb"(?:\s+|#[^\n]*\n)+"
_HEADER = re.compile(
    rb"P([2356])" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})"
)
_LARGEST_HEADER = 1 << 16
_DEEPEST = 65535


def is_ppm(path: Path) -> bool:
    """Whether a file that can be read begins as grey or colour of Netpbm, in text or binary."""
    with reading(str(path), "a readable file", "check the path"), path.open("rb") as file:
        return re.match(rb"P[2356][\s#]", file.read(3)) is not None


def read_ppm(path: Path, linear: bool) -> Picture:
    """Grey or colour of a PPM or PGM file, by its own largest code; sRGB unless it is `linear`.

    Source: the manual pages ppm(5) and pgm(5) of Netpbm: of two bytes the high one comes first.

    Raises
    ------
    InputError
        A damaged file, codes beyond the largest that it names, or several pictures.
    """
    with reading(str(path), "a readable file", "check the path"):
        content = path.read_bytes()
    header = _HEADER.match(content[:_LARGEST_HEADER])
    if header is None:
        expected = "width, height and the largest code behind P2, P3, P5 or P6"
        raise InputError(str(path), expected, "others", "save it again")
    kind, width, height, largest = (int(header[k]) for k in range(1, 5))
    check_size(path, width, height)
    if not 1 <= largest <= _DEEPEST:
        expected = f"a largest code of 1 to {_DEEPEST}"
        raise InputError(str(path), expected, f"{largest}", "save it again")
    channels = 3 if kind in (3, 6) else 1
    count = width * height * channels
    body = content[header.end() :]
    codes = _text(path, body, count) if kind < 5 else _binary(path, body, count, largest)
    if (highest := int(codes.max())) > largest:
        hint = "write the high byte first, and the largest code that there is in the header"
        raise InputError(str(path), f"codes of at most {largest}", f"{highest}", hint)
    transfer = linear_codes(largest) if linear else srgb_codes(largest)
    return from_codes(codes.reshape(height, width, channels), "PPM", transfer, {})


def _text(path: Path, body: bytes, count: int) -> AnyArray:
    """Codes that are written as numbers."""
    words = re.sub(rb"#[^\n]*", b"", body).split()
    _check_length(path, len(words), count, b"".join(words[count:]))
    with reading(str(path), "whole numbers from 0", "save it again"):
        return np.array(words).astype(np.uint32)


def _binary(path: Path, body: bytes, count: int, largest: int) -> AnyArray:
    """Codes of one byte, or of two with the high one first, one blank behind the header."""
    dtype = np.dtype(np.uint8 if largest < 256 else ">u2")
    length = count * dtype.itemsize
    _check_length(path, len(body) - 1, length, body[1 + length :])
    return np.frombuffer(body, dtype, count, offset=1).astype(dtype.newbyteorder("="))


def _check_length(path: Path, actual: int, expected: int, behind: bytes) -> None:
    """Raises InputError for fewer codes or bytes than expected, or for something behind them."""
    if actual < expected:
        expected_text = f"{expected} codes or bytes of them behind the header"
        raise InputError(str(path), expected_text, f"{actual}", "copy it again")
    if behind.strip():
        hint = "save the picture that you mean alone"
        raise InputError(str(path), "one picture", f"{len(behind)} bytes behind it", hint)
