"""Angles of lights in degrees, and the vectors and rotations that they stand for."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from malus.scenes.core.arrays import Float64Array


def about_axis(axis: int, turn_deg: float) -> Float64Array:
    """Rotation matrix (3, 3) about x, y or z: 0, 1 or 2."""
    cosine, sine = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    result = np.eye(3)
    result[first, first] = result[second, second] = cosine
    result[first, second], result[second, first] = -sine, sine
    return result


def turns(rotation: Float64Array) -> dict[str, float]:
    """The keys of `AllAround` whose rotation it is."""
    toward_x, up, toward_z = (float(value) for value in rotation[2])
    level = math.hypot(toward_x, toward_z)
    tilt = math.atan2(up, level)
    if level < 1e-12:  # straight up: turn and heading are about the same axis
        heading, turn = 0.0, math.atan2(rotation[1, 0], rotation[0, 0])
    else:
        heading, turn = math.atan2(-toward_x, toward_z), math.atan2(-rotation[0, 1], rotation[1, 1])
    angles = {"turn_deg": turn, "tilt_deg": tilt, "heading_deg": heading}
    return {key: math.degrees(angle) for key, angle in angles.items()}


def incidence_and_azimuth(direction: Iterable[float]) -> dict[str, float]:
    """Incidence and azimuth of a vector (x, y, z); straight behind is a billionth beside it."""
    x, y, z = map(float, direction)
    incidence = math.degrees(math.atan2(math.hypot(x, y), z))
    azimuth = math.degrees(math.atan2(y, x))
    return {"incidence_deg": min(incidence, 180.0 - 1e-9), "azimuth_deg": azimuth}


def direction_at(incidence_deg: float, azimuth_deg: float) -> tuple[float, float, float]:
    """Unit vector of an incidence and an azimuth.

    Examples
    --------
    >>> direction_at(0.0, 30.0)[2]
    1.0
    """
    incidence, azimuth = math.radians(incidence_deg), math.radians(azimuth_deg)
    sine = math.sin(incidence)
    return sine * math.cos(azimuth), sine * math.sin(azimuth), math.cos(incidence)
