"""Slopes r and azimuths φ at which the microfacet integrands have ends, kinks and jumps.

Everything that is not smooth lies on curves of constant cos γ or constant cos of the angle
between mirrored direction L and mean normal N:

* cos γ = 0, the last facet that the viewer sees (eq8, visible);
* cos γ = √(1 − η²), the critical angle, where η < 1;
* L·N = 0, the last facet that mirrors something above the horizon (shadowed);
* L·N = 1/√(1 + σ/1.6²), where the rational fit of G1 ends with a jump of 6e-5 (shadowed).

In the slope plane they are conics symmetric about φ = 0. On a ring of constant r each crosses at
one φ, which is a breakpoint of the inner integral. The outer integral breaks at the r where a curve
touches a ring (only at φ = 0 or π) and where two curves cross. M halves the angle between V and L,
which stand at θ and ±λ from N in the plane φ = 0: the L·N = cos λ curve touches at
r = tan(|θ ± λ|/2).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from malus.scenes.core.arrays import AnyArray, Float64Array

Measure = Literal["eq8", "visible", "shadowed", "shadowed_ggx"]
"""Weight of a facet: Equation 8 as printed; by projected area; shadowed by its neighbours too; the
same for facets whose slopes are distributed as (1 + σr²)⁻², GGX, instead of exp(−σr²)."""

SHADOWED: tuple[Measure, ...] = ("shadowed", "shadowed_ggx")

G1_END = 1.6  # Mitsuba's microfacet.h: G1 = 1 where a = 1/(alpha tan θ_L) >= 1.6
_FAR = 1e300  # a slope that no integral reaches
# √σ r that separates the bulk of the weight from a horizon much closer to r = 0.
_BULK = 1.0
# √σ r at which the weight of GGX facets begins to fall like a power: no cut is far enough.
_TAIL = (1.0, 8.0)


class Surfaces(NamedTuple):
    """Points (θ, η, σ) to integrate at, as flat arrays (points,)."""

    zenith: Float64Array
    cosine: Float64Array
    sine: Float64Array
    delta: AnyArray  # η² − 1, complex for metals
    critical: Float64Array  # cos γ at the critical angle; 0 where reflection is never total
    sigma: Float64Array

    def take(self, index: NDArray[np.intp] | slice) -> Surfaces:
        """The same fields at `index`."""
        return Surfaces(*(field[index] for field in self))


def g1_end_cosine(sigma: Float64Array) -> Float64Array:
    """L·N above which the fitted G1 is 1: tan θ_L = √σ / 1.6."""
    return np.asarray(1.0 / np.sqrt(1.0 + sigma / G1_END**2))


def _touching(zenith: Float64Array, half_angle: Float64Array) -> list[Float64Array]:
    """Slopes at which the curve 'angle to V is `half_angle`' touches a ring around N."""
    far = zenith + half_angle
    beyond = far >= np.pi / 2
    return [
        np.abs(np.tan(zenith - half_angle)),
        np.where(beyond, _FAR, np.tan(np.where(beyond, 0.0, far))),
    ]


def _shadow_slopes(surfaces: Surfaces, measure: Measure) -> list[Float64Array]:
    """Slopes at which the curves L·N = const touch a ring or cross the critical curve."""
    theta = surfaces.zenith
    slopes, levels = [np.tan(np.pi / 4 - theta / 2)], [np.zeros_like(theta)]
    if measure == "shadowed_ggx":
        slopes += [bulk / np.sqrt(surfaces.sigma) for bulk in _TAIL]
    else:
        end = np.arctan(np.sqrt(surfaces.sigma) / G1_END)
        slopes += [np.abs(np.tan((theta - end) / 2)), np.tan((theta + end) / 2)]
        levels.append(g1_end_cosine(surfaces.sigma))
    for level in levels:
        # L·N = 2 cos γ cos α − cos θ with cos γ at the critical angle
        double = np.maximum(2.0 * surfaces.critical, 1e-150)
        cos_alpha = np.clip((level + surfaces.cosine) / double, 1e-150, 1.0)
        slopes.append(np.sqrt((1.0 - cos_alpha) * (1.0 + cos_alpha)) / cos_alpha)
    return slopes


def slope_breaks(surfaces: Surfaces, measure: Measure, reach: Float64Array) -> Float64Array:
    """Ascending breakpoints of r, shape (points, k); repeated ones bound empty intervals.

    `reach` is the largest √σ r that still matters.
    """
    last = reach / np.sqrt(surfaces.sigma)
    breaks = [np.zeros_like(last)]
    if measure in SHADOWED:
        breaks += _shadow_slopes(surfaces, measure)
        last = np.minimum(last, np.tan(np.pi / 4 + surfaces.zenith / 2))
    else:
        horizon = surfaces.cosine / surfaces.sine  # r = cot θ
        bulk = _BULK / np.sqrt(surfaces.sigma)
        breaks += [horizon, np.where(horizon < 0.2 * bulk, bulk, 0.0)]
    if np.any(surfaces.critical):
        touching = _touching(surfaces.zenith, np.arccos(surfaces.critical))
        breaks += [np.where(surfaces.critical > 0.0, slope, 0.0) for slope in touching]
    breaks.append(last)
    return np.sort(np.minimum(np.stack(breaks, axis=-1), last[:, None]), axis=-1)


def azimuth_breaks(r: Float64Array, surfaces: Surfaces, measure: Measure) -> Float64Array:
    """Ascending breakpoints of φ in [0, π] on rings of slope r, shape (rings, k).

    The last one ends the domain: φ = arccos(−cot θ / r) for facets that the viewer sees.
    """
    lever = np.maximum(r * surfaces.sine, 1e-300)
    per_cosine = np.hypot(1.0, r)  # 1 / cos α
    cosines = []
    if measure in SHADOWED:
        end = surfaces.cosine * (0.5 * per_cosine**2 - 1.0) / lever
    if measure == "shadowed":
        jump = 0.5 * (g1_end_cosine(surfaces.sigma) + surfaces.cosine) * per_cosine**2
        cosines.append((jump - surfaces.cosine) / lever)
    elif measure != "shadowed_ggx":
        end = -surfaces.cosine / lever
    if np.any(surfaces.critical):
        crossing = (surfaces.critical * per_cosine - surfaces.cosine) / lever
        cosines.append(np.where(surfaces.critical > 0.0, crossing, end))
    last = np.arccos(np.clip(end, -1.0, 1.0))
    inside = [np.minimum(np.arccos(np.clip(cosine, -1.0, 1.0)), last) for cosine in cosines]
    return np.sort(np.stack([np.zeros_like(r), *inside, last], axis=-1), axis=-1)
