"""Reference for ρ: Equations 4 to 8 by brute force over rings of facets, slow and independent.

malus integrates in slopes (r, φ) around the mean normal N, by two ladders of rules, with Fresnel
in a form of its own. This integrates over directions (γ, β) around the viewer V, so that no node,
split point or Jacobian is the same and Fresnel depends on the outer variable alone; every interval
between known breakpoints is cut geometrically towards both of its ends and each piece gets a
Gauss rule, which converges for whatever algebraic, logarithmic or layer-like end it has. Nothing
is shared with `malus.reconstruct`.

With m = M·N = cos α and dω the solid angle of M, slopes obey r dr dφ = dω/m³, so
eq8: dr dφ = dω/(m² sin α); visible: (cos γ/m) dω/m³; both times exp(−σ tan²α), for GGX facets
(1 + σ tan²α)⁻².
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from malus.scenes.core.arrays import Float64Array

RATIO = 4.0
"""Ratio of the widths of neighbouring pieces: Gauss of n nodes then errs by 3^(−2n) at worst."""

ORDERS = (8, 11, 15, 20, 27)
TOLERANCE = 1e-9
G1_END = 1.6  # Mitsuba's microfacet.h: Smith's G1 is 1 from there on
_CHUNK = 1 << 15  # numbers in one temporary array


class Reference(NamedTuple):
    """ρ, and its change by the last refinement: the error of the value before."""

    value: float
    error: float


class _Rings(NamedTuple):
    """Rings of constant γ: cos γ, sin γ, γ − θ and the weight, all without cancellation."""

    cosine: Float64Array
    sine: Float64Array
    offset: Float64Array
    weight: Float64Array


def _graded(order: int, depth: float) -> tuple[Float64Array, Float64Array]:
    """Offsets from the start of a unit interval to its middle, and weights."""
    x, w = np.polynomial.legendre.leggauss(order)
    count = math.ceil(math.log(1.0 / depth) / math.log(RATIO))
    edges = 0.5 * np.concatenate([[0.0], RATIO ** -np.arange(count, -1.0, -1.0)])
    half = np.diff(edges) / 2.0
    nodes = edges[:-1, None] + half[:, None] * (1.0 + x)
    return nodes.ravel(), (half[:, None] * w).ravel()


def _elevations(theta: float, eta: complex, sigma: float, measure: str) -> list[float]:
    """Breakpoints in π/2 − γ, descending, between which the integrand is smooth.

    Grazing, N, the horizon, the critical angle, the edges of shadow.
    """
    quarter = math.pi / 2.0
    above = quarter - theta
    breakpoints = [0.0, quarter, above, theta]
    n2 = (eta * eta).real
    if 0.0 < n2 < 1.0 and eta.imag == 0.0:
        breakpoints.append(math.asin(math.sqrt((1.0 - eta.real) * (1.0 + eta.real))))
    if measure.startswith("shadowed"):
        fit_ends = [] if measure == "shadowed_ggx" else [math.atan(math.sqrt(sigma) / G1_END)]
        for edge in (quarter, *fit_ends):
            breakpoints += [quarter - abs(edge - theta) / 2.0, quarter - (edge + theta) / 2.0]
    inside = sorted((e for e in breakpoints if 0.0 <= e <= quarter), reverse=True)
    # Rounding of π/2 makes equal breakpoints differ by 1e-16.
    return [e for i, e in enumerate(inside) if i == 0 or inside[i - 1] - e > 4e-16]


def _rings(theta: float, eta: complex, sigma: float, measure: str, order: int) -> _Rings:
    """Nodes between breakpoints, measured from the nearer one so that thin layers are resolved."""
    offsets, weights = _graded(order, 1e-16)
    parts = []
    above = math.pi / 2.0 - theta
    for high, low in pairwise(_elevations(theta, eta, sigma, measure)):
        width = high - low
        for anchor, sign in ((high, -1.0), (low, 1.0)):
            step = sign * width * offsets
            elevation = anchor + step
            parts.append(
                (np.sin(elevation), np.cos(elevation), (above - anchor) - step, width * weights)
            )
    return _Rings(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def reflectances(cosine: Float64Array, eta: complex) -> tuple[Float64Array, Float64Array]:
    """(F_⊥, F_∥) over |η² − 1|², which cancels from ρ, from differences of admittances.

    c − q = −δ/(c + q) and η² c − q = δ ((η² + 1) c² − 1)/(η² c + q), with δ = η² − 1, q² = c² + δ.
    """
    index = complex(eta)
    square, delta = index * index, (index - 1.0) * (index + 1.0)
    q = np.sqrt(cosine * cosine + delta)
    if index.imag == 0.0 and index.real < 1.0:
        q = np.where(cosine * cosine + delta.real < 0.0, 1j * np.abs(q), q)
    perpendicular = np.abs(cosine + q) ** -4.0
    numerator = np.abs((square + 1.0) * cosine * cosine - 1.0) ** 2
    return perpendicular, numerator * np.abs(square * cosine + q) ** -4.0


def _shadowing(cos_light: Float64Array, sigma: float) -> Float64Array:
    """Smith's G1 for Beckmann slopes, the rational fit of Mitsuba's microfacet.h."""
    light = np.clip(cos_light, 1e-300, 1.0)
    tangent = np.sqrt((1.0 - light) * (1.0 + light)) / light
    a = np.sqrt(sigma) / np.maximum(tangent, 1e-300)
    short = np.minimum(a, G1_END)
    fit = (3.535 * short + 2.181 * short**2) / (1.0 + 2.276 * short + 2.577 * short**2)
    return np.asarray(np.where(cos_light <= 0.0, 0.0, np.where(a >= G1_END, 1.0, fit)))


def _shadowing_ggx(cos_light: Float64Array, sigma: float) -> Float64Array:
    """Smith's G1 for GGX: 2 / (1 + √(1 + tan²θ/σ))."""
    light = np.clip(cos_light, 1e-300, 1.0)
    tangent = np.sqrt((1.0 - light) * (1.0 + light)) / light
    g1 = 2.0 / (1.0 + np.hypot(1.0, np.minimum(tangent / np.sqrt(sigma), 1e150)))
    return np.asarray(np.where(cos_light <= 0.0, 0.0, g1))


def _azimuths(rings: _Rings, theta: float, sigma: float, measure: str) -> Float64Array:
    """Ascending breakpoints of β on every ring, (rings, k): horizon or edges of shadow."""
    ct, st = math.cos(theta), math.sin(theta)
    c, s = rings.cosine, rings.sine
    levels = [np.zeros_like(c)]  # of m: the facets' own horizon
    if measure == "shadowed":
        far = 1.0 / math.sqrt(1.0 + sigma / G1_END**2)
        levels = [ct / (2.0 * c), (ct + far) / (2.0 * c)]  # L·N = 2 c m − cos θ
    elif measure == "shadowed_ggx":
        levels = [ct / (2.0 * c)]
    lever = np.maximum(st * s, 1e-300)
    inside = [np.arccos(np.clip((level - ct * c) / lever, -1.0, 1.0)) for level in levels]
    edges = [np.zeros_like(c), *inside, np.full_like(c, np.pi)]
    return np.sort(np.stack(edges, axis=-1), axis=-1)


def _around(
    rings: _Rings, theta: float, sigma: float, measure: str, order: int
) -> tuple[Float64Array, Float64Array]:
    """∫ w cos 2β dβ and ∫ w dβ over every ring."""
    ct, st = math.cos(theta), math.sin(theta)
    t, w = _graded(order, 1e-17)
    edges = _azimuths(rings, theta, sigma, measure)
    low, width = edges[:, :-1, None], np.diff(edges, axis=-1)[:, :, None]
    beta = np.concatenate([low + width * t, low + width * (1.0 - t)], axis=-1)
    weight = np.concatenate([width * w, width * w], axis=-1)
    c, s, offset = (x[:, None, None] for x in (rings.cosine, rings.sine, rings.offset))
    # haversine: sin²(α/2) keeps its digits where M is close to N
    turned = np.sin(beta / 2.0) ** 2
    hav = np.sin(offset / 2.0) ** 2 + st * s * turned
    m = np.maximum(1.0 - 2.0 * hav, 1e-12)
    sine2 = 4.0 * hav * (1.0 - hav)
    steep = sigma * sine2 / m**2
    slopes = (1.0 + steep) ** -2.0 if measure == "shadowed_ggx" else np.exp(-np.minimum(steep, 700))
    density = np.where(m > 1e-12, weight * slopes, 0.0)
    if measure == "eq8":
        density = density / (m**2 * np.sqrt(np.maximum(sine2, 1e-300)))
    else:
        density = density * c / m**4
    if measure == "shadowed":
        density = density * _shadowing(2.0 * c * m - ct, sigma)
    elif measure == "shadowed_ggx":
        density = density * _shadowing_ggx(2.0 * c * m - ct, sigma)
    cos2 = 2.0 * np.square(1.0 - 2.0 * turned) - 1.0
    return np.sum(density * cos2, axis=(1, 2)), np.sum(density, axis=(1, 2))


def _dolp(theta: float, eta: complex, sigma: float, measure: str, order: int) -> float:
    """ρ with Gauss rules of one order."""
    rings = _rings(theta, eta, sigma, measure, order)
    relevant = (rings.cosine > 0.0) & (rings.sine > 0.0)
    if measure != "shadowed_ggx":
        # A ring whose facets all have exp(−σ tan²α) below e^−150 adds nothing: F varies by < e^130.
        relevant &= sigma * np.tan(np.clip(rings.offset, -1.5, 1.5)) ** 2 <= 150.0
    rings = _Rings(*(field[relevant] for field in rings))
    step = max(1, _CHUNK // (6 * _graded(order, 1e-17)[0].size))
    with_cosine, without_cosine = [], []
    for start in range(0, rings.cosine.size, step):
        some_rings = _Rings(*(field[start : start + step] for field in rings))
        cosine_integral, integral = _around(some_rings, theta, sigma, measure, order)
        with_cosine.append(cosine_integral)
        without_cosine.append(integral)
    perpendicular, parallel = reflectances(rings.cosine, eta)
    weight = rings.weight * rings.sine
    polarised = np.sum(weight * (perpendicular - parallel) * np.concatenate(with_cosine))
    total = np.sum(weight * (perpendicular + parallel) * np.concatenate(without_cosine))
    return float(polarised / total)


def reference_dolp(zenith: float, eta: complex, sigma: float, measure: str = "eq8") -> Reference:
    """ρ = (I_⊥ − I_∥)/(I_⊥ + I_∥) of Equations 4 to 8, refined until two orders agree.

    Arguments as those of `malus.reconstruct.specular_dolp`, scalars. At eta = 1, where nothing is
    reflected, the next larger number of double precision stands for the limit.

    Examples
    --------
    >>> reference = reference_dolp(np.radians(50), 1.5, 10.0)
    >>> round(reference.value, 8), reference.error <= 1e-9
    (0.80949744, True)
    """
    index = 1.0 + np.finfo(float).eps if eta == 1.0 else eta
    before = _dolp(zenith, index, sigma, measure, ORDERS[0])
    for order in ORDERS[1:]:
        value = _dolp(zenith, index, sigma, measure, order)
        error = abs(value - before)
        if error <= TOLERANCE:
            break
        before = value
    return Reference(value, error)
