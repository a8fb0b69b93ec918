"""Pictures out, in the form that they were read in: whole or not at all."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.photos.picture import Picture
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.files import replace_file

_JPEG_QUALITY = 95


def write_picture(path: Path, picture: Picture) -> None:
    """Write a picture in the form that it was read in: whole or not at all.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    writers = {"PNG": _png, "JPEG": _jpeg, "TIFF": _tiff, "EXR": _exr}
    replace_file(path, lambda temporary: writers[picture.kind](temporary, picture))


def _codes(picture: Picture) -> AnyArray:
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
