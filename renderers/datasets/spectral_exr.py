"""Spectral Stokes images as OpenEXR files, in the layout of other tools.

Source: Fichet, Pacanowski and Wilkie, "An OpenEXR Layout for Spectral Images", JCGT 10(3), 2021.
Channels are 32-bit floats `S0.550,000000nm`: the Stokes component, then the band's centre as the
authors' library prints it. That library requires all four components, so S3 is written as zero:
malus renders linear Stokes vectors only. R, G and B are a preview.

Files are not trusted: the header is compared with what is expected, size included, before a pixel
is decoded, and every failure is one InputError.
"""

from __future__ import annotations

import math
import stat
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from malus.renderers.datasets.stokes_channels import (
    Channels,
    channel_name,
    stokes_channels,
    stokes_from_channels,
)
from malus.scenes.colour import preview
from malus.scenes.core.arrays import AnyArray, FloatArray
from malus.scenes.core.errors import InputError, first_line, reading
from malus.scenes.core.quiet import quiet
from malus.scenes.core.remote import lstat, readable

ATTRIBUTES = {
    "spectralLayoutVersion": "1.0",
    "emissiveUnits": "W.m^-2.sr^-1",
    "polarisationHandedness": "right",
}
"""Attributes that the layout requires of an image of emitted, polarised light."""

MAX_IMAGE_BYTES = 1 << 31
"""Most bytes of a decoded image: 2 GiB, 8192² pixels of one band in two Stokes images."""

_PREVIEW = ("R", "G", "B")
_LOSSLESS = ("NO_COMPRESSION", "RLE_COMPRESSION", "ZIPS_COMPRESSION", "ZIP_COMPRESSION")
_PIXEL_BYTES = 4
_DECODING_ERRORS = (
    RuntimeError, ValueError, TypeError, AttributeError, LookupError, MemoryError, OSError,
)  # fmt: skip
_OVERHEAD = 1 << 20
"""Most bytes that a header and a table of chunks add to the pixels."""


def write_spectral(path: Path, stokes: FloatArray, wavelengths_nm: tuple[float, ...]) -> None:
    """Write a Stokes image (height, width, bands, 3) in the spectral layout, with a preview."""
    dark = np.zeros(stokes.shape[:2], dtype=np.float32)
    channels: Channels = dict(stokes_channels(stokes, wavelengths_nm))
    channels |= {channel_name(3, wavelength): dark for wavelength in wavelengths_nm}
    colours = preview(stokes[..., 0], wavelengths_nm)
    channels |= {name: colours[..., index] for index, name in enumerate(_PREVIEW)}
    write_exr(path, channels, ATTRIBUTES)


def read_spectral(
    path: Path, shape: tuple[int, int], wavelengths_nm: Sequence[float]
) -> FloatArray:
    """Read a Stokes image (height, width, bands, 3); S3 and the preview may be missing.

    Raises
    ------
    InputError
        Not such a file, other bands or another size.
    """
    linear = [channel_name(part, nm) for nm in wavelengths_nm for part in range(3)]
    circular = [channel_name(3, nm) for nm in wavelengths_nm]
    channels = read_exr(path, shape, linear, optional=[*circular, *_PREVIEW])
    return stokes_from_channels(channels, wavelengths_nm)


def write_exr(
    path: Path, channels: Mapping[str, AnyArray], attributes: Mapping[str, str] | None = None
) -> None:
    """Write planes (height, width) as one lossless OpenEXR file: floats as 32 bits, or uint32.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    # OpenEXR takes the buffer of a strided view for a whole array, without a word.
    planes = {name: np.ascontiguousarray(_storable(plane)) for name, plane in channels.items()}
    try:
        OpenEXR.File(header | dict(attributes or {}), planes).write(str(path))
    except RuntimeError as error:
        hint = "free some space or choose another folder"
        raise InputError(str(path), "a file that can be written", _reason(error), hint) from None


def read_exr(
    path: Path,
    shape: tuple[int, int],
    required: Iterable[str],
    optional: Iterable[str] = (),
    dtype: type[np.generic] = np.float32,
) -> Channels:
    """Read the `required` planes of a file with these channels, maybe `optional` ones, no others.

    Raises
    ------
    InputError
        A link, a file too large, no OpenEXR file, another size, other channels, other pixels.
    """
    names = list(required)
    allowed = {*names, *optional}
    _check_size(path, shape, len(allowed))
    with readable(path) as file:
        _check_header(path, _opened(file, header_only=True), shape, set(names), allowed)
        decoded = _decoded(path, _opened(file, header_only=False))
    planes: Channels = {}
    for name in names:
        plane = decoded[name]
        if plane is None or plane.dtype != dtype or plane.shape != shape:
            kind = "no pixels" if plane is None else f"{plane.dtype} {plane.shape}"
            expected = f"{np.dtype(dtype)} {shape}"
            raise InputError(f"{path}, channel {name}", expected, kind, "write the file again")
        planes[name] = plane
    return planes


def _storable(plane: AnyArray) -> AnyArray:
    return plane if plane.dtype == np.uint32 else plane.astype(np.float32, copy=False)


def _check_size(path: Path, shape: tuple[int, int], channels: int) -> None:
    decoded = math.prod(shape) * channels * _PIXEL_BYTES
    hint = "is this file from malus?"
    if decoded > MAX_IMAGE_BYTES:
        limit = f"an image of at most {MAX_IMAGE_BYTES} bytes"
        raise InputError(str(path), limit, f"{decoded} bytes", "split the bands over scenes")
    with reading(str(path), "a file", hint):
        status = lstat(path)
    if not stat.S_ISREG(status.st_mode):
        raise InputError(str(path), "a regular file", "a link or something else", hint)
    if status.st_size > decoded + _OVERHEAD:
        limit = f"at most {decoded + _OVERHEAD} bytes"
        raise InputError(str(path), limit, f"{status.st_size} bytes", hint)


def _opened(path: Path, header_only: bool) -> Any:
    return _decoding(path, lambda: OpenEXR.File(str(path), True, header_only))


def _decoded(path: Path, file: Any) -> dict[str, AnyArray | None]:
    return {name: channel.pixels for name, channel in _decoding(path, file.channels).items()}


def _decoding(path: Path, read: Callable[[], Any]) -> Any:
    try:
        with quiet():
            return read()
    # OpenEXR's binding has no exception of its own: what it throws depends on where it stumbles.
    except _DECODING_ERRORS as error:
        hint = "the file is damaged: write it again"
        raise InputError(str(path), "an OpenEXR file", _reason(error), hint) from None


def _check_header(
    path: Path, file: Any, shape: tuple[int, int], required: set[str], allowed: set[str]
) -> None:
    # Names and attributes are decoded on access, so that access may fail too.
    for holds, expected, found in _decoding(
        path, lambda: _header_conditions(file, shape, required, allowed)
    ):
        if not holds:
            raise InputError(str(path), expected, found, "write the file again")


def _header_conditions(
    file: Any, shape: tuple[int, int], required: set[str], allowed: set[str]
) -> list[tuple[bool, str, str]]:
    """Conditions on a header: whether each holds, what is expected and what was found."""
    header = file.header()
    low, high = header["dataWindow"]
    window = tuple(int(b) - int(a) + 1 for a, b in zip(low[::-1], high[::-1], strict=True))
    names = {channel.name for channel in header["channels"]}
    dense = all((c.xSampling, c.ySampling) == (1, 1) for c in header["channels"])
    compression = header["compression"].name
    return [
        (len(file.parts) == 1, "one part", f"{len(file.parts)}"),
        (header["type"] == OpenEXR.scanlineimage, "a scan-line image", str(header["type"])),
        (compression in _LOSSLESS, f"one of {', '.join(_LOSSLESS)}", compression),
        (window == shape, f"{shape[1]} × {shape[0]} pixels", f"{window[1]} × {window[0]}"),
        (not required - names, f"channel {_first(required - names)}", "no such channel"),
        (not names - allowed, "no further channel", f"channel {_first(names - allowed)}"),
        (dense, "a value a pixel", "subsampled channels"),
    ]


def _first(names: set[str]) -> str:
    return min(names, default="")


def _reason(error: Exception) -> str:
    """OpenEXR's reason, without the file's name that it begins with."""
    return first_line(error).rsplit('". ', 1)[-1]
