"""Pictures of radiance in Radiance's RGBE format, .hdr."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from malus.scenes.core.arrays import Float32Array
from malus.scenes.core.errors import InputError, reading

_LINE = re.compile(rb"^(FORMAT|EXPOSURE|COLORCORR)\s*=([^\n]*)$", re.M)
"""Lines of a header by which its numbers may not be radiance in red, green and blue."""
_SIZE = re.compile(rb"\n\n-Y (\d{1,9}) \+X (\d{1,9})\n")


def read_rgbe(path: Path, check_size: Callable[[Path, int, int], None]) -> Float32Array:
    """Red, green and blue (height, width, 3) of a file whose rows run from the top.

    `check_size` is called with path, width and height before a pixel is decoded.

    Raises
    ------
    InputError
        A file that is missing or damaged, of other colours, or whose numbers are not radiance.
    """
    import imagecodecs

    with reading(str(path), "a readable file", "check the path"):
        content = path.read_bytes()
    size = _SIZE.search(content, 0, 1 << 16)
    if size is None:
        expected = "a Radiance file whose size reads -Y height +X width"
        raise InputError(str(path), expected, "another", "export it again")
    check_size(path, int(size[2]), int(size[1]))
    for line in _LINE.finditer(content, 0, size.start() + 1):
        if not _is_plain(line[1], line[2]):
            expected, hint = "RGB without EXPOSURE or COLORCORR", "export it again, as RGBE"
            raise InputError(str(path), expected, line[0].decode("ascii", "replace").strip(), hint)
    with reading(str(path), "a whole Radiance file", "copy it again"):
        return np.asarray(imagecodecs.rgbe_decode(content), dtype=np.float32)


def _is_plain(key: bytes, value: bytes) -> bool:
    """Whether a line of the header leaves the numbers what they are."""
    if key == b"FORMAT":
        return value.strip() != b"32-bit_rle_xyze"
    with suppress(ValueError):
        return all(float(factor) == 1.0 for factor in value.split())
    return False
