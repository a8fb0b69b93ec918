"""TIFF pictures."""

from __future__ import annotations

import itertools
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from malus.reconstruct.photos.picture import (
    ORIENTATION,
    UPRIGHT,
    Picture,
    check_size,
    divided_by_alpha,
    from_codes,
    transfer_of,
    upright,
)
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError, counted, reading

_TEXT_TAGS = (271, 272, 306, 315, 33432)
"""Make, model, date, artist, copyright."""
_ICC_TAG, _EXIF_TAG = 34675, 34665
_CAPTION_TAGS = (700, 33723, 34377)
"""XMP, captions after IPTC, and Photoshop's, which hold both."""
_NO_UNIT, _INCH, _CENTIMETRE = 1, 2, 3
_REDUCED = 1
"""Bit of a page's subfile type that says it is a small copy of another one."""
_HINTS = {
    "float64": "write it as float32", "CFA": "develop it", "LINEAR_RAW": "develop it",
    "MINISWHITE": "save it with 0 for black",
    **dict.fromkeys(("int8", "int16", "int32", "uint32"), "write it as uint16 or float32"),
    "four channels of grey": "write RGB with opacity; pictures through a polariser are a capture",
}  # fmt: skip
"""What to do about forms that are refused, where that is not to convert them to RGB."""
_MOST_PAGES = 200
_NOWHERE = logging.NullHandler()
"""For the log of tifffile, which would go to the error stream where a program sets up none."""


def read_tiff(path: Path, linear: bool, part: str | None = None) -> Picture:
    """A TIFF of 8 to 16 bits, or of floats, which are linear light; `part` is a page from 1.

    Raises
    ------
    InputError
        Several pages where none is chosen, and forms that would not go out as they came in.
    """
    import tifffile

    logging.getLogger("tifffile").addHandler(_NOWHERE)
    with (
        reading(str(path), "a whole TIFF file", "save it again"),
        tifffile.TiffFile(path) as file,
    ):
        page, notes = _page(path, file, part)
        check_size(path, page.imagewidth, page.imagelength)
        _check_form(path, page)
        orientation = int(page.tags[ORIENTATION].value) if ORIENTATION in page.tags else 1
        codes = upright(interleaved(page), orientation)
        metadata = _metadata(page)
        bits, premultiplied = int(page.bitspersample), _is_premultiplied(page)
        has_exif = _EXIF_TAG in page.tags
        notes = (*notes, *_notes(page))
    if codes.dtype.kind == "f":
        if codes.dtype == np.float16:
            notes = (*notes, "floats of 16 bits are written with 32")
        picture = _of_floats(path, codes, metadata, premultiplied, notes)
        return replace(picture, turned=orientation != UPRIGHT)
    if has_exif:
        notes = (*notes, "its Exif is left out, and a gamma or Adobe RGB that it names")
    if bits not in (8, 16):
        notes = (*notes, f"{bits} bits a channel are written as 16")
    transfer = transfer_of(metadata.get("iccprofile"), bits, linear, path)
    picture = from_codes(codes, "TIFF", transfer, metadata, premultiplied, notes)
    return replace(picture, turned=orientation != UPRIGHT)


def count_pages(path: Path) -> int:
    """Pages of a TIFF that are pictures of their own, not small copies. Raises InputError."""
    import tifffile

    logging.getLogger("tifffile").addHandler(_NOWHERE)
    with (
        reading(str(path), "a whole TIFF file", "save it again"),
        tifffile.TiffFile(path) as file,
    ):
        return len(_full_pages(file)[0])


def _full_pages(file: Any) -> tuple[list[Any], int]:
    """The pages that are pictures of their own, and how many are small copies of them."""
    # A damaged file may have millions.
    pages = list(itertools.islice(file.pages, _MOST_PAGES))
    full = [page for page in pages if not int(getattr(page, "subfiletype", 0)) & _REDUCED]
    return full or pages[:1], len(pages) - len(full or pages[:1])


def _page(path: Path, file: Any, part: str | None) -> tuple[Any, tuple[str, ...]]:
    """The page that is meant, and a note on those that are left out."""
    pages, copies = _full_pages(file)
    if part is not None:
        if not part.isdecimal() or not 1 <= int(part) <= len(pages):
            raise InputError("part", f"a page from 1 to {len(pages)}", part, "choose one of them")
        return pages[int(part) - 1], (f"page {part} of {len(pages)} is read",)
    if len(pages) > 1:
        hint = "choose a page with `part`; pictures through a polariser are a capture"
        raise InputError(str(path), "one picture", f"{len(pages)} pages", hint)
    return pages[0], (f"{copies} small copies in the file are left out",) if copies else ()


def _check_form(path: Path, page: Any) -> None:
    photometric = getattr(page.photometric, "name", str(page.photometric))
    samples = int(page.samplesperpixel)
    wrong = [
        (page.bitspersample == 1, "1 bit a pixel"),
        (photometric not in ("RGB", "MINISBLACK"), photometric),
        (page.dtype not in (np.uint8, np.uint16, np.float16, np.float32), str(page.dtype)),
        (page.dtype == np.uint8 and page.bitspersample < 8, f"{page.bitspersample} bits"),
        (len(page.shape) not in (2, 3) or samples > 4, f"shape {page.shape}"),
        (photometric == "MINISBLACK" and samples == 4, "four channels of grey"),
    ]
    for is_wrong, form in wrong:
        if is_wrong:
            expected = "grey or RGB of 8 to 16 or float bits"
            hint = _HINTS.get(form, _HINTS.get(photometric, "convert it to RGB"))
            raise InputError(str(path), expected, form, hint)


def _notes(page: Any) -> tuple[str, ...]:
    """What of a page is taken for something, or left out."""
    three = page.samplesperpixel == 3 and getattr(page.photometric, "name", "") == "MINISBLACK"
    told = {
        "its three channels of grey are taken for red, green and blue": three,
        "XMP and captions after IPTC are left out": any(t in page.tags for t in _CAPTION_TAGS),
    }
    return tuple(note for note, is_so in told.items() if is_so)


def interleaved(page: Any) -> AnyArray:
    """The page's values (height, width[, channels]), from separate planes too."""
    values: AnyArray = page.asarray()
    separate = values.ndim == 3 and page.planarconfig == 2
    return np.ascontiguousarray(np.moveaxis(values, 0, -1)) if separate else values


def _is_premultiplied(page: Any) -> bool:
    return any(int(sample) == 1 for sample in page.extrasamples)


def _of_floats(
    path: Path,
    values: AnyArray,
    metadata: dict[str, Any],
    premultiplied: bool,
    notes: tuple[str, ...],
) -> Picture:
    """A picture of floats, which are linear light."""
    planes = values if values.ndim == 3 else values[..., None]
    bad = int(np.count_nonzero(~np.isfinite(planes)))
    if bad:
        raise InputError(str(path), "finite values", counted(bad, "other"), "clean the picture")
    colours = 3 if planes.shape[-1] >= 3 else 1
    alpha = planes[..., -1] if planes.shape[-1] in (2, 4) else None
    linear = planes[..., :colours].astype(np.float32)
    premultiplied = premultiplied and alpha is not None
    if premultiplied and alpha is not None:
        linear = divided_by_alpha(linear, alpha)
    return Picture(linear, "TIFF", None, alpha, metadata, premultiplied, notes)


def _metadata(page: Any) -> dict[str, Any]:
    """Profile, resolution, texts and meaning of alpha, as tifffile's writer takes them."""
    tags = page.tags
    kept: dict[str, Any] = {}
    if _ICC_TAG in tags:
        kept["iccprofile"] = tags[_ICC_TAG].value
    if 282 in tags and 283 in tags:
        kept["resolution"] = (tags[282].value, tags[283].value)
        unit = int(tags[296].value) if 296 in tags else _INCH
        kept["resolutionunit"] = unit if unit in (_NO_UNIT, _INCH, _CENTIMETRE) else _NO_UNIT
    # As bytes, since tifffile writes no other strings than ASCII.
    texts = [
        (code, 2, None, str(tags[code].value).encode(), True) for code in _TEXT_TAGS if code in tags
    ]
    if texts:
        kept["extratags"] = texts
    if page.description:
        kept["description"] = page.description.encode()
    if page.samplesperpixel in (2, 4):
        names = {1: "assocalpha", 2: "unassalpha"}
        kept["extrasamples"] = [names.get(int(s), "unspecified") for s in page.extrasamples[-1:]]
    return kept
