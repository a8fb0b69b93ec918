"""ρ by brute force over rings of facets around the viewer.

malus integrates in slopes (r, φ) around the mean normal N. This one integrates over directions
(γ, β) around the viewer V, so no node, split point or Jacobian is the same: Fresnel depends on the
outer variable γ alone (and comes from mpmath), the weight on the inner variable. Every interval
between known breakpoints is cut geometrically towards both of its ends and each piece gets a
Gauss rule, which converges for whatever algebraic, logarithmic or layer-like end it has.

With m = M·N = cos α and dω the solid angle of M, slopes obey r dr dφ = dω/m³, so
eq8: dr dφ = dω/(m² sin α); visible: (cos γ/m) dω/m³; both times exp(−σ tan²α).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from mpmath import mp, mpf

from . import fresnel

RATIO = 4.0  # of neighbouring pieces


def _graded(order: int, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets from the start of a unit interval to its middle, and weights."""
    x, w = np.polynomial.legendre.leggauss(order)
    edges = (
        0.5 * np.r_[0.0, RATIO ** -np.arange(np.ceil(np.log(1 / depth) / np.log(RATIO)), -1, -1)]
    )
    half = np.diff(edges) / 2
    nodes = edges[:-1, None] + half[:, None] * (1 + x)
    return nodes.ravel(), (half[:, None] * w).ravel()


def _outer_anchors(theta: mpf, eta: complex, sigma: float, measure: str) -> list[mpf]:
    """Angles γ where the ring meets something: grazing, N, horizon, critical, shadow edges."""
    quarter = mp.pi / 2
    anchors = [mpf(0), quarter, theta, quarter - theta]
    n2 = complex(eta).real ** 2 - complex(eta).imag ** 2
    if 0 < n2 < 1:
        index = mpf(complex(eta).real)
        anchors.append(mp.asin(index))
    if measure == "shadowed":
        for edge in (quarter, mp.atan(mp.sqrt(mpf(sigma)) / mpf("1.6"))):
            anchors += [abs(edge - theta) / 2, (edge + theta) / 2]
    inside = sorted(a for a in anchors if 0 <= a <= quarter)
    return [a for i, a in enumerate(inside) if i == 0 or a - inside[i - 1] > mpf(10) ** -25]


def _outer_nodes(anchors: list[mpf], order: int) -> tuple[list[mpf], np.ndarray]:
    offsets, weights = _graded(order, 1e-16)
    nodes: list[mpf] = []
    out: list[np.ndarray] = []
    for low, high in pairwise(anchors):
        width = high - low
        nodes += [low + width * mpf(t) for t in offsets]
        nodes += [high - width * mpf(t) for t in offsets]
        out += [weights * float(width)] * 2
    return nodes, np.concatenate(out)


def _shadowing(cos_light: np.ndarray, sigma: float) -> np.ndarray:
    """Smith's G1 for Beckmann slopes, the rational fit of Mitsuba's microfacet.h."""
    light = np.clip(cos_light, 1e-300, 1.0)
    tangent = np.sqrt((1 - light) * (1 + light)) / light
    a = 1.0 / np.maximum(tangent / np.sqrt(sigma), 1e-300)
    a_fit = np.minimum(a, 1.6)
    fit = (3.535 * a_fit + 2.181 * a_fit**2) / (1 + 2.276 * a_fit + 2.577 * a_fit**2)
    return np.where(cos_light <= 0, 0.0, np.where(a >= 1.6, 1.0, fit))


def _inner_anchors(
    c: float, s: float, theta: tuple[float, float], sigma: float, measure: str
) -> np.ndarray:
    ct, st = theta
    levels = [0.0]  # of m: the facets' own horizon
    if measure == "shadowed":
        far = 1.0 / np.sqrt(1.0 + sigma / 2.56)
        levels = [ct / (2 * c), (ct + far) / (2 * c)]  # L·N = 2 c m − cos θ
    cosines = [(m - ct * c) / max(st * s, 1e-300) for m in levels]
    return np.unique([0.0, *np.arccos(np.clip(cosines, -1, 1)), np.pi])


def _ring(
    c: float, s: float, offset: float, theta: float, sigma: float, measure: str, order: int
) -> tuple[float, float]:
    """∫ w cos 2β dβ and ∫ w dβ over one ring; offset = γ − θ, exactly."""
    ct, st = np.cos(theta), np.sin(theta)
    anchors = _inner_anchors(c, s, (ct, st), sigma, measure)
    t, w = _graded(order, 1e-17)
    low, width = anchors[:-1, None], np.diff(anchors)[:, None]
    beta = np.concatenate([low + width * t, low + width * (1 - t)])
    weight = np.concatenate([width * w, width * w])
    # haversine: sin²(α/2) keeps its digits where M is close to N
    hav = np.sin(offset / 2) ** 2 + st * s * np.sin(beta / 2) ** 2
    m = 1 - 2 * hav
    seen = m > 1e-12
    hav, m, beta, weight = hav[seen], m[seen], beta[seen], weight[seen]
    sine2 = 4 * hav * (1 - hav)
    density = weight * np.exp(-sigma * sine2 / m**2)
    if measure == "eq8":
        density = density / (m**2 * np.sqrt(np.maximum(sine2, 1e-300)))
    else:
        density = density * c / m**4
    if measure == "shadowed":
        density = density * _shadowing(2 * c * m - ct, sigma)
    return float(np.sum(density * np.cos(2 * beta))), float(np.sum(density))


def specular_dolp(
    zenith: float, eta: complex, sigma: float, measure: str = "eq8", order: int = 18
) -> float:
    """ρ = (I_⊥ − I_∥)/(I_⊥ + I_∥) of physics.md, Equations 4 to 8."""
    theta = mpf(float(zenith))
    anchors = _outer_anchors(theta, eta, sigma, measure)
    nodes, weights = _outer_nodes(anchors, order)
    # A ring whose facets all have exp(−σ tan²α) below e^−150 adds nothing: F varies by < e^130.
    above = above_sum = 0.0
    for gamma, weight in zip(nodes, weights, strict=True):
        offset = float(gamma - theta)
        if sigma * np.tan(offset) ** 2 > 150 or weight == 0.0:
            continue
        c, s = float(mp.cos(gamma)), float(mp.sin(gamma))
        if c <= 0.0 or s <= 0.0:
            continue
        signed, plain = _ring(c, s, offset, float(zenith), sigma, measure, order)
        perpendicular, parallel = fresnel.reflectances(gamma, eta)
        above += float(perpendicular - parallel) * weight * s * signed
        above_sum += float(perpendicular + parallel) * weight * s * plain
    return above / above_sum
