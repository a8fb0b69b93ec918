"""Pictures out, in the form that they were read in: whole or not at all."""

from __future__ import annotations

import importlib
import io
import struct
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.photos.picture import Picture, times_alpha
from malus.reconstruct.photos.read_exr import lossless_compression, restored
from malus.reconstruct.photos.read_jpeg2000 import boxes
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.files import replace_file

_QUALITY = 95
_COARSE, _DEEP = 255, 65535
"""Largest codes of 8 and 16 bits."""


def write_picture(path: Path, picture: Picture) -> None:
    """Write a picture in the form that it was read in: whole or not at all.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    writers = {
        "PNG": _png, "TIFF": _tiff, "EXR": _exr, "JPEG2000": _jpeg2000, "PPM": _ppm, "PFM": _pfm,
    }  # fmt: skip
    writer = writers.get(picture.kind, _with_pillow)
    replace_file(path, lambda temporary: writer(temporary, picture))


def _codes(picture: Picture) -> AnyArray:
    """Codes of the picture's light, with the alpha that it came with."""
    assert picture.transfer is not None
    largest = picture.transfer.table.shape[1] - 1
    if picture.premultiplied and picture.alpha is not None:
        straight = picture.transfer.encoded_between(picture.linear)
        values = times_alpha(straight, picture.alpha, largest)
        codes: AnyArray = np.clip(np.rint(values), 0, largest)
        codes = codes.astype(np.uint8 if largest == _COARSE else np.uint16)
    else:
        codes = picture.transfer.encoded(picture.linear)
    if picture.alpha is not None:
        codes = np.concatenate([codes, picture.alpha[..., None].astype(codes.dtype)], axis=-1)
    return codes[..., 0] if codes.shape[-1] == 1 else codes


def _in_sixteen_bits(codes: AnyArray, largest: int) -> AnyArray:
    """Codes of 9 to 15 bits as 16, which every program reads."""
    if largest in (_COARSE, _DEEP):
        return codes
    return np.rint(codes * (_DEEP / largest)).astype(np.uint16)


def _png(path: Path, picture: Picture) -> None:
    import PIL.Image
    import PIL.PngImagePlugin

    codes, metadata = _codes(picture), dict(picture.metadata)
    texts, chunks = metadata.pop("text", {}), metadata.pop("chunks", {})
    if codes.dtype == np.uint16 and codes.ndim == 3:
        path.write_bytes(_deep_png(codes, metadata, texts, chunks))
        return
    info = PIL.PngImagePlugin.PngInfo()
    for key, value in texts.items():
        info.add_itxt(key, value)
    data = io.BytesIO()
    PIL.Image.fromarray(codes).save(data, format="PNG", pnginfo=info, **metadata)
    path.write_bytes(_with_chunks(data.getvalue(), chunks.items()))


def _deep_png(
    codes: NDArray[np.uint16],
    metadata: dict[str, Any],
    texts: dict[str, str],
    chunks: dict[bytes, bytes],
) -> bytes:
    """A PNG of 16-bit colour with its profile, EXIF, resolution and texts spliced in."""
    import imagecodecs

    extra = list(chunks.items())
    if "icc_profile" in metadata:
        extra.append((b"iCCP", b"icc\0\0" + zlib.compress(metadata["icc_profile"])))
    if "dpi" in metadata:
        per_metre = [round(float(dpi) / 0.0254) for dpi in metadata["dpi"]]
        extra.append((b"pHYs", struct.pack(">IIB", *per_metre, 1)))
    if "exif" in metadata:
        extra.append((b"eXIf", metadata["exif"].removeprefix(b"Exif\0\0")))
    for key, value in texts.items():
        extra.append((b"iTXt", key.encode("latin-1") + b"\0\0\0\0\0" + value.encode()))
    return _with_chunks(bytes(imagecodecs.png_encode(codes)), extra)


def _with_chunks(plain: bytes, extra: Iterable[tuple[bytes, bytes]]) -> bytes:
    """A PNG with further chunks before its pixels."""
    chunks = b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in extra
    )
    header = 8 + 25  # signature and IHDR, which every PNG starts with
    return plain[:header] + chunks + plain[header:]


def _with_pillow(path: Path, picture: Picture) -> None:
    """JPEG, WebP, AVIF, HEIC and BMP."""
    import PIL.Image

    metadata, options = dict(picture.metadata), _OPTIONS.get(picture.kind, {})
    if metadata.pop("lossless", False):
        options = {"lossless": True, "exact": True}
    if picture.kind == "HEIF":
        importlib.import_module("pillow_heif").register_heif_opener()
    codes = _codes(picture)
    PIL.Image.fromarray(codes).save(path, format=picture.kind, **options, **metadata)


_OPTIONS: dict[str, dict[str, Any]] = {
    "JPEG": {"quality": _QUALITY, "subsampling": 0},
    "WEBP": {"quality": _QUALITY, "exact": True},
    "AVIF": {"quality": _QUALITY, "subsampling": "4:4:4"},
    "HEIF": {"quality": _QUALITY, "chroma": 444},
}


def _jpeg2000(path: Path, picture: Picture) -> None:
    """A lossless JPEG 2000 file of as many bits as it came with."""
    import imagecodecs

    assert picture.transfer is not None
    bits = picture.transfer.table.shape[1].bit_length() - 1
    data = imagecodecs.jpeg2k_encode(
        _codes(picture), level=0, codecformat="jp2", reversible=True, bitspersample=bits
    )
    path.write_bytes(_with_header(bytes(data), picture.metadata))


def _with_header(data: bytes, metadata: dict[str, Any]) -> bytes:
    """A JPEG 2000 file with a colour profile for its colour space, and what its channels are."""
    profile, definition = metadata.get("icc_profile"), metadata.get("cdef")

    def box(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I4s", 8 + len(content), name) + content

    def header(content: bytes) -> bytes:
        own = b"".join(
            box(name, b"\x02\0\0" + profile if profile and name == b"colr" else value)
            for name, value in boxes(content)
        )
        return own + (box(b"cdef", definition) if definition else b"")

    return b"".join(
        box(name, header(content) if name == b"jp2h" else content) for name, content in boxes(data)
    )


def _tiff(path: Path, picture: Picture) -> None:
    import tifffile

    if picture.transfer is None:
        codes = _floats(picture)
    else:
        codes = _in_sixteen_bits(_codes(picture), picture.transfer.table.shape[1] - 1)
    codes = codes[..., 0] if codes.ndim == 3 and codes.shape[-1] == 1 else codes
    alpha: dict[str, Any] = {"extrasamples": ["unassalpha"]} if picture.alpha is not None else {}
    photometric = "rgb" if codes.ndim == 3 and codes.shape[-1] >= 3 else "minisblack"
    options = {"photometric": photometric, "metadata": None, **alpha, **picture.metadata}
    tifffile.imwrite(path, codes, **options)


def _floats(picture: Picture) -> AnyArray:
    """Light of a picture of floats, multiplied by its opacity if it came so, and that opacity."""
    if picture.alpha is None:
        return picture.linear
    light = picture.linear
    if picture.premultiplied:
        light = times_alpha(light, picture.alpha)
    return np.concatenate([light, picture.alpha[..., None].astype(np.float32)], axis=-1)


def _ppm(path: Path, picture: Picture) -> None:
    """A binary PPM or PGM with the largest code that it came with."""
    assert picture.transfer is not None
    codes, largest = _codes(picture), picture.transfer.table.shape[1] - 1
    height, width = codes.shape[:2]
    header = f"P{6 if codes.ndim == 3 else 5}\n{width} {height}\n{largest}\n"
    dtype = "u1" if largest <= _COARSE else ">u2"
    path.write_bytes(header.encode() + codes.astype(dtype).tobytes())


def _pfm(path: Path, picture: Picture) -> None:
    """A PFM, the bottom row first, the low byte first."""
    height, width, channels = picture.linear.shape
    header = f"{'PF' if channels == 3 else 'Pf'}\n{width} {height}\n-1.0\n"
    path.write_bytes(header.encode() + picture.linear[::-1].astype("<f4").tobytes())


def _exr(path: Path, picture: Picture) -> None:
    import OpenEXR

    metadata, light = picture.metadata, picture.linear
    if picture.premultiplied and picture.alpha is not None:
        light = times_alpha(light, picture.alpha)
    names = metadata.get("names", ("R", "G", "B") if light.shape[-1] == 3 else ("Y",))
    dtype = metadata.get("dtype", np.float32)
    largest = np.finfo(dtype).max  # a filter's exposure may leave the range of half floats
    light = np.clip(light, -largest, largest)
    channels = {
        name: np.ascontiguousarray(light[..., i].astype(dtype)) for i, name in enumerate(names)
    }
    channels |= {name: np.ascontiguousarray(c) for name, c in picture.others.items()}
    if picture.alpha is not None:
        channels[metadata.get("alpha", "A")] = np.ascontiguousarray(picture.alpha)
    compression = lossless_compression(metadata.get("compression", "ZIP"))
    header = {
        "compression": getattr(OpenEXR, f"{compression}_COMPRESSION"),
        "type": OpenEXR.scanlineimage,
    }
    kept = {name: restored(value) for name, value in metadata.get("header", {}).items()}
    with OpenEXR.File({**kept, **header}, channels) as file:
        try:
            file.write(str(path))
        except RuntimeError as error:  # on a full disk, too
            reason = str(error).rsplit('". ', 1)[-1]  # without the name that it begins with
            raise OSError(reason) from None
