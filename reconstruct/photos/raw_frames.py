"""Frames without a header, as cameras send them: 8 to 16 bits a pixel, packed or not."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.photos.picture import Picture, check_size
from malus.reconstruct.photos.tone_curves import linear_transfer
from malus.scenes.core.errors import InputError, reading

PACKINGS = (
    "mono8", "mono10", "mono12", "mono14", "mono16", "mono10p", "mono12p", "mono10packed",
    "mono12packed",
)  # fmt: skip
"""GenICam's names of pixel formats. Without a letter behind it: 16 bits a pixel, the low byte
first. `p`: bits without gaps, the lowest first. `packed`: as GigE Vision packs two pixels."""


def read_raw(path: Path, size: tuple[int, int], packing: str) -> Picture:
    """A grey picture from the bytes of a frame of `size` (width, height).

    Parameters
    ----------
    packing : one of PACKINGS, or GenICam's name of a colour format with the same ending

    Raises
    ------
    InputError
        An unknown packing, or a file that is not as long as such a frame.
    """
    bits, layout = _format(packing)
    width, height = size
    check_size(path, width, height)
    expected = packed_length(width * height, bits, layout)
    with reading(str(path), f"a frame of {expected} bytes", "check the path"):
        length = path.stat().st_size
        if length != expected:
            raise InputError(
                str(path),
                f"{expected} bytes: {width} x {height} pixels of {packing}",
                f"{length} bytes",
                "check `size` and `packing`; cut off what a header adds",
            )
        codes = unpack(np.fromfile(path, dtype=np.uint8), bits, layout)
    largest = int(codes.max())
    if largest >= 1 << bits:
        hint = "check `packing`: mono16 reads codes that are shifted to the high bits"
        raise InputError(str(path), f"codes of {bits} bits", f"{largest}", hint)
    transfer = linear_transfer(bits)
    return Picture(transfer.linear(codes.reshape(height, width, 1)), "TIFF", transfer)


def _format(packing: str) -> tuple[int, str]:
    """Bits a pixel, and '', 'p' or 'packed'."""
    match = re.fullmatch(r"[a-z_]*?(8|10|12|14|16)_?(p|packed)?", packing.lower())
    layout = (match[2] or "") if match else ""
    if match is None or (layout and match[1] not in ("10", "12")):
        listed = ", ".join(PACKINGS)
        raise InputError("packing", f"one of {listed}", packing, "see the camera's pixel format")
    return int(match[1]), layout


def packed_length(pixels: int, bits: int, layout: str) -> int:
    """Bytes of so many pixels.

    Examples
    --------
    >>> packed_length(4, 12, "p"), packed_length(4, 10, "packed"), packed_length(4, 12, "")
    (6, 6, 8)
    """
    if layout == "p":
        return (pixels * bits + 7) // 8
    if layout == "packed":
        return (pixels * 3 + 1) // 2
    return pixels * (1 if bits == 8 else 2)


def unpack(data: NDArray[np.uint8], bits: int, layout: str) -> NDArray[np.uint16]:
    """Codes of a frame's bytes.

    Source: GenICam Pixel Format Naming Convention 2.1 for `p`, where the bits of all pixels follow
    one another, lowest first; GigE Vision 1.x for `packed`, where of three bytes the first and the
    last hold the high bits of two pixels, and the middle one their low bits.

    Examples
    --------
    The pixels 0xABC and 0x123:

    >>> [hex(code) for code in unpack(np.array([0xBC, 0x3A, 0x12], np.uint8), 12, "p")]
    ['0xabc', '0x123']
    >>> [hex(code) for code in unpack(np.array([0xAB, 0x3C, 0x12], np.uint8), 12, "packed")]
    ['0xabc', '0x123']
    """
    if layout == "":
        codes = data if bits == 8 else data.view("<u2")
        return codes.astype(np.uint16)
    if layout == "packed":
        return _unpack_pairs(data, bits)
    group = 4 if bits == 10 else 2
    size = group * bits // 8
    count = data.size * 8 // bits
    padded = np.concatenate([data, np.zeros(-data.size % size, np.uint8)]).reshape(-1, size)
    codes = np.empty((len(padded), group), dtype=np.uint16)
    for index in range(group):
        first, shift = divmod(index * bits, 8)
        low, high = (padded[:, first + byte].astype(np.uint16) for byte in (0, 1))
        codes[:, index] = ((low | high << 8) >> shift) & ((1 << bits) - 1)
    return codes.ravel()[:count]


def _unpack_pairs(data: NDArray[np.uint8], bits: int) -> NDArray[np.uint16]:
    """Codes of GigE Vision's packed formats; one byte and a half is left for an odd last pixel."""
    count = data.size * 2 // 3
    low_bits = bits - 8
    triples = np.concatenate([data, np.zeros(-data.size % 3, np.uint8)]).reshape(-1, 3)
    first, middle, last = triples.astype(np.uint16).T
    mask = (1 << low_bits) - 1
    codes = np.stack([first << low_bits | middle & mask, last << low_bits | middle >> 4 & mask], -1)
    return codes.ravel()[:count].astype(np.uint16)
