"""Pictures of floats in Portable FloatMap files, .pfm."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from malus.scenes.core.arrays import Float32Array
from malus.scenes.core.errors import InputError, reading

_HEADER = re.compile(rb"(P[Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([-+.\deE]{1,40})(?:\r\n|\s)")
"""Colour or grey, width, height, and a number whose sign tells the order of the bytes."""


def read_pfm(path: Path, check_size: Callable[[Path, int, int], None]) -> Float32Array:
    """Values (height, width, 1 or 3) of a file, rows from the top, as they stand in it.

    The file itself has the bottom row first. `check_size` is called with path, width and height
    before a pixel is decoded.

    Source: Paul Debevec, "PFM Portable FloatMap Image Format", HDR Shop.

    Raises
    ------
    InputError
        A file that is missing or damaged, or with a scale other than 1: some programs multiply by
        it, others leave it.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.pfm"
    >>> _ = path.write_bytes(b"Pf\\n1 2\\n-1.0\\n" + np.array([3, 4], "<f4").tobytes())
    >>> read_pfm(path, lambda *_: None)[:, 0, 0].tolist()
    [4.0, 3.0]
    """
    with reading(str(path), "a readable file", "check the path"):
        content = path.read_bytes()
    header = _HEADER.match(content)
    if header is None:
        expected = "a file that begins with PF or Pf, width, height and scale"
        raise InputError(str(path), expected, "another", "export it again")
    width, height = int(header[2]), int(header[3])
    check_size(path, width, height)
    scale = _scale(path, header[4])
    channels = 3 if header[1] == b"PF" else 1
    length, actual = 4 * width * height * channels, len(content) - header.end()
    if actual != length:
        found = f"{actual} bytes of values"
        raise InputError(str(path), f"{length} bytes of values", found, "copy it again")
    values = np.frombuffer(content, "<f4" if scale < 0 else ">f4", offset=header.end())
    picture = values.reshape(height, width, channels)[::-1]
    return np.ascontiguousarray(picture, dtype=np.float32)


def _scale(path: Path, text: bytes) -> float:
    """1 or -1; raises InputError for any other number, or none."""
    with reading(str(path), "a number as the scale", "export it again"):
        scale = float(text)
    if not math.isclose(abs(scale), 1.0, rel_tol=1e-6):
        hint = "multiply the values by what is meant, and write 1 (or -1, the low byte first)"
        raise InputError(str(path), "a scale of 1 or -1", f"{scale:g}", hint)
    return scale
