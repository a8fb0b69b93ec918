"""Normals in stereographic coordinates: the viewer's direction is the origin, the rim a circle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def to_rim(f: Floats, g: Floats) -> tuple[Floats, Floats]:
    """Points beyond the unit circle, whose normals face away, moved onto it."""
    beyond = np.maximum(np.hypot(f, g), 1.0)
    return f / beyond, g / beyond


def normals_of(f: Floats, g: Floats) -> Floats:
    """Unit normals (n, 3) from stereographic coordinates (n,): the rim is the unit circle.

    Examples
    --------
    >>> normals_of(np.array([0.0, 1.0]), np.zeros(2)).tolist()
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    square = f * f + g * g
    over = 1.0 / (1.0 + square)
    return np.stack([2 * f * over, 2 * g * over, (1 - square) * over], axis=-1)


def plane_slopes(f: Floats, g: Floats) -> list[list[Floats]]:
    """Derivatives of n_x and n_y (rows) by f and g (columns)."""
    over = 1.0 / (1.0 + f * f + g * g)
    cross = -4 * f * g * over**2
    return [[2 * over - 4 * f * f * over**2, cross], [cross, 2 * over - 4 * g * g * over**2]]
