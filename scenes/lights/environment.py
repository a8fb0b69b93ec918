"""Radiance maps of light from all around.

A map is equirectangular, its rows from straight up (+y) to straight down, its columns by the angle
atan2(x, −z) from 0 to 2π: the first column shows the direction behind the object. A pixel's middle
has its radiance; between middles it is interpolated in both angles, beyond the outermost rows it is
theirs.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np

from malus.scenes.core.arrays import Float32Array, Float64Array
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.pfm import read_pfm
from malus.scenes.core.quiet import quiet
from malus.scenes.core.rgbe import read_rgbe
from malus.scenes.lights import interior, sky
from malus.scenes.lights.lights import (
    LEAST_STRENGTH,
    MOST_STRENGTH,
    Interior,
    MapLight,
    Sky,
)

HEIGHT = 128
"""Rows of the map that malus brings."""
SKY_HEIGHT = 256
"""Rows of a sky's map: its horizon is blurred by 0.15 % of the light that a sphere reflects."""

_LAYOUTS = {
    (1, 1): "a mirror ball or an angular map (light probe)",
    (4, 3): "a cube's cross",
    (3, 4): "a cube's cross",
    (6, 1): "a cube's strip",
    (1, 6): "a cube's strip",
    (1, 2): "a latitude-longitude map on its side",
}
"""Other layouts by their width and height."""

_WINDOWS = ("data", "display")

LARGEST_PIXELS = 1 << 26
"""Most pixels of a map, 64 megapixels: bounds the memory that a hostile file can ask for."""


@functools.lru_cache(maxsize=4)
def radiance_map(light: MapLight) -> Float32Array:
    """Radiance of a map (height, width), the same in every band; of a sky without its sun.

    Raises
    ------
    InputError
        Unknown name, a file with another content than the light's digest tells, or one that is not
        a readable map of non-negative finite radiance.

    Examples
    --------
    >>> from malus.scenes import Environment
    >>> radiance_map(Environment()).shape
    (128, 256)
    """
    if isinstance(light, Sky):
        return sky.radiance(light, directions(SKY_HEIGHT, 2 * SKY_HEIGHT)).astype(np.float32)
    if isinstance(light, Interior):
        toward = directions(interior.HEIGHT, 2 * interior.HEIGHT)
        weights = solid_angles(interior.HEIGHT, 2 * interior.HEIGHT)
        return interior.interior_radiance(light, toward, weights).astype(np.float32)
    if light.name == "studio":
        return _studio()
    readers = {".exr": _read_exr_map, ".hdr": _read_colours, ".pfm": _read_colours}
    suffix = light.file.suffix.lower()
    if suffix not in readers:
        expected = "studio, or the path of an .exr, .hdr or .pfm file"
        raise InputError("environment", expected, light.name, "correct the name")
    path = light.checked()
    return _valid_radiance(readers[suffix](path), path)


def directions(height: int, width: int, rotation: Float64Array | None = None) -> Float64Array:
    """Unit vectors towards the pixels' centres of a map, shape (height, width, 3).

    `rotation` (3, 3) is the light's, from the map's axes to the world.

    Examples
    --------
    >>> directions(1, 4)[0, 1].round(6).tolist()  # a quarter turn from behind: to the right
    [0.707107, 0.0, 0.707107]
    """
    polar = (np.arange(height) + 0.5) * (math.pi / height)
    turn = (np.arange(width) + 0.5) * (2 * math.pi / width)
    sine = np.sin(polar)[:, None]
    x, z = sine * np.sin(turn), -sine * np.cos(turn)
    toward = np.stack([x, np.broadcast_to(np.cos(polar)[:, None], x.shape), z], axis=-1)
    return toward if rotation is None else toward @ rotation.T


def solid_angles(height: int, width: int) -> Float64Array:
    """Solid angle of each row's pixels, steradians, shape (height, 1).

    Examples
    --------
    >>> round(float(solid_angles(64, 128).sum() * 128 / math.pi), 9)
    4.0
    """
    edges = np.cos(np.linspace(0.0, math.pi, height + 1))
    return (edges[:-1] - edges[1:])[:, None] * (2 * math.pi / width)


def light_shares(height: int, width: int) -> Float64Array:
    """Steradians over which each row's pixels shine, shape (height, 1), as maps are interpolated.

    A row shines half-way into both beside it, and an outermost one over all of its pole besides:
    those have 8 % more than their band of `solid_angles`.

    Examples
    --------
    >>> (light_shares(64, 128) / solid_angles(64, 128))[[0, 1, -1], 0].round(3).tolist()
    [1.083, 1.0, 1.083]
    """
    step = math.pi / height
    middles = (np.arange(height) + 0.5) * step
    # Integrals of straight flanks, which fall to zero a step from the middle, times the sine.
    shares = np.sin(middles) * (2.0 * (1.0 - math.cos(step)) / step)
    shares[[0, -1]] = (2.0 - shares[1:-1].sum()) / min(height, 2)
    return shares[:, None] * (2 * math.pi / width)


def _studio() -> Float32Array:
    """Two soft lamps, a bright ceiling and a dim floor: smooth, so that no pixel shows."""
    toward = directions(HEIGHT, 2 * HEIGHT)
    key = np.array([0.55, 0.45, 0.70])
    rim = np.array([-0.85, 0.20, -0.10])
    light = 0.15 + 0.35 * np.clip(toward[..., 1], 0, None) ** 2
    for axis, strength, sharpness in ((key, 9.0, 40.0), (rim, 6.0, 25.0)):
        cosine = toward @ (axis / np.linalg.norm(axis))
        light = light + strength * np.exp(sharpness * (cosine - 1.0))
    return light.astype(np.float32)


def _read_exr_map(path: Path) -> Float32Array:
    """Mean of the colours of an EXR file that is a whole latitude-longitude map."""
    header = _exr_header(path)
    name = getattr(header.get("envmap"), "name", "ENVMAP_LATLONG")
    if name != "ENVMAP_LATLONG":
        found = "a cube map" if name == "ENVMAP_CUBE" else name
        hint = "convert it, with OpenEXR's `exrenvmap -latlong` say"
        raise InputError(str(path), "a latitude-longitude map (attribute envmap)", found, hint)
    values = read_grey(path)
    if "envmap" not in header:
        _check_layout(path, values)
    return values


def _check_layout(path: Path, values: Float32Array) -> None:
    """Refuse what has the shape of another layout, where the file does not tell which it has."""
    height, width = values.shape
    for (across, down), what in _LAYOUTS.items():
        if across * height == down * width:
            hint = "convert it to one, or let OpenEXR's attribute envmap say that it is one"
            found = f"{width} x {height}, the shape of {what}"
            raise InputError(
                str(path), "a latitude-longitude map, twice as wide as high", found, hint
            )


def read_grey(path: Path) -> Float32Array:
    """Mean of the colours of an EXR file, (rows, columns) from the top.

    Raises
    ------
    InputError
        A file that is missing, malformed, without colours or larger than 64 megapixels; one of
        several parts, of deep data, of luminance and chroma, or that holds a part of its picture.
    """
    import OpenEXR

    _exr_header(path)
    with (
        reading(str(path), "a readable EXR file", "check the path"),
        quiet(),
        OpenEXR.File(str(path), separate_channels=True) as file,
    ):
        channels = {name: np.asarray(c.pixels) for name, c in file.channels().items()}
    if {"Y", "RY", "BY"} <= set(channels):
        found = "luminance and chroma (Y, RY, BY)"
        raise InputError(str(path), "channels R, G, B or Y", found, "export it as RGB")
    colours = [channels[name] for name in ("R", "G", "B") if name in channels]
    colours = colours or [channels[name] for name in ("Y",) if name in channels]
    if not colours:
        raise InputError(
            str(path), "channels R, G, B or Y", ", ".join(channels), "export it as RGB"
        )
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused by name
        return np.mean(colours, axis=0).astype(np.float32)


def _exr_header(path: Path) -> dict[str, Any]:
    """Header of an EXR file of one flat part, checked for its size before a pixel is decoded."""
    import OpenEXR

    with (
        reading(str(path), "a readable EXR file", "check the path"),
        quiet(),
        OpenEXR.File(str(path), header_only=True) as file,
    ):
        headers = [dict(part.header) for part in file.parts]
        header = headers[0]
        window = header["dataWindow"]
        size = np.asarray(window[1], np.int64) - np.asarray(window[0], np.int64) + 1
        storage = str(header["type"])
    if len(headers) > 1:
        names = ", ".join(str(part.get("name", number)) for number, part in enumerate(headers, 1))
        hint = "save the one that is meant alone"
        raise InputError(str(path), "one picture", f"parts {names}", hint)
    if "deep" in storage:
        raise InputError(str(path), "one value a pixel and channel", storage, "flatten it first")
    check_size(path, int(size[0]), int(size[1]))
    data, display = (np.asarray(header[f"{window}Window"]).tolist() for window in _WINDOWS)
    if data != display:
        found = f"a part of it: data window {data} in display window {display}"
        raise InputError(str(path), "a whole picture", found, "export all of it")
    return header


def _read_colours(path: Path) -> Float32Array:
    """Mean of the colours of a file in Radiance's RGBE format, or of a PFM; rows from the top."""
    colours = (read_pfm if path.suffix.lower() == ".pfm" else read_rgbe)(path, check_size)
    with np.errstate(over="ignore"):  # infinite radiance is refused by name
        values = np.asarray(colours.mean(axis=-1), dtype=np.float32)
    _check_layout(path, values)
    return values


def check_size(path: Path, width: int, height: int) -> None:
    """Raise InputError for a picture of more than 64 megapixels, before it is decoded."""
    if width * height > LARGEST_PIXELS:
        raise InputError(
            str(path), "at most 64 megapixels", f"{width} x {height}", "make it smaller"
        )


def _valid_radiance(values: Float32Array, path: Path) -> Float32Array:
    """The values themselves.

    Raises
    ------
    InputError
        Unless they are finite and not negative, and the largest is a `Strength`.
    """
    if values.size < 2 or not np.isfinite(values).all() or values.min() < 0 or values.max() <= 0:
        raise InputError(
            str(path),
            "finite radiance, not negative and not all zero",
            f"values from {values.min(initial=0)} to {values.max(initial=0)}",
            "repair the map",
        )
    if not LEAST_STRENGTH <= values.max() <= MOST_STRENGTH:
        expected = f"a largest radiance of {LEAST_STRENGTH:g} to {MOST_STRENGTH:g}"
        raise InputError(str(path), expected, f"{values.max():g}", "scale the map")
    return values
