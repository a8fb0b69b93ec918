"""Tone curves and primaries that a picture declares without a profile: numbers, or codes of video.

Sources: PNG 3rd edition, chunks gAMA, cHRM, sRGB and cICP; Exif 2.32, tags Gamma, ColorSpace and
InteroperabilityIndex (DCF 2.0, Adobe RGB); ITU-T H.273, table 3, which AVIF and HEIC name.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from malus.scenes.core.errors import InputError

_EXIF, _INTEROPERABILITY = 0x8769, 0xA005
_COLOUR_SPACE, _GAMMA, _INDEX = 0xA001, 0xA500, 1
_UNCALIBRATED = 0xFFFF
_ADOBE_GAMMA = 563 / 256
_XMP_GAMMA = re.compile(rb"exif:Gamma(?:=[\"']|>)(\d{1,9})/(\d{1,9})")
_LIKE_SRGB = 0.02
"""Difference of 1/gamma from 1/2.2 up to which a PNG's gAMA means sRGB: 45455 stands for it."""
_NCLX = re.compile(rb"colrnclx..(..)", re.DOTALL)
"""Where files of video's kin tell the number of a curve."""
_PRIMARIES = re.compile(rb"colrnclx(..)", re.DOTALL)
_PRIMARIES_OF_SRGB = (0, 1, 2, 5, 6)
"""Those of BT.709, unspecified ones, and BT.601's, which programs show as sRGB's."""
_SRGB_CURVE, _RGB, _FULL_RANGE = 13, 0, 1
"""Codes of H.273 for the curve and the matrix, and for codes that use all of their range."""
_COLOUR_CHUNKS = (b"gAMA", b"cHRM", b"sRGB", b"cICP")
_OF_SRGB = (0, 1, 2, 6, 13, 14, 15)
"""sRGB, unspecified, and the curve of BT.709, which programs show as sRGB."""
_GAMMAS = {4: 2.2, 5: 2.8, 8: 1.0}
_HIGH_RANGE = {16: "the PQ curve of high dynamic range", 18: "the HLG curve of high dynamic range"}


def declared_colours(
    path: Path, image: Any, has_profile: bool = False
) -> tuple[float | None, dict[bytes, bytes]]:
    """The power of a file's values that is light, and chunks of a PNG that say it and more.

    The power is None where it is sRGB's curve. The chunks, which may tell primaries too, are none
    where the colours are sRGB's and no PNG says so. `image` is the file as Pillow opened it. Beside
    a profile the cICP of a PNG alone counts, which PNG's 3rd edition places above it.

    Raises
    ------
    InputError
        For curves of high dynamic range, and for codes of video's range in a PNG.
    """
    if has_profile:
        written = dict(_chunks_of(path)) if image.format == "PNG" else {}
        if b"cICP" not in written:
            return None, {}
    gamma = _declared_gamma(path, image)
    return gamma, _colour_chunks(path, image, gamma)


def _declared_gamma(path: Path, image: Any) -> float | None:
    with path.open("rb") as file:
        head = file.read(1 << 16)
    match = _NCLX.search(head) if image.format in ("AVIF", "HEIF") else None
    if match is not None:
        return _of_code(path, int.from_bytes(match[1], "big"))
    if image.format == "PNG":
        if code := dict(_chunks_of(path)).get(b"cICP", b"")[1:2]:
            return _of_code(path, code[0])
        written = image.info.get("gamma")
        if not written or "srgb" in image.info or abs(written - 1 / 2.2) <= _LIKE_SRGB:
            return None
        return 1 / float(written)
    return _of_exif(image) or _of_xmp(image)


def _colour_chunks(path: Path, image: Any, gamma: float | None) -> dict[bytes, bytes]:
    if image.format == "PNG":
        chunks = dict(_chunks_of(path))
        if chunks.get(b"cICP", b"")[3:] == b"\0":
            found, hint = "those of video, 16 to 235 of 8 bits", "save it with its full range"
            raise InputError(str(path), "codes that use all of their range", found, hint)
        return chunks
    written = {} if gamma is None else {b"gAMA": struct.pack(">I", round(100_000 / gamma))}
    with path.open("rb") as file:
        head = file.read(1 << 16)
    match = _PRIMARIES.search(head) if image.format in ("AVIF", "HEIF") else None
    primaries = 1 if match is None else int.from_bytes(match[1], "big")
    if primaries in _PRIMARIES_OF_SRGB or primaries > 255:
        return written
    code = next((code for code, power in _GAMMAS.items() if power == gamma), _SRGB_CURVE)
    return {**written, b"cICP": bytes([primaries, code, _RGB, _FULL_RANGE])}


def _chunks_of(path: Path) -> Iterator[tuple[bytes, bytes]]:
    """Name and content of those chunks of a PNG, which all stand before its pixels."""
    with path.open("rb") as file:
        file.seek(8)
        while len(head := file.read(8)) == 8 and head[4:] != b"IDAT":
            length, name = struct.unpack(">I4s", head)
            if name in _COLOUR_CHUNKS:
                yield name, file.read(length)
                file.seek(4, 1)
            else:
                file.seek(length + 4, 1)


def _of_code(path: Path, code: int) -> float | None:
    if code in _OF_SRGB:
        return None
    if code in _GAMMAS:
        return _GAMMAS[code]
    found = _HIGH_RANGE.get(code, f"the curve number {code} of ITU-T H.273")
    raise InputError(str(path), "the curve of sRGB or a gamma", found, "convert it to sRGB")


def _of_exif(image: Any) -> float | None:
    exif = image.getexif()
    about = exif.get_ifd(_EXIF)
    index = exif.get_ifd(_INTEROPERABILITY).get(_INDEX)
    if about.get(_COLOUR_SPACE) == _UNCALIBRATED and str(index).startswith("R03"):
        return _ADOBE_GAMMA
    return _positive(about.get(_GAMMA))


def _of_xmp(image: Any) -> float | None:
    xmp = image.info.get("xmp") or b""
    match = _XMP_GAMMA.search(xmp.encode() if isinstance(xmp, str) else xmp)
    return _positive(int(match[1]) / int(match[2])) if match and int(match[2]) else None


def _positive(value: Any) -> float | None:
    try:
        gamma = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return gamma if 0.1 <= gamma <= 10 else None
