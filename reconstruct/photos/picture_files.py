"""TIFF and OpenEXR pictures in, and every kind of picture out, whole or not at all."""

from __future__ import annotations

import logging
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.photos.read_picture import (
    ORIENTATION,
    Picture,
    check_size,
    from_codes,
    transfer_of,
    upright,
)
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import replace_file
from malus.scenes.core.quiet import quiet

_TIFF_TEXT_TAGS = (271, 272, 306, 315, 33432)
"""Make, model, date, artist, copyright."""
_ICC_TAG = 34675
_JPEG_QUALITY = 95
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
    try:
        with tifffile.TiffFile(path) as file:
            page = file.pages.first
            check_size(path, page.imagewidth, page.imagelength)
            _check_tiff(path, page)
            orientation = int(page.tags[ORIENTATION].value) if ORIENTATION in page.tags else 1
            codes = upright(page.asarray(), orientation)
            metadata = _tiff_metadata(page)
    except InputError:
        raise
    except Exception as error:  # a foreign parser raises anything on a broken file
        reason = str(error).split("\n")[0]
        raise InputError(str(path), "a whole TIFF file", reason, "save it again") from None
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
    for is_wrong, found in wrong:
        if is_wrong:
            expected = "grey or RGB of 8, 16 or float bits"
            raise InputError(str(path), expected, found, "convert it to RGB")


def _tiff_metadata(page: Any) -> dict[str, Any]:
    """What tifffile's writer takes."""
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

    try:
        with quiet(), OpenEXR.File(str(path), header_only=True) as file:
            window = file.header()["dataWindow"]
        width, height = (int(b) - int(a) + 1 for a, b in zip(*window, strict=True))
        check_size(path, width, height)
        with quiet(), OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
            header = {k: v for k, v in file.header().items() if k not in _EXR_STRUCTURE}
    except InputError:
        raise
    except Exception as error:  # a foreign parser raises anything on a broken file
        reason = str(error).split("\n")[0]
        raise InputError(str(path), "a whole OpenEXR file", reason, "save it again") from None
    names = next((n for n in (("R", "G", "B"), ("Y",)) if set(n) <= set(channels)), None)
    if names is None:
        found = ", ".join(sorted(channels))
        raise InputError(str(path), "channels R, G, B or Y", found, "choose another file")
    values = np.stack([channels[name] for name in names], axis=-1)
    _check_finite(path, values)
    metadata = {"header": header, "names": names, "dtype": values.dtype}
    return Picture(values.astype(np.float32), "EXR", None, channels.get("A"), metadata)


def _check_finite(path: Path, values: NDArray[Any]) -> None:
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise InputError(str(path), "finite values", f"{bad} others", "clean the picture")


def write_picture(path: Path, picture: Picture) -> None:
    """Write a picture in the form that it was read in: whole or not at all.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    writers = {"PNG": _png, "JPEG": _jpeg, "TIFF": _tiff, "EXR": _exr}
    replace_file(path, lambda temporary: writers[picture.kind](temporary, picture))


def _codes(picture: Picture) -> NDArray[Any]:
    """Codes of the picture's light, with the alpha that it came with."""
    assert picture.transfer is not None
    codes = picture.transfer.encoded(picture.linear)
    if picture.alpha is not None:
        codes = np.concatenate([codes, picture.alpha[..., None].astype(codes.dtype)], axis=-1)
    return codes[..., 0] if codes.shape[-1] == 1 else codes


def _png(path: Path, picture: Picture) -> None:
    import PIL.Image
    import PIL.PngImagePlugin

    codes, metadata = _codes(picture), dict(picture.metadata)
    texts = metadata.pop("text", {})
    if codes.dtype == np.uint16 and codes.ndim == 3:
        path.write_bytes(_deep_png(codes, metadata, texts))
        return
    info = PIL.PngImagePlugin.PngInfo()
    for key, value in texts.items():
        info.add_itxt(key, value)
    PIL.Image.fromarray(codes).save(path, format="PNG", pnginfo=info, **metadata)


def _deep_png(codes: NDArray[np.uint16], metadata: dict[str, Any], texts: dict[str, str]) -> bytes:
    """A PNG of 16-bit colour with its profile, EXIF, resolution and texts spliced in."""
    import imagecodecs

    plain = bytes(imagecodecs.png_encode(codes))
    extra = []
    if "icc_profile" in metadata:
        extra.append((b"iCCP", b"icc\0\0" + zlib.compress(metadata["icc_profile"])))
    if "dpi" in metadata:
        per_metre = [round(float(dpi) / 0.0254) for dpi in metadata["dpi"]]
        extra.append((b"pHYs", struct.pack(">IIB", *per_metre, 1)))
    if "exif" in metadata:
        extra.append((b"eXIf", metadata["exif"].removeprefix(b"Exif\0\0")))
    for key, value in texts.items():
        extra.append((b"iTXt", key.encode("latin-1") + b"\0\0\0\0\0" + value.encode()))
    chunks = b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in extra
    )
    header = 8 + 25  # signature and IHDR, which every PNG starts with
    return plain[:header] + chunks + plain[header:]


def _jpeg(path: Path, picture: Picture) -> None:
    import PIL.Image

    image = PIL.Image.fromarray(_codes(picture))
    image.save(path, format="JPEG", quality=_JPEG_QUALITY, subsampling=0, **picture.metadata)


def _tiff(path: Path, picture: Picture) -> None:
    import tifffile

    codes = picture.linear if picture.transfer is None else _codes(picture)
    codes = codes[..., 0] if codes.ndim == 3 and codes.shape[-1] == 1 else codes
    alpha: dict[str, Any] = {"extrasamples": ["unassalpha"]} if picture.alpha is not None else {}
    photometric = "rgb" if codes.ndim == 3 and codes.shape[-1] >= 3 else "minisblack"
    tifffile.imwrite(
        path, codes, photometric=photometric, metadata=None, **alpha, **picture.metadata
    )


def _exr(path: Path, picture: Picture) -> None:
    import OpenEXR

    dtype = picture.metadata.get("dtype", np.float32)
    names = picture.metadata.get(
        "names", ("R", "G", "B") if picture.linear.shape[-1] == 3 else ("Y",)
    )
    channels = {
        name: np.ascontiguousarray(picture.linear[..., i].astype(dtype))
        for i, name in enumerate(names)
    }
    if picture.alpha is not None:
        channels["A"] = np.ascontiguousarray(picture.alpha)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File({**picture.metadata.get("header", {}), **header}, channels) as file:
        file.write(str(path))
