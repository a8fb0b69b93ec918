"""Radiance maps of rooms drawn at random, as seen from their middle.

A room is a box: walls, a floor and a ceiling of different levels, with rectangles on them, which
are doors, shelves and pictures, windows that are several to many times as bright as the walls, and
lamps that are small and 50 to 1000 times as bright as a bright wall; dark walls have a quarter of
its light. The map is scaled so that its mean over all directions is the light's `radiance`; a
uniform light of that radiance has the same power.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import numpy as np

from malus.scenes.core.arrays import BoolArray, Float64Array, IntArray
from malus.scenes.lights.lights import Interior

HEIGHT = 256
"""Rows of a room's map: the smallest lamps are about six pixels wide."""

LEAST_LAMP_RADIUS_DEG = 2.0

Draw = Callable[[], float]


def interior_radiance(light: Interior, toward: Float64Array, weights: Float64Array) -> Float64Array:
    """Radiance (height, width) of a room in the directions `toward` (height, width, 3).

    `weights` are the solid angles of the directions, in steradians, which broadcast to the map;
    their sum with the radiance is 4π times the light's `radiance`. Directions are in the room's own
    axes, before it is turned.
    """
    draw = random.Random(light.seed).random
    # Half the sizes of the room, and where in its height one stands.
    wide, deep, high = (_log(draw, *ends) for ends in ((1.5, 5.0), (1.5, 5.0), (1.2, 2.0)))
    below = _log(draw, 0.5, 1.0) * high
    distances = [wide, wide, 2 * high - below, below, deep, deep]
    axes = np.concatenate([np.eye(3), -np.eye(3)])[[0, 3, 1, 4, 2, 5]]
    with np.errstate(divide="ignore"):
        # How far away each side is met; infinitely far where one looks away from it.
        reach = np.stack(
            [
                np.where(toward @ axis > 0, distance / (toward @ axis), np.inf)
                for axis, distance in zip(axes, distances, strict=True)
            ]
        )
    side = reach.argmin(axis=0)
    point = toward * reach.min(axis=0)[..., None]
    level = _sides(draw, side, point)
    for index, (axis, distance) in enumerate(zip(axes, distances, strict=True)):
        if axis[1] == 0.0:
            _furnish(draw, level, side == index, point, 2 - int(abs(axis[2])) * 2, below, distance)
    _windows(draw, level, side, point, distances)
    _lamps(draw, level, toward)
    mean = float((level * weights).sum() / (np.broadcast_to(weights, level.shape).sum()))
    return np.asarray(level * (light.radiance / mean))


def _log(draw: Draw, low: float, high: float) -> float:
    return low * (high / low) ** draw()


def _sides(draw: Draw, side: IntArray, point: Float64Array) -> Float64Array:
    """Level of walls, ceiling and floor, which fades along them."""
    levels = np.array([_log(draw, 0.25, 1.0) for _ in range(6)])
    levels[2], levels[3] = _log(draw, 0.5, 1.6), _log(draw, 0.08, 0.5)
    slopes = np.array([[0.6 * draw() - 0.3 for _ in range(3)] for _ in range(6)])
    fading = np.einsum("...i,...i->...", np.tanh(0.4 * point), slopes[side])
    return np.asarray(levels[side] * (1.0 + fading))


def _furnish(
    draw: Draw,
    level: Float64Array,
    here: BoolArray,
    point: Float64Array,
    along: int,
    below: float,
    distance: float,
) -> None:
    """Put rectangles of other levels before a wall: doors, shelves and pictures."""
    for _ in range(int(6 * draw())):
        middle = distance * (2.0 * draw() - 1.0), below * (2.0 * draw() - 1.0)
        half = _log(draw, 0.1, 1.0), _log(draw, 0.1, 0.8)
        level[here & _inside(point, along, middle, half)] *= _log(draw, 0.1, 2.5)


def _windows(
    draw: Draw,
    level: Float64Array,
    side: IntArray,
    point: Float64Array,
    distances: list[float],
) -> None:
    """Cut windows of several panes into one or two walls; three rooms of five have some."""
    if draw() < 0.4:
        return
    for _ in range(1 + int(1.5 * draw())):
        index = (0, 1, 4, 5)[int(4 * draw())]
        along = 2 if index < 2 else 0
        brightness = _log(draw, 4.0, 60.0)
        half = _log(draw, 0.25, 0.9), _log(draw, 0.3, 0.9)
        middle = [0.8 * distances[index] * (2.0 * draw() - 1.0), 0.1 + 0.6 * draw()]
        for _ in range(1 + int(3 * draw())):
            pane = (side == index) & _inside(point, along, (middle[0], middle[1]), half)
            # The sky above is brighter than what stands outside.
            outside = 1.0 / (1.0 + np.exp(-4.0 * point[pane][:, 1]))
            level[pane] = brightness * (0.3 + 0.7 * outside)
            middle[0] += 2.2 * half[0]


def _lamps(draw: Draw, level: Float64Array, toward: Float64Array) -> None:
    """Hang one to four lamps overhead, or stand them about, each a disk of directions."""
    for _ in range(1 + int(4 * draw() ** 2)):
        elevation = math.asin(1.0 - draw() * 0.9)
        azimuth = 2.0 * math.pi * draw()
        radius = math.radians(_log(draw, LEAST_LAMP_RADIUS_DEG, 9.0))
        # Large lamps are dim: at equal power, within a factor, 50 to 1000 times a bright wall.
        brightness = _log(draw, 1.0, 6.0) * 150.0 * math.radians(3.0) ** 2 / radius**2
        level_axis = math.cos(elevation)
        axis = [level_axis * math.sin(azimuth), math.sin(elevation), level_axis * math.cos(azimuth)]
        level[toward @ np.array(axis) > math.cos(radius)] = min(max(brightness, 50.0), 1000.0)


def _inside(
    point: Float64Array, along: int, middle: tuple[float, float], half: tuple[float, float]
) -> BoolArray:
    """Whether points of a wall lie in an upright rectangle; `along` is the wall's level axis."""
    beside = np.abs(point[..., along] - middle[0]) < half[0]
    return np.asarray(beside & (np.abs(point[..., 1] - middle[1]) < half[1]))
