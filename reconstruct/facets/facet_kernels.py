"""The microfacet integrand, compiled by numba: most of an integral's time is spent here.

Importing this module imports numba, which takes long: import it in the function that integrates.
"""

from __future__ import annotations

import math
from typing import Any

from malus.reconstruct.facets.breakpoints import G1_END
from malus.reconstruct.kernels import compiled


@compiled
def dielectric(cosine: float, sine2: float, delta: float) -> tuple[float, float]:
    """(F_⊥ + F_∥)/δ² and (F_⊥ − F_∥)/(δ² sin²γ) of a dielectric facet, free of cancellation.

    `cosine` and `sine2` are cos γ and sin²γ: 1 − cos²γ loses its digits near γ = 0. `delta` is
    δ = η² − 1; it and the cosine are not both zero. See `malus.reconstruct.fresnel`.
    """
    square = cosine * cosine + delta
    if square < 0.0:
        return 2.0 / (delta * delta), 0.0  # total reflection: F = 1
    q = math.sqrt(square)
    product = cosine * q
    root = (cosine + q) * (cosine + q) * (product + sine2)
    scale = 1.0 / max(root, 1e-150)
    scale *= scale
    return 2.0 * scale * (product * product + sine2 * sine2), 4.0 * scale * product


@compiled
def metal(cosine: float, sine2: float, real: float, imaginary: float) -> tuple[float, float]:
    """(F_⊥ + F_∥)/|δ|² and (F_⊥ − F_∥)/(|δ|² sin²γ) of a metal facet; δ = real + i imaginary."""
    square = cosine * cosine + real
    modulus = math.hypot(square, imaginary)
    # Square root of a complex number, from the larger of its parts.
    larger = math.sqrt(0.5 * (modulus + abs(square)))
    smaller = 0.5 * imaginary / larger
    q, k = (larger, smaller) if square >= 0.0 else (smaller, larger)
    product, absorbed = cosine * q, cosine * k
    across = product + sine2
    moduli = ((cosine + q) * (cosine + q) + k * k) ** 2 * (across * across + absorbed * absorbed)
    scale = 1.0 / moduli
    total = product * product + absorbed * absorbed + sine2 * sine2
    return 2.0 * scale * total, 4.0 * scale * product


@compiled
def shadowing(cosine: float, root_sigma: float) -> float:
    """Smith-Beckmann G1 of a direction, Mitsuba's rational fit; 0 below the horizon.

    `cosine` is that of the angle to N, `root_sigma` is √σ = 1/alpha.
    """
    if cosine <= 0.0:
        return 0.0
    tangent = math.sqrt(max((1.0 - cosine) * (1.0 + cosine), 0.0))
    a = root_sigma * cosine / max(tangent, 1e-150)
    if a >= G1_END:
        return 1.0
    return a * (3.535 + 2.181 * a) / (1.0 + a * (2.276 + 2.577 * a))


@compiled
def shadowing_ggx(cosine: float, root_sigma: float) -> float:
    """Smith's G1 of a direction among GGX facets; 0 below the horizon.

    `cosine` is that of the angle to N, `root_sigma` is √σ = 1/alpha. Source: Walter et al.,
    "Microfacet models for refraction through rough surfaces", EGSR 2007, Equation 34.
    """
    if cosine <= 0.0:
        return 0.0
    sine2 = max((1.0 - cosine) * (1.0 + cosine), 0.0)
    stretched = cosine * root_sigma
    return 2.0 * stretched / (stretched + math.sqrt(stretched * stretched + sine2))


@compiled
def sum_over_azimuths(
    cosines: Any, weights: Any, ring: Any, r: Any, surfaces: Any, measure: int, sums: Any
) -> None:
    """Add Σ w (F_⊥ − F_∥) cos 2β and Σ w (F_⊥ + F_∥) over azimuths to `sums` (intervals, 2).

    Factors that depend on r alone are left out. cosines (intervals, nodes): cos φ; weights
    (nodes,); ring (intervals,): index of each interval's slope and surface in `r` and in the fields
    of `surfaces`; measure: 0 for eq8, 1 for visible, 2 for shadowed, 3 for shadowed_ggx.
    """
    for j in range(ring.size):
        i = ring[j]
        slope, cosine, sine = r[i], surfaces.cosine[i], surfaces.sine[i]
        delta, root_sigma = surfaces.delta[i], math.sqrt(surfaces.sigma[i])
        inverse = 1.0 / (1.0 + slope * slope)
        root = math.sqrt(inverse)
        for k in range(weights.size):
            along = slope * cosines[j, k]
            # M = [r sin φ, sin θ − r cos θ cos φ, cos θ + r sin θ cos φ] / √(1 + r²)
            y2 = (sine - along * cosine) ** 2
            x2 = (slope - along) * (slope + along)
            facing = max(cosine + along * sine, 0.0)
            gamma, sine2 = min(facing * root, 1.0), (x2 + y2) * inverse
            if delta.imag == 0.0:
                total, contrast = dielectric(gamma, sine2, delta.real)
            else:
                total, contrast = metal(gamma, sine2, delta.real, delta.imag)
            weight = weights[k]
            if measure > 0:
                weight *= facing  # projected area (cos θ + r sin θ cos φ)₊
            if measure == 2:
                weight *= shadowing(2.0 * facing * inverse - cosine, root_sigma)
            elif measure == 3:
                weight *= shadowing_ggx(2.0 * facing * inverse - cosine, root_sigma)
            sums[j, 0] += weight * contrast * (y2 - x2) * inverse
            sums[j, 1] += weight * total
