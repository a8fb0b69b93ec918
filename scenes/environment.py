"""Radiance maps of light from all around.

A map is equirectangular, its rows from straight up (+y) to straight down, its
columns by the angle atan2(x, −z) from 0 to 2π: the first column is what lies behind the object.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from malus.scenes.errors import InputError
from malus.scenes.lights import Environment

Map = NDArray[np.float32]

HEIGHT = 128
LARGEST_PIXELS = 1 << 26
"""Bounds the memory that a hostile file can ask for: 64 megapixels."""


@functools.lru_cache(maxsize=4)
def radiance_map(light: Environment) -> Map:
    """The map's radiance, shape (height, width), one value for every band.

    Raises
    ------
    InputError
        Unknown name, or a file that is not a readable map of non-negative finite radiance.

    Examples
    --------
    >>> radiance_map(Environment()).shape
    (128, 256)
    """
    if light.name == "studio":
        return _studio()
    path = Path(light.name)
    if path.suffix.lower() != ".exr":
        raise InputError(
            "environment", "studio, or the path of an .exr file", light.name, "correct the name"
        )
    return _checked(_read(path), path)


def directions(height: int, width: int, turn_deg: float = 0.0) -> NDArray[np.float64]:
    """Unit vectors towards the pixels' centres of a map, shape (height, width, 3).

    `turn_deg` is the light's: the map turned about z, anticlockwise as an unrolled camera sees it.

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
    return toward @ _about_z(turn_deg).T if turn_deg else toward


def solid_angles(height: int, width: int) -> NDArray[np.float64]:
    """Solid angle of each row's pixels, steradians, shape (height, 1).

    Examples
    --------
    >>> round(float(solid_angles(64, 128).sum() * 128 / math.pi), 9)
    4.0
    """
    edges = np.cos(np.linspace(0.0, math.pi, height + 1))
    return (edges[:-1] - edges[1:])[:, None] * (2 * math.pi / width)


def _about_z(turn_deg: float) -> NDArray[np.float64]:
    cosine, sine = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _studio() -> Map:
    """Two soft lamps, a bright ceiling and a dim floor: smooth, so that its pixels do not show."""
    d = directions(HEIGHT, 2 * HEIGHT)
    key = np.array([0.55, 0.45, 0.70])
    rim = np.array([-0.85, 0.20, -0.10])
    light = 0.15 + 0.35 * np.clip(d[..., 1], 0, None) ** 2
    for axis, strength, sharpness in ((key, 9.0, 40.0), (rim, 6.0, 25.0)):
        cosine = d @ (axis / np.linalg.norm(axis))
        light = light + strength * np.exp(sharpness * (cosine - 1.0))
    return light.astype(np.float32)


def _read(path: Path) -> NDArray[np.float32]:
    import OpenEXR

    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            window = file.header()["dataWindow"]
            size = np.asarray(window[1], np.int64) - np.asarray(window[0], np.int64) + 1
        if np.prod(size) > LARGEST_PIXELS:
            raise InputError(
                str(path), "at most 64 megapixels", f"{size[0]} x {size[1]}", "make it smaller"
            )
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.asarray(c.pixels) for name, c in file.channels().items()}
    except InputError:
        raise
    except Exception as error:  # a foreign parser raises anything on a broken file
        raise InputError(
            str(path), "a readable EXR file", str(error) or "another file", "check the path"
        ) from None
    colours = [channels[name] for name in ("R", "G", "B") if name in channels]
    colours = colours or [channels[name] for name in ("Y",) if name in channels]
    if not colours:
        raise InputError(
            str(path), "channels R, G, B or Y", ", ".join(channels), "export it as RGB"
        )
    return np.mean(colours, axis=0).astype(np.float32)


def _checked(values: Map, path: Path) -> Map:
    if values.size < 2 or not np.isfinite(values).all() or values.min() < 0 or values.max() <= 0:
        raise InputError(
            str(path),
            "finite radiance, not negative and not all zero",
            f"values from {values.min(initial=0)} to {values.max(initial=0)}",
            "repair the map",
        )
    return values
