"""TIFF and OpenEXR pictures."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from malus.reconstruct.photos.picture import (
    ORIENTATION,
    Picture,
    check_size,
    from_codes,
    transfer_of,
    upright,
)
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.quiet import quiet

_TIFF_TEXT_TAGS = (271, 272, 306, 315, 33432)
"""Make, model, date, artist, copyright."""
_ICC_TAG = 34675
_NOWHERE = logging.NullHandler()
"""For the log of tifffile, which would go to the error stream where a program sets up none."""
_EXR_STRUCTURE = frozenset(
    {"channels", "dataWindow", "displayWindow", "compression", "lineOrder", "type", "tiles",
     "version", "name", "chunkCount", "screenWindowCenter", "screenWindowWidth", "pixelAspectRatio"}
)  # fmt: skip


def read_tiff(path: Path, linear: bool) -> Picture:
    """A TIFF of 8 or 16 bits, or of floats, which are linear light. Raises InputError."""
    import tifffile

    logging.getLogger("tifffile").addHandler(_NOWHERE)
    with (
        reading(str(path), "a whole TIFF file", "save it again"),
        tifffile.TiffFile(path) as file,
    ):
        page = file.pages.first
        check_size(path, page.imagewidth, page.imagelength)
        _check_tiff(path, page)
        orientation = int(page.tags[ORIENTATION].value) if ORIENTATION in page.tags else 1
        codes = upright(page.asarray(), orientation)
        metadata = _tiff_metadata(page)
    if codes.dtype.kind == "f":
        planes = codes if codes.ndim == 3 else codes[..., None]
        _check_finite(path, planes)
        return Picture(planes[..., :3].astype(np.float32), "TIFF", None, None, metadata)
    bits = 8 * codes.dtype.itemsize
    transfer = transfer_of(metadata.get("iccprofile"), bits, linear, path)
    return from_codes(codes, "TIFF", transfer, metadata)


def _check_tiff(path: Path, page: Any) -> None:
    photometric = getattr(page.photometric, "name", str(page.photometric))
    channels = page.shape[2] if len(page.shape) == 3 else 1
    wrong = [
        (page.bitspersample == 1, "1 bit a pixel"),
        (photometric not in ("RGB", "MINISBLACK"), photometric),
        (page.dtype not in (np.uint8, np.uint16, np.float16, np.float32), str(page.dtype)),
        (len(page.shape) not in (2, 3) or channels > 4, f"shape {page.shape}"),
        (channels > 1 and page.planarconfig != 1, "separate planes"),
    ]
    for is_wrong, form in wrong:
        if is_wrong:
            expected = "grey or RGB of 8, 16 or float bits"
            raise InputError(str(path), expected, form, "convert it to RGB")


def _tiff_metadata(page: Any) -> dict[str, Any]:
    """Profile, resolution and texts of a page, as tifffile's writer takes them."""
    tags = page.tags
    kept: dict[str, Any] = {}
    if _ICC_TAG in tags:
        kept["iccprofile"] = tags[_ICC_TAG].value
    if 282 in tags and 283 in tags:
        kept["resolution"] = (tags[282].value, tags[283].value)
        kept["resolutionunit"] = int(tags[296].value) if 296 in tags else 2
    texts = [(code, 2, 0, str(tags[code].value), True) for code in _TIFF_TEXT_TAGS if code in tags]
    if texts:
        kept["extratags"] = texts
    if page.description:
        kept["description"] = page.description
    return kept


def read_exr(path: Path, linear: bool) -> Picture:
    """An OpenEXR picture: R, G, B or Y, of half or float. Raises InputError."""
    import OpenEXR

    with reading(str(path), "a whole OpenEXR file", "save it again"):
        with quiet(), OpenEXR.File(str(path), header_only=True) as file:
            window = file.header()["dataWindow"]
        width, height = (int(b) - int(a) + 1 for a, b in zip(*window, strict=True))
        check_size(path, width, height)
        with quiet(), OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
            header = {k: v for k, v in file.header().items() if k not in _EXR_STRUCTURE}
    names = next((n for n in (("R", "G", "B"), ("Y",)) if set(n) <= set(channels)), None)
    if names is None:
        listed = ", ".join(sorted(channels))
        raise InputError(str(path), "channels R, G, B or Y", listed, "choose another file")
    values = np.stack([channels[name] for name in names], axis=-1)
    _check_finite(path, values)
    metadata = {"header": header, "names": names, "dtype": values.dtype}
    return Picture(values.astype(np.float32), "EXR", None, channels.get("A"), metadata)


def _check_finite(path: Path, values: AnyArray) -> None:
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise InputError(str(path), "finite values", f"{bad} others", "clean the picture")
