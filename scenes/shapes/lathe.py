"""Meshes of turned objects: a profile drawn at random, turned about the vertical.

The profile is a uniform cubic B-spline (de Boor, "A Practical Guide to Splines", 1978) from the
axis at the foot to the axis at the top or, of a vessel, over its rim and down inside to the axis.
Its control points are mirrored at the axis, so that the surface is smooth there too.
"""

from __future__ import annotations

import math
import random

import numpy as np

from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError
from malus.scenes.shapes.geometry import Faces, TriangleMesh, fitted

SIDES, STEPS = 192, 192
"""Points around the axis and along the profile: 72,960 triangles."""


def lathe(seed: int = 0, sides: int = SIDES, steps: int = STEPS) -> TriangleMesh:
    """Turned object of a random profile, centred and scaled to the unit sphere; +y is up.

    Bottles, vases, pots and pears in one half of the seeds, open bowls, cups and glasses in the
    other. Equal seeds give equal objects on every machine.

    Raises
    ------
    InputError
        For a negative seed.

    Examples
    --------
    >>> len(lathe(seed=3).faces)
    72960
    """
    if seed < 0:
        raise InputError("lathe", "seed >= 0", f"{seed}", "choose another seed")
    points, tangents = profile(_control_points(seed), steps)
    angles = np.arange(sides) * (2 * math.pi / sides)
    turned = np.stack([np.sin(angles), np.zeros(sides), np.cos(angles)], axis=1)
    # Outward is to the right of the way along the profile, from the foot outward and up.
    slopes = np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)
    rings, normals = _around(points, turned), _around(slopes, turned)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    faces = _faces(steps - 2, sides)
    return TriangleMesh(fitted(rings).astype(np.float32), faces, normals.astype(np.float32))


def profile(control: Float64Array, steps: int) -> tuple[Float64Array, Float64Array]:
    """Points (steps, 2) of the curve through radius and height, and its tangents of any length.

    `control` (n, 2) are its control points, of which the first and the last lie on the axis.

    Examples
    --------
    >>> points, _ = profile(np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 1.0]]), 5)
    >>> points[[0, -1], 0].tolist()
    [0.0, 0.0]
    """
    mirror = np.array([-1.0, 1.0])
    control = np.concatenate([control[1:2] * mirror, control, control[-2:-1] * mirror])
    place = np.linspace(0.0, len(control) - 3, steps)
    span = np.minimum(place.astype(np.int64), len(control) - 4)
    t = (place - span)[:, None]
    a, b, c, d = (control[span + k] for k in range(4))
    points = ((1 - t) ** 3 * a + (3 * t**3 - 6 * t**2 + 4) * b) / 6 + (
        (-3 * t**3 + 3 * t**2 + 3 * t + 1) * c + t**3 * d
    ) / 6
    tangents = (
        -((1 - t) ** 2) * a + (3 * t**2 - 4 * t) * b + (-3 * t**2 + 2 * t + 1) * c + t**2 * d
    ) / 2
    points[[0, -1], 0] = 0.0  # but for rounding
    return points, tangents


def _control_points(seed: int) -> Float64Array:
    """Control points (n, 2) of a profile: radius and height, from the foot to its end."""
    # The standard library promises the same random() for a seed in every version.
    draw = random.Random(seed).random
    open_above, height = draw() < 0.5, 0.5 * 4.0 ** draw()
    count = 4 + int(3 * draw())
    foot = 0.35 + 0.45 * draw()
    # A walk of the radius, with no step that is larger than the object's own width.
    radii, slope = [foot], 0.6 * draw()
    for _ in range(count - 1):
        slope = 0.5 * slope + 0.5 * (2.0 * draw() - 1.0)
        radii.append(min(max(radii[-1] + 0.5 * slope, 0.18), 1.1))
    heights = [height * k / (count - 1) for k in range(count)]
    if open_above:
        # Bowls grow wider upwards.
        radii = [radius + 0.35 * k / (count - 1) for k, radius in enumerate(radii)]
    outside = [(0.0, 0.0), (0.8 * foot, 0.0), (foot, 0.0), *zip(radii, heights, strict=True)]
    if not open_above:
        return np.array([*outside, (0.6 * radii[-1], height), (0.0, height)])
    wall = 0.05 + 0.06 * draw()
    inside = [(radius - wall, max(y, wall)) for radius, y in zip(radii, heights, strict=True)]
    rim = (radii[-1] - 0.5 * wall, height + 0.5 * wall)
    return np.array([*outside, rim, *inside[::-1], (0.6 * foot, wall), (0.0, wall)])


def _around(pairs: Float64Array, turned: Float64Array) -> Float64Array:
    """Pairs of radius and height (n, 2) turned about the vertical, the first and last of them once.

    `turned` (sides, 3) are level unit vectors; the result has the shape ((n - 2) · sides + 2, 3).
    """
    upright = np.array([0.0, 1.0, 0.0])
    rings = pairs[1:-1, None, :1] * turned + pairs[1:-1, None, 1:] * upright
    foot, top = pairs[[0, -1], 1:] * upright
    return np.concatenate([[foot], rings.reshape(-1, 3), [top]])


def _faces(rings: int, sides: int) -> Faces:
    """Triangles between the rings, and two fans from the points on the axis."""
    side = np.arange(sides)
    after = (side + 1) % sides
    last = 1 + rings * sides
    foot = np.stack([np.zeros_like(side), 1 + after, 1 + side], axis=1)
    top = last - sides + np.stack([side, after, np.full_like(side, sides)], axis=1)
    ring = 1 + sides * np.arange(rings - 1)[:, None]
    a, b, c, d = ((ring + k).ravel() for k in (side, after, after + sides, side + sides))
    between = [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    return np.concatenate([foot, *between, top]).astype(np.uint32)
