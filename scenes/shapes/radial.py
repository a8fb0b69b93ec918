"""Star-shaped surfaces p = r(d) d over unit directions d, with exact normals."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
RadialSurface = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Directions (n, 3) to radius (n,) and its gradient ∂r/∂d (n, 3)."""

_BUMPS = 7
_BUMP_SHARPNESS = 6.0
"""k of a bump exp(k (d·c − 1)): it falls to 1/e about 34° from its centre."""


def blob_radius(
    directions: FloatArray, seed: int = 0, amplitude: float = 0.5
) -> tuple[FloatArray, FloatArray]:
    """Radius r(d) = 1 + Σ a exp(k (d·c − 1)) of a blob, and its gradient ∂r/∂d.

    `directions` (n, 3) are unit vectors; the results have the shapes (n,) and (n, 3). As no bump
    is negative, r >= 1: the surface cannot meet itself whatever the seed.

    Examples
    --------
    >>> blob_radius(np.array([[0.0, 0.0, 1.0]]), amplitude=0.0)[0].tolist()
    [1.0]
    """
    centres, heights = _bumps(seed, amplitude)
    values = heights * np.exp(_BUMP_SHARPNESS * (directions @ centres.T - 1.0))
    return 1.0 + values.sum(axis=1), _BUMP_SHARPNESS * values @ centres


def _bumps(seed: int, amplitude: float) -> tuple[FloatArray, FloatArray]:
    # The standard library promises the same random() for a seed in every version; NumPy does not
    # for its distributions, and the shape belongs to the identity of a scene.
    draw = random.Random(seed).random
    centres = np.array([_direction(draw(), draw()) for _ in range(_BUMPS)])
    heights = amplitude * np.array([0.5 + 0.5 * draw() for _ in range(_BUMPS)])
    return centres, heights


def _direction(u: float, v: float) -> tuple[float, float, float]:
    # Uniform on the sphere (Archimedes): z uniform, azimuth uniform.
    z, azimuth = 2.0 * u - 1.0, 2.0 * math.pi * v
    ring = math.sqrt(max(0.0, 1.0 - z * z))
    return ring * math.cos(azimuth), ring * math.sin(azimuth), z


def superquadric_radius(
    directions: FloatArray, e1: float, e2: float
) -> tuple[FloatArray, FloatArray]:
    """Radius r(d) = F(d)^(−e1/2) of a superquadric, and its gradient ∂r/∂d.

    F = (|x|^(2/e2) + |y|^(2/e2))^(e2/e1) + |z|^(2/e1). Shapes as for `blob_radius`.

    Examples
    --------
    >>> superquadric_radius(np.array([[0.0, 0.6, 0.8]]), 1.0, 1.0)[0].round(12).tolist()
    [1.0]
    """
    size, sign = np.abs(directions), np.sign(directions)
    equator = (size[:, :2] ** (2 / e2)).sum(axis=1)
    polar = size[:, 2] ** (2 / e1)
    inside_outside = equator ** (e2 / e1) + polar
    # At the poles equator = 0 and the factor may diverge, but its product with x or y tends to 0.
    safe = np.where(equator > 0, equator, 1.0)
    growth = np.empty_like(directions)
    growth[:, :2] = size[:, :2] ** (2 / e2 - 1) * (safe ** (e2 / e1 - 1))[:, None]
    growth[:, 2] = size[:, 2] ** (2 / e1 - 1)
    gradient = (2 / e1) * growth * sign
    radius = inside_outside ** (-e1 / 2)
    return radius, (-e1 / 2 * radius / inside_outside)[:, None] * gradient


def radial_normals(directions: FloatArray, radius: FloatArray, gradient: FloatArray) -> FloatArray:
    """Outward unit normals of r(d) d: along r d minus the tangential part of ∂r/∂d.

    `directions` (n, 3) unit vectors, `radius` (n,), `gradient` (n, 3).

    Examples
    --------
    >>> up = np.array([[0.0, 0.0, 1.0]])
    >>> radial_normals(up, np.ones(1), np.zeros((1, 3))).tolist()
    [[0.0, 0.0, 1.0]]
    """
    along = np.einsum("ij,ij->i", gradient, directions)[:, None] * directions
    normals = radius[:, None] * directions - (gradient - along)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))
