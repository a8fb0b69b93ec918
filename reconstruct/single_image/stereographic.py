"""Normals in stereographic coordinates: the viewer is at the origin, the rim is the unit circle."""

from __future__ import annotations

import numpy as np

from malus.scenes.core.arrays import Float64Array


def to_rim(f: Float64Array, g: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Move points beyond the unit circle, whose normals face away, onto it."""
    radius = np.maximum(np.hypot(f, g), 1.0)
    return f / radius, g / radius


def normals_of(f: Float64Array, g: Float64Array) -> Float64Array:
    """Unit normals (n, 3) from stereographic coordinates (n,): the rim is the unit circle.

    Examples
    --------
    >>> normals_of(np.array([0.0, 1.0]), np.zeros(2)).tolist()
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    square = f * f + g * g
    scale = 1.0 / (1.0 + square)
    return np.stack([2 * f * scale, 2 * g * scale, np.maximum(1 - square, 0) * scale], axis=-1)


def plane_slopes(f: Float64Array, g: Float64Array) -> list[list[Float64Array]]:
    """Derivatives (n,) of n_x and n_y (rows) by f and g (columns)."""
    scale = 1.0 / (1.0 + f * f + g * g)
    cross = -4 * f * g * scale**2
    return [[2 * scale - 4 * f * f * scale**2, cross], [cross, 2 * scale - 4 * g * g * scale**2]]
