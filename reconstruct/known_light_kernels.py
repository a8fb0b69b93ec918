"""Specular light of given lights: the loops over pixels and directions, compiled by numba.

Importing this module imports numba, which takes long.
"""

from __future__ import annotations

import math
from typing import Any

from malus.reconstruct.facets.facet_kernels import dielectric, metal, shadowing, shadowing_ggx
from malus.reconstruct.kernels import compiled

_LOWEST = -40.0  # exp(−40) = 4e-18 is below every rounding, and leaving it out saves time


@compiled
def facet_weight(n_h: float, n_l: float, inverse_alpha: float, ggx: bool) -> float:
    """Density of facets at N·H, Beckmann's or GGX, times Smith's shadowing of the light at N·L."""
    if n_l <= 0.0 or n_h <= 0.0:
        return 0.0
    squared = n_h * n_h
    if ggx:
        spread = squared + (1.0 - squared) * inverse_alpha * inverse_alpha
        return shadowing_ggx(n_l, inverse_alpha) / (spread * spread)
    if n_h <= 1e-3:
        return 0.0
    exponent = (1.0 - 1.0 / squared) * inverse_alpha * inverse_alpha
    if exponent < _LOWEST:
        return 0.0
    return math.exp(exponent) / (squared * squared) * shadowing(n_l, inverse_alpha)


@compiled
def weigh_facets(
    normals: Any, half: Any, toward: Any, alpha: float, ggx: bool, weights: Any
) -> None:
    """Write the weight of the facets that mirror each direction at each pixel.

    normals (pixels, 3); half, toward (K, 3): half vectors and directions of the light; ggx: whether
    facets are GGX, not Beckmann's; weights (pixels, K) is written.
    """
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        for k in range(half.shape[0]):
            n_h = x * half[k, 0] + y * half[k, 1] + z * half[k, 2]
            n_l = x * toward[k, 0] + y * toward[k, 1] + z * toward[k, 2]
            weights[i, k] = facet_weight(n_h, n_l, 1.0 / alpha, ggx)


@compiled
def sum_stokes(
    normals: Any,
    basis: Any,
    alpha: Any,
    delta: Any,
    toward: Any,
    power: Any,
    ggx: bool,
    stokes: Any,
) -> None:
    """Add the specular light of K directions to Stokes vectors (pixels, bands, 3).

    normals (pixels, 3) in the frame of the pixel, where V = z; basis (pixels, 3, 3): from the
    image frame to that of the pixel; alpha (pixels,); delta (pixels, bands): η² − 1, complex;
    toward (K, 3); power (K,); ggx as for `weigh_facets`. `basis`, `alpha` and `delta` may have one
    entry for all pixels.
    """
    for i in range(normals.shape[0]):
        turn = basis[i if len(basis) > 1 else 0]
        inverse_alpha = 1.0 / alpha[i if len(alpha) > 1 else 0]
        materials = delta[i if len(delta) > 1 else 0]
        n_x, n_y, n_z = float(normals[i, 0]), float(normals[i, 1]), float(normals[i, 2])
        for k in range(power.size):
            w_x, w_y, w_z = toward[k, 0], toward[k, 1], toward[k, 2]
            x = turn[0, 0] * w_x + turn[0, 1] * w_y + turn[0, 2] * w_z
            y = turn[1, 0] * w_x + turn[1, 1] * w_y + turn[1, 2] * w_z
            z = turn[2, 0] * w_x + turn[2, 1] * w_y + turn[2, 2] * w_z
            n_l = n_x * x + n_y * y + n_z * z
            length = math.sqrt(max(2.0 + 2.0 * z, 1e-30))  # of L + V
            weight = power[k] * facet_weight((n_l + n_z) / length, n_l, inverse_alpha, ggx)
            if weight == 0.0:
                continue
            gamma, sine2 = min(0.5 * length, 1.0), max(0.5 - 0.5 * z, 0.0)
            across = max(x * x + y * y, 1e-300)
            cos2, sin2 = (x * x - y * y) / across, 2.0 * x * y / across
            for b in range(materials.size):
                d = materials[b]
                if d.imag == 0.0:
                    total, contrast = dielectric(gamma, sine2, d.real)
                else:
                    total, contrast = metal(gamma, sine2, d.real, d.imag)
                bright = weight * (d.real * d.real + d.imag * d.imag)  # both leave |δ|² out
                polarised = bright * contrast * sine2
                stokes[i, b, 0] += bright * total
                stokes[i, b, 1] -= polarised * cos2
                stokes[i, b, 2] -= polarised * sin2
