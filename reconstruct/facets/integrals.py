"""The microfacet integrals of Gu et al., Equations 5 to 8, to a stated error.

With M the facet's normal, slopes (r, φ) about the mean normal N, and the weight w of a measure,

    ρ = (I_⊥ − I_∥)/(I_⊥ + I_∥) = ∫∫ w (F_⊥ − F_∥) cos 2β dr dφ / ∫∫ w (F_⊥ + F_∥) dr dφ.

F_⊥ − F_∥ = sin²γ · contrast, and sin²γ cos 2β = (y² − x²)/(1 + r²) with x, y the facet's
components before normalisation: the direction β, which has no value where M = V, never appears.
The integral runs over r, split wherever something happens (facet_domain), and inside over φ in
[0, π]; the other half is its mirror image. Each point climbs a ladder of rules (facet_rules) until
two rungs agree.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.facets.breakpoints import Measure, Surfaces, azimuth_breaks, slope_breaks
from malus.reconstruct.facets.rules import (
    Ladder,
    Rule,
    Rung,
    cheap_ladder,
    robust_ladder,
    stretched,
)
from malus.reconstruct.fresnel import EtaArray, excess

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

# Numbers in one temporary array: 64 kB, which stay in cache.
_BLOCK = 8192
_WORTH_THREADS = 8  # blocks
# exp(−32) = 1e-14 of the weight may be cut off, after facets at grazing incidence, which reflect
# up to 1/F(0) times more, have been allowed for.
_CUT = 32.0
# Nearer to index one than this, grazing facets outshine all others from within a layer of cos γ
# about √|δ| wide: tall and narrow, so that cheap rules could agree without having seen it.
_THIN_LAYER = 0.1
# Beyond it, Brewster's angle lies within cos γ = 1/|η| of grazing, another thin layer.
_MIRROR = 64.0
# Rougher than this, G1 ≈ 3.5 a falls off from a spike at L = N like the inverse distance from it.
_SPIKED = 1.0


def surfaces_at(zenith: FloatArray, eta: EtaArray, sigma: FloatArray) -> Surfaces:
    """Points to integrate at, from flat arrays; extremes beyond which nothing changes are cut.

    At η = 1 nothing is reflected and ρ is its limit: the value at the next double.
    """
    theta = np.clip(zenith, 1e-9, np.pi / 2)  # ρ ~ θ² r² < 1e-10 below
    eps = np.finfo(np.float64).eps
    index = np.where(np.abs(eta - 1.0) < eps, 1.0 + eps, eta)
    index = np.where(np.abs(index) > 1e12, 1e12, index)
    index = np.where(np.abs(index) < 1e-12, 1e-12, index)
    delta = excess(index)
    squared = -delta.real
    critical = np.sqrt(np.where((squared > 0.0) & (squared < 1.0), squared, 0.0))
    return Surfaces(
        theta, np.cos(theta), np.sin(theta), delta, critical, np.clip(sigma, 1e-20, 1e24)
    )


def _reach(surfaces: Surfaces) -> FloatArray:
    """√σ r beyond which exp(−σr²) F is negligible for every facet."""
    reflected = np.abs(surfaces.delta) / (np.abs(surfaces.delta) + 4.0)  # about √F(0)
    return np.asarray(np.sqrt(_CUT - 2.0 * np.log(reflected)))


def _intervals(breaks: FloatArray) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Start and width of every non-empty interval, and the row of `breaks` that it belongs to."""
    row, column = np.nonzero(breaks[:, 1:] > breaks[:, :-1])
    low = breaks[row, column]
    return low, breaks[row, column + 1] - low, row


def _ring_integrals(
    r: FloatArray, surfaces: Surfaces, measure: Measure, rule: Rule
) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator of ρ over φ, on rings of slope r (flat, as are the surfaces)."""
    from malus.reconstruct.facets.facet_kernels import ring_sums

    low, width, ring = _intervals(azimuth_breaks(r, surfaces, measure))
    turns = np.cos(low[:, None] + width[:, None] * rule.nodes)
    sums = np.zeros((ring.size, 2))
    ring_sums(turns, rule.weights, ring, r, surfaces, get_args(Measure).index(measure), sums)
    polarised, total = (np.bincount(ring, width * row, r.size) for row in sums.T)
    return np.asarray(polarised, np.float64), np.asarray(total, np.float64)


def _integrate(surfaces: Surfaces, measure: Measure, rung: Rung) -> FloatArray:
    """ρ of flat surfaces by one rung."""
    low, width, row = _intervals(slope_breaks(surfaces, measure, _reach(surfaces)))
    nodes, weights = stretched(low, width, rung)
    r, point = nodes.ravel(), np.tile(row, len(nodes))
    at = surfaces.take(point)
    weight = weights.ravel() * np.exp(-at.sigma * r * r)  # Equation 2
    if measure != "eq8":
        weight *= r  # the Jacobian that Equation 8 leaves out
    polarised, total = _ring_integrals(r, at, measure, rung.inner)
    count = surfaces.zenith.size
    return np.asarray(
        np.bincount(point, weight * polarised, count) / np.bincount(point, weight * total, count)
    )


def _blocked(surfaces: Surfaces, measure: Measure, rung: Rung) -> FloatArray:
    """`_integrate` in blocks that stay in cache, on all cores where there are enough of them."""
    step = max(1, _BLOCK // (2 * rung.outer.nodes.size))
    blocks = [slice(start, start + step) for start in range(0, surfaces.zenith.size, step)]

    def integrate(block: slice) -> FloatArray:
        return _integrate(surfaces.take(block), measure, rung)

    if len(blocks) < _WORTH_THREADS:
        return np.concatenate([integrate(block) for block in blocks])
    with ThreadPoolExecutor() as pool:
        return np.concatenate(list(pool.map(integrate, blocks)))


def _climb(
    surfaces: Surfaces, measure: Measure, ladder: Ladder, tolerance: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """ρ by the first rung whose estimated error is a tenth of `tolerance`, and where none was.

    Two rungs differ by the error of the lower one. The upper one's is smaller by the factor by
    which the differences shrink from rung to rung, as far as the ladder can be trusted to go on;
    but two rungs can come close by accident, so the difference before has a say.
    """
    rho = _blocked(surfaces, measure, ladder.rungs[0])
    left: IndexArray = np.arange(rho.size)
    before = np.full(rho.size, np.inf)  # a first difference proves nothing
    for rung in ladder.rungs[1:]:
        finer = _blocked(surfaces.take(left), measure, rung)
        differ = np.abs(finer - rho[left])
        rho[left] = finer
        shrunk = np.clip(differ / np.maximum(before, 1e-300), ladder.trust, 1.0)
        open_ = np.maximum(differ * shrunk, ladder.memory * before) > 0.1 * tolerance
        left, before = left[open_], differ[open_]
        if left.size == 0:
            break
    unsettled = np.zeros(rho.size, dtype=np.bool_)
    unsettled[left] = True
    return rho, unsettled


def _stiff(surfaces: Surfaces, measure: Measure) -> NDArray[np.bool_]:
    """Points whose integrand has something narrow that cheap rules could agree to overlook."""
    size = np.abs(surfaces.delta)
    stiff = (size < _THIN_LAYER) | (size > _MIRROR)
    nearest = np.abs(np.tan(surfaces.zenith - np.arccos(surfaces.critical)))
    kinked = (surfaces.critical > 0.0) & (nearest * np.sqrt(surfaces.sigma) < _reach(surfaces))
    stiff |= kinked  # F leaves 1 like a square root at the critical angle
    return np.asarray(stiff | (surfaces.sigma < _SPIKED) if measure == "shadowed" else stiff)


def integrate_dolp(
    zenith: FloatArray, eta: EtaArray, sigma: FloatArray, measure: Measure, tolerance: float
) -> FloatArray:
    """Specular degree of polarisation ρ of flat, valid arrays of one length, within `tolerance`."""
    surfaces = surfaces_at(zenith, eta, sigma)
    rho = np.empty(zenith.size)
    stiff = _stiff(surfaces, measure)
    for ladder, hard in ((cheap_ladder(), False), (robust_ladder(), True)):
        chosen: IndexArray = np.flatnonzero(stiff == hard)
        if chosen.size:
            rho[chosen], unsettled = _climb(surfaces.take(chosen), measure, ladder, tolerance)
            stiff[chosen[unsettled]] = True
    return np.where(zenith == 0.0, 0.0, np.clip(rho, -1.0, 1.0))
