"""Spectral Stokes images as OpenEXR files, in the layout of other tools.

Source: Fichet, Pacanowski and Wilkie, "An OpenEXR Layout for Spectral Images", JCGT 10(3), 2021.
Channels are 32-bit floats `S0.550,000000nm`: the Stokes component, then the band's centre as the
authors' library prints it. That library requires all four components, so S3 is written as zero
where a truth has none. R, G and B are a preview.

Files of other programs print wavelengths with other numbers of decimals, hold half floats, compress
otherwise, have further channels (opacity, more bands) or count s2 and s3 left-handedly; all that is
read. Files are not trusted: the header is compared with what is expected, size included, before a
pixel is decoded, and every failure is one InputError.
"""

from __future__ import annotations

import math
import re
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from malus.renderers.datasets.stokes_channels import (
    Channels,
    channel_name,
    matching_channels,
    stokes_channels,
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
_OWN_COMPRESSION = ("NO_COMPRESSION", "RLE_COMPRESSION", "ZIPS_COMPRESSION", "ZIP_COMPRESSION")
_LOSSLESS = (
    *_OWN_COMPRESSION,
    *(f"{name}_COMPRESSION" for name in ("PIZ", "ZSTD", "HTJ2K32", "HTJ2K256")),
)
_LOSSLESS_FOR_HALF = "PXR24_COMPRESSION"
"""Cuts floats to 24 bits, but loses nothing of half floats."""
_MITSUBA_COLOUR = re.compile(r"S[0-3]\.[RGBY]")
_HANDEDNESS = {"right": 1.0, "left": -1.0}
"""Sign of s2 and s3 in our convention, by the attribute of the layout."""
_PIXEL_BYTES = 4
_DECODING_ERRORS = (
    RuntimeError, ValueError, TypeError, AttributeError, LookupError, MemoryError, OSError,
)  # fmt: skip
_OVERHEAD = 1 << 20
"""Most bytes that a header and a table of chunks add to the pixels."""

Condition = tuple[bool, str, str]
"""Whether it holds, what is expected and what was found."""


def write_spectral(
    path: Path, stokes: FloatArray, wavelengths_nm: tuple[float, ...], s3: FloatArray | None = None
) -> None:
    """Write a Stokes image (height, width, bands, 3) in the spectral layout, with a preview.

    `s3` (height, width, bands) is its fourth component; zero where None.
    """
    fourth = np.zeros(stokes.shape[:3], dtype=np.float32) if s3 is None else s3
    channels: Channels = dict(stokes_channels(stokes, wavelengths_nm))
    for band, wavelength in enumerate(wavelengths_nm):
        channels[channel_name(3, wavelength)] = fourth[:, :, band]
    colours = preview(stokes[..., 0], wavelengths_nm)
    channels |= {name: colours[..., index] for index, name in enumerate(_PREVIEW)}
    write_exr(path, channels, ATTRIBUTES)


def read_spectral(
    path: Path, shape: tuple[int, int], wavelengths_nm: Sequence[float], components: int = 3
) -> FloatArray:
    """Read a Stokes image (height, width, bands, components) in float32 from a file of the layout.

    Bands are found by the value of their wavelength. Further components (S3, unless 4 are asked
    for), other bands and other channels may be there or not. s2 and s3 are turned to the
    right-handed convention where the file says that they are left-handed; one that says nothing is
    taken as right-handed.

    Raises
    ------
    InputError
        Not such a file, no such bands, another size, a lossy compression, colours instead of bands.
    """
    _check_memory(path, shape, components * len(wavelengths_nm))
    _check_regular(path)
    with readable(path) as file:
        opened = _opened(file, header_only=True)
        header = _decoding(path, opened.header)
        # Names and attributes are decoded on access, so that access may fail too.
        names = _decoding(path, lambda: _band_names(path, header, wavelengths_nm, components))
        used = [name for of_band in names for name in of_band]
        _check_conditions(path, lambda: _spectral_conditions(opened, shape, set(used)))
        sign = _decoding(path, lambda: _sign_of_s2(path, header))
        _check_memory(path, shape, len(header["channels"]))
        _check_bytes(path, shape, len(header["channels"]))
        decoded = _decoded(path, _opened(file, header_only=False))
    half_alone = header["compression"].name == _LOSSLESS_FOR_HALF
    dtypes = ("float16",) if half_alone else ("float16", "float32")
    planes = _checked_planes(path, decoded, used, shape, dtypes)
    stokes = np.empty((*shape, len(names), components), np.float32)
    for band, of_band in enumerate(names):
        for component, name in enumerate(of_band):
            stokes[:, :, band, component] = planes[name]
    stokes[..., 2:] *= np.float32(sign)
    return stokes


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
    channels: Iterable[str],
    dtype: type[np.generic] = np.float32,
) -> Channels:
    """Read the planes of a file with these channels and no others.

    Raises
    ------
    InputError
        A link, a file too large, no OpenEXR file, another size, other channels, other pixels.
    """
    names = list(channels)
    _check_memory(path, shape, len(names))
    _check_regular(path)
    _check_bytes(path, shape, len(names))
    with readable(path) as file:
        opened = _opened(file, header_only=True)
        _check_conditions(path, lambda: _header_conditions(opened, shape, set(names)))
        decoded = _decoded(path, _opened(file, header_only=False))
    return _checked_planes(path, decoded, names, shape, (np.dtype(dtype).name,))


def _checked_planes(
    path: Path,
    decoded: Mapping[str, AnyArray | None],
    names: Iterable[str],
    shape: tuple[int, int],
    dtypes: tuple[str, ...],
) -> Channels:
    """The named planes; raises InputError where one has another size or type."""
    planes: Channels = {}
    for name in names:
        plane = decoded[name]
        if plane is None or plane.dtype.name not in dtypes or plane.shape != shape:
            kind = "no pixels" if plane is None else f"{plane.dtype} {plane.shape}"
            expected = f"{' or '.join(dtypes)} {shape}"
            raise InputError(f"{path}, channel {name}", expected, kind, "write the file again")
        planes[name] = plane
    return planes


def _band_names(
    path: Path, header: Mapping[str, Any], wavelengths_nm: Sequence[float], count: int
) -> list[tuple[str, ...]]:
    """Names of the first channels s0, s1, … of each band; InputError where one is missing."""
    names = [channel.name for channel in header["channels"]]
    if colours := sorted(name for name in names if _MITSUBA_COLOUR.fullmatch(name)):
        found = f"colours instead of bands: channel {colours[0]}, as Mitsuba's integrator writes"
        hint = "render one band at a time in a mono variant"
        raise InputError(str(path), f"channel {channel_name(0, wavelengths_nm[0])}", found, hint)
    components = []
    for component in range(count):
        matches = matching_channels(names, wavelengths_nm, component)
        for nm, candidates in zip(wavelengths_nm, matches, strict=True):
            expected = f"channel {channel_name(component, nm)}"
            if not candidates:
                raise InputError(str(path), expected, "no such channel", "write the file again")
            if len(candidates) > 1 or matches.count(candidates) > 1:
                found = f"{', '.join(candidates)} for more than one band or twice for one"
                raise InputError(str(path), f"one {expected}", found, "write the file again")
        components.append([candidates[0] for candidates in matches])
    return list(zip(*components, strict=True))


def _sign_of_s2(path: Path, header: Mapping[str, Any]) -> float:
    """1 where s2 and s3 are counted as here, −1 where the file says that they are left-handed."""
    handedness = str(header.get("polarisationHandedness", "right")).strip().lower()
    if handedness not in _HANDEDNESS:
        where = f"{path}, attribute polarisationHandedness"
        raise InputError(where, "right or left", repr(handedness)[:40], "export it again")
    return _HANDEDNESS[handedness]


def _storable(plane: AnyArray) -> AnyArray:
    return plane if plane.dtype == np.uint32 else plane.astype(np.float32, copy=False)


def _check_regular(path: Path) -> None:
    hint = "is this file from malus?"
    with reading(str(path), "a file", hint):
        status = lstat(path)
    if not stat.S_ISREG(status.st_mode):
        raise InputError(str(path), "a regular file", "a link or something else", hint)


def _check_memory(path: Path, shape: tuple[int, int], channels: int) -> None:
    decoded = math.prod(shape) * channels * _PIXEL_BYTES
    if decoded > MAX_IMAGE_BYTES:
        limit = f"an image of at most {MAX_IMAGE_BYTES} bytes"
        raise InputError(str(path), limit, f"{decoded} bytes", "split the bands over scenes")


def _check_bytes(path: Path, shape: tuple[int, int], channels: int) -> None:
    limit, size = math.prod(shape) * channels * _PIXEL_BYTES + _OVERHEAD, lstat(path).st_size
    if size > limit:
        expected = f"at most {limit} bytes"
        raise InputError(str(path), expected, f"{size} bytes", "is this file from malus?")


def _opened(path: Path, header_only: bool) -> Any:
    return _decoding(path, lambda: OpenEXR.File(str(path), True, header_only))


def _decoded(path: Path, file: Any) -> dict[str, AnyArray | None]:
    return {name: channel.pixels for name, channel in _decoding(path, file.channels).items()}


def _decoding(path: Path, read: Callable[[], Any]) -> Any:
    try:
        with quiet():
            return read()
    except InputError:  # says what is wrong already
        raise
    # OpenEXR's binding has no exception of its own: what it throws depends on where it stumbles.
    except _DECODING_ERRORS as error:
        hint = "the file is damaged: write it again"
        raise InputError(str(path), "an OpenEXR file", _reason(error), hint) from None


def _check_conditions(path: Path, conditions: Callable[[], list[Condition]]) -> None:
    """Raise InputError for the first condition on a header that does not hold."""
    for holds, expected, found in _decoding(path, conditions):
        if not holds:
            raise InputError(str(path), expected, found, "write the file again")


def _header_conditions(file: Any, shape: tuple[int, int], wanted: set[str]) -> list[Condition]:
    """Conditions on the header of a file of malus: these channels and no others."""
    header = file.header()
    names = {channel.name for channel in header["channels"]}
    return [
        *_size_conditions(len(file.parts), header, shape, names),
        (header["type"] == OpenEXR.scanlineimage, "a scan-line image", str(header["type"])),
        _compression_condition(header, _OWN_COMPRESSION),
        (not wanted - names, f"channel {_first(wanted - names)}", "no such channel"),
        (not names - wanted, "no further channel", f"channel {_first(names - wanted)}"),
    ]


def _spectral_conditions(file: Any, shape: tuple[int, int], used: set[str]) -> list[Condition]:
    """Conditions on the header of any program's file, of which `used` channels are read."""
    header = file.header()
    storage = str(header["type"])
    return [
        *_size_conditions(len(file.parts), header, shape, used),
        ("deep" not in storage, "one value a pixel and channel", storage),
        _compression_condition(header, (*_LOSSLESS, _LOSSLESS_FOR_HALF)),
    ]


def _size_conditions(
    parts: int, header: Mapping[str, Any], shape: tuple[int, int], used: set[str]
) -> Iterator[Condition]:
    """One part, of this size, with a value in every pixel of the channels that are used."""
    low, high = header["dataWindow"]
    window = tuple(int(b) - int(a) + 1 for a, b in zip(low[::-1], high[::-1], strict=True))
    sampling = [(c.xSampling, c.ySampling) for c in header["channels"] if c.name in used]
    yield parts == 1, "one part", f"{parts}"
    yield window == shape, f"{shape[1]} × {shape[0]} pixels", f"{window[1]} × {window[0]}"
    yield set(sampling) <= {(1, 1)}, "a value a pixel", "subsampled channels"


def _compression_condition(header: Mapping[str, Any], lossless: tuple[str, ...]) -> Condition:
    name = header["compression"].name
    return name in lossless, f"one of {', '.join(lossless)}", name


def _first(names: set[str]) -> str:
    return min(names, default="")


def _reason(error: Exception) -> str:
    """OpenEXR's reason, without the file's name that it begins with."""
    return first_line(error).rsplit('". ', 1)[-1]
