"""Tone curves that a picture declares where it has no colour profile: a gamma, or a code of video.

Sources: PNG 3rd edition, chunks gAMA, sRGB and cICP; Exif 2.32, tags Gamma, ColorSpace and
InteroperabilityIndex (DCF 2.0, Adobe RGB); ITU-T H.273, table 3, which AVIF and HEIC name.
"""

from __future__ import annotations

import re
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
_NCLX, _CICP = (re.compile(p, re.DOTALL) for p in (rb"colrnclx..(..)", rb"\x04cICP.(.)"))
_CODES = {"AVIF": _NCLX, "HEIF": _NCLX, "PNG": _CICP}
"""Where files of video's kin, and PNG, tell the number of a curve."""
_OF_SRGB = (0, 1, 2, 6, 13, 14, 15)
"""sRGB, unspecified, and the curve of BT.709, which programs show as sRGB."""
_GAMMAS = {4: 2.2, 5: 2.8, 8: 1.0}
_HIGH_RANGE = {16: "the PQ curve of high dynamic range", 18: "the HLG curve of high dynamic range"}


def declared_gamma(path: Path, image: Any) -> float | None:
    """The power of a file's values that is light; None where they are sRGB's.

    Raises
    ------
    InputError
        For curves of high dynamic range.
    """
    with path.open("rb") as file:
        head = file.read(1 << 16)
    match = _CODES[image.format].search(head) if image.format in _CODES else None
    if match is not None:
        return _of_code(path, int.from_bytes(match[1], "big"))
    if image.format == "PNG":
        written = image.info.get("gamma")
        if not written or "srgb" in image.info or abs(written - 1 / 2.2) <= _LIKE_SRGB:
            return None
        return 1 / float(written)
    return _of_exif(image) or _of_xmp(image)


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
