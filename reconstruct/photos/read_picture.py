"""Ordinary pictures in and out: linear light inside, and outside the form that they came in.

PNG and TIFF of 8 or 16 bits, JPEG, TIFF and OpenEXR of floats; grey or RGB, with or without alpha.
Size, bit depth, profile and metadata go out as they came in. A picture with an EXIF orientation is
turned upright first, because the angles of a polariser are those that a viewer sees.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.photos.picture import (
    ORIENTATION,
    Picture,
    check_size,
    from_codes,
    transfer_of,
    upright,
)
from malus.reconstruct.photos.read_tiff_exr import read_exr, read_tiff
from malus.scenes.core.errors import InputError, first_line

SUFFIXES = {
    ".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".tif": "TIFF", ".tiff": "TIFF", ".exr": "EXR",
}  # fmt: skip
_MODES = {"L": 8, "LA": 8, "RGB": 8, "RGBA": 8, "I;16": 16, "I;16B": 16}
_REFUSED = {
    "1": "1 bit a pixel",
    "P": "a palette",
    "PA": "a palette",
    "CMYK": "CMYK inks",
    "YCCK": "CMYK inks",
    "LAB": "CIELAB",
}


def read_picture(path: Path | str, linear: bool = False) -> Picture:
    """Read a picture as linear light, with what is needed to write another one like it.

    Parameters
    ----------
    path : Path or str
    linear : bool
        Take the codes of an integer file for linear light, whatever its profile says.

    Raises
    ------
    InputError
        Missing, damaged or truncated file, an unknown format, too many pixels, CMYK, a palette or
        1 bit a pixel: one line that says what to do.

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
    path = Path(path)
    readers: dict[str, Callable[[Path, bool], Picture]] = {
        "EXR": read_exr,
        "TIFF": read_tiff,
    }
    kind = SUFFIXES.get(path.suffix.lower())
    if kind is None:
        suffixes = ", ".join(sorted(SUFFIXES))
        raise InputError(
            str(path), f"a file of {suffixes}", path.suffix or "no suffix", "convert it"
        )
    if not path.is_file():
        raise InputError(str(path), "a picture", "no such file", "check the path")
    if kind in readers:
        return readers[kind](path, linear)
    return _read_common(path, linear)


def _read_common(path: Path, linear: bool) -> Picture:
    """PNG and JPEG through Pillow, 16-bit colour through imagecodecs."""
    import PIL.Image

    try:
        with warnings.catch_warnings():
            # Pillow warns of large pictures; `check_size` decides about them.
            warnings.simplefilter("ignore")
            limit, PIL.Image.MAX_IMAGE_PIXELS = PIL.Image.MAX_IMAGE_PIXELS, None
            try:
                opened = PIL.Image.open(path, formats=("PNG", "JPEG"))
            finally:
                PIL.Image.MAX_IMAGE_PIXELS = limit
            with opened as image:
                check_size(path, *image.size)
                _check_mode(path, image.mode)
                image.load()
                orientation = int(image.getexif().get(ORIENTATION, 1))
                metadata = _metadata(image)
                kind, bits = str(image.format), _bits(path, image)
                codes = np.asarray(image)
    except InputError:
        raise
    except (OSError, SyntaxError, ValueError, EOFError, MemoryError) as error:
        reason = first_line(error)
        raise InputError(str(path), "a whole PNG or JPEG file", reason, "save it again") from None
    if bits == 16 and codes.dtype == np.uint8:
        codes = _deep_png(path)
    transfer = transfer_of(metadata.get("icc_profile"), bits, linear, path)
    return from_codes(upright(codes, orientation), kind, transfer, metadata)


def _check_mode(path: Path, mode: str) -> None:
    if mode not in _MODES:
        form = _REFUSED.get(mode, f"mode {mode}")
        raise InputError(str(path), "grey or RGB of 8 or 16 bits", form, "convert it to RGB")


def _metadata(image: Any) -> dict[str, Any]:
    """Profile, EXIF (upright), resolution and comments, as Pillow's writers take them."""
    exif = image.getexif()
    exif.pop(ORIENTATION, None)
    kept = {
        name: image.info[name] for name in ("icc_profile", "dpi", "comment") if image.info.get(name)
    }
    if len(exif):
        kept["exif"] = exif.tobytes()
    texts = getattr(image, "text", None)
    if texts:
        kept["text"] = {str(key): str(value) for key, value in texts.items()}
    return kept


def _bits(path: Path, image: Any) -> int:
    """Bits a channel: Pillow reads 16-bit colour as 8, so that the PNG's header is asked."""
    if image.format == "PNG":
        header = path.open("rb").read(25)
        return 16 if header[24] == 16 else 8
    return _MODES[image.mode]


def _deep_png(path: Path) -> NDArray[np.uint16]:
    try:
        import imagecodecs
    except ImportError:
        raise InputError(
            str(path),
            "the package imagecodecs for 16-bit colour",
            "nothing",
            "pip install imagecodecs",
        ) from None
    try:
        return np.asarray(imagecodecs.png_decode(path.read_bytes()), dtype=np.uint16)
    except (imagecodecs.PngError, ValueError) as error:
        raise InputError(str(path), "a whole PNG file", str(error), "save it again") from None
