"""Ordinary pictures in: linear light inside, and what is needed to write the form they came in.

PNG, TIFF and PPM of up to 16 bits, JPEG, WebP, JPEG 2000, AVIF, HEIC, BMP, Radiance (.hdr), PFM,
TIFF and OpenEXR of floats; grey or RGB, with or without alpha. Size, bit depth, profile and
metadata go out as they came in, and what does not is told in the picture's notes. A picture with an
EXIF orientation is turned upright first: the angles of a polariser are those that a viewer sees.
"""

from __future__ import annotations

import importlib
import logging
import os
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from malus.reconstruct.photos.declared_curves import declared_colours
from malus.reconstruct.photos.picture import (
    ORIENTATION,
    UPRIGHT,
    Picture,
    check_size,
    from_codes,
    transfer_of,
    upright,
)
from malus.reconstruct.photos.read_camera_raw import RAW_SUFFIXES, read_camera_raw
from malus.reconstruct.photos.read_exr import read_exr
from malus.reconstruct.photos.read_jpeg2000 import read_jpeg2000
from malus.reconstruct.photos.read_ppm import is_ppm, read_ppm
from malus.reconstruct.photos.read_tiff import read_tiff
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError, counted, reading
from malus.scenes.core.pfm import read_pfm
from malus.scenes.core.quiet import quiet
from malus.scenes.core.rgbe import read_rgbe

SUFFIXES = {
    ".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".mpo": "JPEG", ".jfif": "JPEG",
    ".tif": "TIFF", ".tiff": "TIFF", ".exr": "EXR", ".webp": "WEBP", ".avif": "AVIF",
    ".jp2": "JPEG2000", ".j2k": "JPEG2000", ".jpx": "JPEG2000", ".jpf": "JPEG2000",
    ".heic": "HEIF", ".heif": "HEIF", ".hif": "HEIF", ".bmp": "BMP", ".ppm": "PPM",
    ".pgm": "PPM", ".pnm": "PPM", ".hdr": "HDR", ".pfm": "PFM",
    **dict.fromkeys(sorted(RAW_SUFFIXES), "RAW"),
}  # fmt: skip
_FORMATS = ("PNG", "JPEG", "WEBP", "AVIF", "HEIF", "BMP", "PPM")
"""What Pillow is asked for; a file may bear the suffix of another one of them."""
_KINDS = {"MPO": "JPEG"}
_MODES = {"L": 8, "LA": 8, "RGB": 8, "RGBA": 8, "I;16": 16, "I;16B": 16}
_REFUSED = {
    "1": "1 bit a pixel", "P": "a palette", "PA": "a palette", "CMYK": "CMYK inks",
    "YCCK": "CMYK inks", "LAB": "CIELAB", "RGBa": "colours multiplied by their opacity",
}  # fmt: skip
_TURNED = r"(tiff:Orientation(?:\s*=\s*[\"']|>\s*))[1-8]"
_UPRIGHT, _UPRIGHT_BYTES = re.compile(_TURNED), re.compile(_TURNED.encode())
"""How XMP says that a picture is to be turned, up to the number."""
_EXIF_TEXTS = ("Raw profile type exif", "Raw profile type APP1")
"""Texts of a PNG that are its EXIF: this is kept upright, and as EXIF."""
_GAIN_MAPS = (b"hdrgm:", b"urn:iso:std:iso:ts:21496")
"""How Ultra HDR JPEGs of Android, and those after ISO 21496-1, announce their gain map."""

_RGBE = "a Radiance picture is written as an OpenEXR, whose floats are finer"

_NOWHERE = logging.NullHandler()
"""For libpng's remarks, which would go to the error stream where a program sets up no log."""


def read_picture(path: Path | str, linear: bool = False, part: str | int | None = None) -> Picture:
    """Read a picture as linear light, with what is needed to write another one like it.

    Parameters
    ----------
    path : Path or str
        Of the picture's file.
    linear : bool
        Take the codes of an integer file for linear light, whatever its profile says.
    part : str or int, optional
        Which of several pictures in a file: name of an OpenEXR part, or number of a TIFF page
        from 1; or name of an OpenEXR layer.

    Returns
    -------
    Picture
        `linear` (height, width, 1 or 3), 1 where the file's values are largest.

    Raises
    ------
    InputError
        Missing, damaged or truncated file, an unknown format, too many pixels, CMYK, a palette or
        1 bit a pixel, several pictures where none is chosen: one line that says what to do.

    Examples
    --------
    >>> import tempfile
    >>> import PIL.Image
    >>> path = Path(tempfile.mkdtemp()) / "grey.png"
    >>> PIL.Image.new("L", (3, 2), 188).save(path)
    >>> picture = read_picture(path)
    >>> picture.linear.shape, round(float(picture.linear[0, 0, 0]), 2)
    ((2, 3, 1), 0.5)
    """
    if not isinstance(path, (str, os.PathLike)):
        raise InputError("path", "a path", type(path).__name__, "name a file")
    path, part = Path(path), None if part is None else str(part)
    readers: dict[str, Callable[[Path, bool, str | None], Picture]] = {
        "EXR": read_exr,
        "TIFF": read_tiff,
    }
    kind = SUFFIXES.get(path.suffix.lower())
    if path.is_dir():
        raise InputError(str(path), "a picture", "a folder", "name a file in it")
    if kind is None:
        suffixes = ", ".join(sorted(SUFFIXES))
        suffix = path.suffix or "no suffix"
        raise InputError(str(path), f"a file of {suffixes}", suffix, "convert it")
    if not path.is_file():
        raise InputError(str(path), "a picture", "no such file", "check the path")
    if kind in readers:
        return readers[kind](path, linear, part)
    if part is not None:
        raise InputError("part", "a file of several parts, OpenEXR or TIFF", kind, "leave it out")
    plain: dict[str, Callable[[Path, bool], Picture]] = {
        "JPEG2000": read_jpeg2000,
        "RAW": lambda path, _: read_camera_raw(path),
        "HDR": lambda path, _: Picture(read_rgbe(path, check_size), "EXR", None, notes=(_RGBE,)),
        "PFM": lambda path, _: _of_floats(path),
    }
    if kind in plain:
        return plain[kind](path, linear)
    if is_ppm(path):
        return read_ppm(path, linear)
    return _read_with_pillow(path, kind, linear)


def _of_floats(path: Path) -> Picture:
    """A PFM, whose floats are linear light."""
    light = read_pfm(path, check_size)
    bad = int(np.count_nonzero(~np.isfinite(light)))
    if bad:
        raise InputError(str(path), "finite values", counted(bad, "other"), "clean the picture")
    return Picture(light, "PFM", None)


def _read_with_pillow(path: Path, kind: str, linear: bool) -> Picture:
    """What Pillow reads; 16-bit colour of PNG through imagecodecs."""
    _require_readers(path, kind)
    with (
        reading(str(path), f"a whole {_named(kind)} file", "save it again"),
        warnings.catch_warnings(),
        quiet(),
    ):
        warnings.simplefilter("ignore")  # of large pictures, about which check_size decides
        with _opened(path) as image:
            check_size(path, *image.size)
            notes = _check_form(path, image)
            image.load()
            orientation = int(image.getexif().get(ORIENTATION, 1))
            metadata = _metadata(path, image)
            kind, bits = _KINDS.get(image.format, image.format), _bits(path, image)
            profile = metadata.get("icc_profile")
            gamma, chunks = declared_colours(path, image, bool(profile))
            if "transparency" in image.info and image.mode in ("L", "RGB"):
                image = image.convert("LA" if image.mode == "L" else "RGBA")
                notes = (*notes, "the transparent colour is written as an alpha channel")
            elif "transparency" in image.info:
                notes = (*notes, "the transparent grey is left out")
            if "photoshop" in image.info:
                notes = (*notes, "captions after IPTC are left out")
            codes = np.asarray(image)
    if kind in ("AVIF", "HEIF") and (bits > 8 or chunks):
        notes = (*notes, f"{kind} of {bits} bits a channel and its curve is written as a PNG")
        codes = codes if bits == 8 else _deep_heif(path, kind, bits)
        kind, bits = "PNG", 8 if bits == 8 else 16
    elif bits == 16 and codes.dtype == np.uint8:
        codes = _deep_png(path)
    elif bits == 16:
        codes = codes.astype(np.uint16)
    if kind == "PNG" and chunks:
        metadata["chunks"] = chunks
    transfer = transfer_of(None if chunks else profile, bits, linear, path, gamma)
    picture = from_codes(upright(codes, orientation), kind, transfer, metadata, notes=notes)
    return replace(picture, turned=orientation != UPRIGHT)


def _named(kind: str) -> str:
    return "PNG or JPEG" if kind in ("PNG", "JPEG") else kind


def _require_readers(path: Path, kind: str) -> None:
    """Load the reader of HEIC, and say which package is missing where one is."""
    import PIL.features

    package = None
    if kind == "HEIF":
        try:
            importlib.import_module("pillow_heif").register_heif_opener()
        except ImportError:
            package = "pillow-heif"
    elif kind in ("AVIF", "WEBP") and not PIL.features.check(kind.lower()):
        package = "pillow-avif-plugin" if kind == "AVIF" else "pillow with WebP"
    if package is not None:
        hint = f"pip install {package}, or convert the picture to TIFF or PNG"
        raise InputError(str(path), f"the package {package} for this format", "nothing", hint)


def _opened(path: Path) -> Any:
    """The file as Pillow opens it, without its own limit of pixels."""
    import PIL.Image

    PIL.Image.init()  # readers that Pillow loads only where the usual ones fail
    limit, PIL.Image.MAX_IMAGE_PIXELS = PIL.Image.MAX_IMAGE_PIXELS, None
    try:
        formats = tuple(name for name in _FORMATS if name in PIL.Image.OPEN)
        return PIL.Image.open(path, formats=formats)
    finally:
        PIL.Image.MAX_IMAGE_PIXELS = limit


def _check_form(path: Path, image: Any) -> tuple[str, ...]:
    """Refuse forms that would not go out as they came in; notes on what is left out."""
    deep_grey = image.mode == "I" and image.format == "PNG"
    if image.mode not in _MODES and not deep_grey:
        form = _REFUSED.get(image.mode, f"mode {image.mode}")
        raise InputError(str(path), "grey or RGB of 8 or 16 bits", form, "convert it to RGB")
    notes = []
    frames = int(getattr(image, "n_frames", 1))
    if image.format == "MPO" or b"hdrgm:Version" in image.info.get("xmp", b""):
        data = path.read_bytes()
        if any(mark in data for mark in _GAIN_MAPS):
            notes.append("the gain map of high dynamic range is left out: standard range is read")
        elif frames > 1:
            notes.append(f"the file holds {frames} pictures: the first is read")
    elif frames > 1:
        raise InputError(str(path), "one picture", f"{frames}", "save the one that you mean")
    return tuple(notes)


def _metadata(path: Path, image: Any) -> dict[str, Any]:
    """Profile, EXIF (upright), resolution and comments, as Pillow's writers take them."""
    exif = image.getexif()
    exif.pop(ORIENTATION, None)
    names = ("icc_profile", "dpi", "comment")
    kept = {name: image.info[name] for name in names if image.info.get(name)}
    if len(exif):
        kept["exif"] = exif.tobytes()
    texts = getattr(image, "text", None) or {}
    texts = {str(key): _UPRIGHT.sub(r"\g<1>1", str(value)) for key, value in texts.items()}
    if kept_texts := {key: value for key, value in texts.items() if key not in _EXIF_TEXTS}:
        kept["text"] = kept_texts
    xmp = image.info.get("xmp")
    if xmp and image.format in ("JPEG", "WEBP", "AVIF", "HEIF") and b"hdrgm" not in xmp:
        kept["xmp"] = _UPRIGHT_BYTES.sub(rb"\g<1>1", xmp)
    if image.format == "WEBP":
        with path.open("rb") as file:
            kept["lossless"] = b"VP8L" in file.read(4096)
    return kept


def _bits(path: Path, image: Any) -> int:
    """Bits a channel in the file, also where Pillow has cut them to 8."""
    if image.format in ("PNG", "AVIF", "HEIF"):
        with path.open("rb") as file:
            head = file.read(1 << 16)
        if image.format == "PNG":
            return 16 if head[24] == 16 else 8
        offset = head.find(b"pixi")
        return max(head[offset + 9 : offset + 9 + head[offset + 8]], default=8) if offset > 0 else 8
    return 16 if image.mode == "I" else _MODES[image.mode]


def _deep_png(path: Path) -> AnyArray:
    """Codes of a PNG with 16 bits a channel."""
    import imagecodecs

    logging.getLogger("imagecodecs").addHandler(_NOWHERE)
    with reading(str(path), "a whole PNG file", "save it again"):
        return np.asarray(imagecodecs.png_decode(path.read_bytes()), dtype=np.uint16)


def _deep_heif(path: Path, kind: str, bits: int) -> AnyArray:
    """Codes of an AVIF or HEIC file with more than 8 bits a channel, in 16 bits."""
    with reading(str(path), f"a whole {kind} file", "save it again"):
        if kind == "AVIF":
            import imagecodecs

            codes = np.asarray(imagecodecs.avif_decode(path.read_bytes()))
        else:
            opened = importlib.import_module("pillow_heif").open_heif(
                path, convert_hdr_to_8bit=False
            )
            # Its codes stand in the upper bits of 16.
            codes = np.asarray(opened) >> (16 - bits)
        return np.rint(np.arange(2**bits) * (65535 / (2**bits - 1))).astype(np.uint16)[codes]
