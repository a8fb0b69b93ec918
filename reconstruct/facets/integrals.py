"""The microfacet integrals of Gu et al., Equations 5 to 8, to a stated error.

With M the facet's normal, slopes (r, φ) about the mean normal N, and the weight w of a measure,

    ρ = (I_⊥ − I_∥)/(I_⊥ + I_∥) = ∫∫ w (F_⊥ − F_∥) cos 2β dr dφ / ∫∫ w (F_⊥ + F_∥) dr dφ.

F_⊥ − F_∥ = sin²γ · contrast, and sin²γ cos 2β = (y² − x²)/(1 + r²) with x, y the facet's
components before normalisation: the direction β, which has no value where M = V, never appears.
The integral runs over r, split at the breakpoints of the integrand (`breakpoints`), and inside over
φ in [0, π]; the other half is its mirror image. Each point is integrated by denser and denser
rules (`rules`) until two of them agree.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import get_args

import numpy as np

from malus.reconstruct.facets.breakpoints import (
    SHADOWED,
    Measure,
    Surfaces,
    azimuth_breaks,
    slope_breaks,
)
from malus.reconstruct.facets.rules import (
    Ladder,
    Rule,
    Rung,
    cheap_ladder,
    robust_ladder,
    stretched,
)
from malus.reconstruct.fresnel import EtaArray, excess
from malus.scenes.core.arrays import BoolArray, Float64Array, IndexArray

# Numbers in one temporary array: 64 kB, which stay in cache.
_BLOCK = 8192
_WORTH_THREADS = 8  # blocks from which on threads save time
# exp(−32) = 1e-14 of the weight may be cut off, after facets at grazing incidence, which reflect
# up to 1/F(0) times more, have been allowed for.
_CUT = 32.0
# √σ r at which GGX facets are cut off: the rest of the integral is a share of about its inverse.
_FAR_TAIL = 1e10
# |δ| below which grazing facets outshine all others within a layer of cos γ about √|δ| wide: so
# tall and narrow that cheap rules could agree although none of their nodes lies in it.
_THIN_LAYER = 0.1
# |δ| above which Brewster's angle lies within cos γ = 1/|η| of grazing, another thin layer.
_MIRROR = 64.0
# σ above which GGX facets have so long a tail that two rungs can agree too early.
_NEARLY_SMOOTH = 1e5
# σ below which G1 ≈ 3.5 a falls off from a spike at L = N like the inverse distance from it.
_SPIKED = 1.0


def surfaces_at(zenith: Float64Array, eta: EtaArray, sigma: Float64Array) -> Surfaces:
    """Points to integrate at, from flat arrays, clipped where larger values change nothing.

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


def _reach(surfaces: Surfaces, measure: Measure) -> Float64Array:
    """√σ r beyond which the weight of a facet times F is negligible for every facet."""
    if measure == "shadowed_ggx":
        return np.full(surfaces.sigma.shape, _FAR_TAIL)
    reflected = np.abs(surfaces.delta) / (np.abs(surfaces.delta) + 4.0)  # about √F(0)
    return np.asarray(np.sqrt(_CUT - 2.0 * np.log(reflected)))


def _intervals(breaks: Float64Array) -> tuple[Float64Array, Float64Array, IndexArray]:
    """Start and width of every non-empty interval, and the row of `breaks` that it belongs to."""
    row, column = np.nonzero(breaks[:, 1:] > breaks[:, :-1])
    low = breaks[row, column]
    return low, breaks[row, column + 1] - low, row


def _ring_integrals(
    r: Float64Array, surfaces: Surfaces, measure: Measure, rule: Rule
) -> tuple[Float64Array, Float64Array]:
    """Numerator and denominator of ρ over φ, on rings of slope r (flat, as are the surfaces)."""
    from malus.reconstruct.facets.facet_kernels import sum_over_azimuths

    low, width, ring = _intervals(azimuth_breaks(r, surfaces, measure))
    cosines = np.cos(low[:, None] + width[:, None] * rule.nodes)
    sums = np.zeros((ring.size, 2))
    number = get_args(Measure).index(measure)
    sum_over_azimuths(cosines, rule.weights, ring, r, surfaces, number, sums)
    polarised, total = (np.bincount(ring, width * row, r.size) for row in sums.T)
    return np.asarray(polarised, np.float64), np.asarray(total, np.float64)


def _integrate(surfaces: Surfaces, measure: Measure, rung: Rung) -> Float64Array:
    """ρ (points,) of surfaces by the rules of one rung."""
    low, width, row = _intervals(slope_breaks(surfaces, measure, _reach(surfaces, measure)))
    nodes, weights = stretched(low, width, rung)
    r, point = nodes.ravel(), np.tile(row, len(nodes))
    ring_surfaces = surfaces.take(point)
    squared = ring_surfaces.sigma * r * r
    # Equation 2, or GGX
    slopes = (1.0 + squared) ** -2.0 if measure == "shadowed_ggx" else np.exp(-squared)
    weight = weights.ravel() * slopes
    if measure != "eq8":
        weight *= r  # the Jacobian that Equation 8 leaves out
    polarised, total = _ring_integrals(r, ring_surfaces, measure, rung.inner)
    count = surfaces.zenith.size
    return np.asarray(
        np.bincount(point, weight * polarised, count) / np.bincount(point, weight * total, count)
    )


def _blocked(surfaces: Surfaces, measure: Measure, rung: Rung) -> Float64Array:
    """`_integrate` in blocks that stay in cache, on all cores where there are enough of them."""
    step = max(1, _BLOCK // (2 * rung.outer.nodes.size))
    blocks = [slice(start, start + step) for start in range(0, surfaces.zenith.size, step)]

    def integrate(block: slice) -> Float64Array:
        return _integrate(surfaces.take(block), measure, rung)

    if len(blocks) < _WORTH_THREADS:
        return np.concatenate([integrate(block) for block in blocks])
    with ThreadPoolExecutor() as pool:
        return np.concatenate(list(pool.map(integrate, blocks)))


def _climb(
    surfaces: Surfaces, measure: Measure, ladder: Ladder, tolerance: float
) -> tuple[Float64Array, BoolArray]:
    """ρ from the first rung whose estimated error is a tenth of `tolerance`.

    The second array is True at points where no rung reached that.

    The difference of two rungs is the error of the lower one. That of the upper one is smaller by
    the factor by which the differences shrink from rung to rung, but not below `ladder.trust`. Two
    rungs can agree by accident, so the difference before counts as well, by `ladder.memory`.
    """
    rho = _blocked(surfaces, measure, ladder.rungs[0])
    remaining: IndexArray = np.arange(rho.size)
    previous = np.full(rho.size, np.inf)  # a first difference proves nothing
    for rung in ladder.rungs[1:]:
        finer = _blocked(surfaces.take(remaining), measure, rung)
        difference = np.abs(finer - rho[remaining])
        rho[remaining] = finer
        shrinkage = np.clip(difference / np.maximum(previous, 1e-300), ladder.trust, 1.0)
        error = np.maximum(difference * shrinkage, ladder.memory * previous)
        inaccurate = error > 0.1 * tolerance
        remaining, previous = remaining[inaccurate], difference[inaccurate]
        if remaining.size == 0:
            break
    unsettled = np.zeros(rho.size, dtype=np.bool_)
    unsettled[remaining] = True
    return rho, unsettled


def _stiff(surfaces: Surfaces, measure: Measure) -> BoolArray:
    """True at points whose integrand has a narrow feature that the cheap rules could all miss."""
    size = np.abs(surfaces.delta)
    stiff = (size < _THIN_LAYER) | (size > _MIRROR)
    nearest = np.abs(np.tan(surfaces.zenith - np.arccos(surfaces.critical)))
    within = nearest * np.sqrt(surfaces.sigma) < _reach(surfaces, measure)
    kinked = (surfaces.critical > 0.0) & within
    stiff |= kinked  # F leaves 1 like a square root at the critical angle
    if measure == "shadowed_ggx":
        stiff |= surfaces.sigma > _NEARLY_SMOOTH
    return np.asarray(stiff | (surfaces.sigma < _SPIKED) if measure in SHADOWED else stiff)


def integrate_dolp(
    zenith: Float64Array, eta: EtaArray, sigma: Float64Array, measure: Measure, tolerance: float
) -> Float64Array:
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
