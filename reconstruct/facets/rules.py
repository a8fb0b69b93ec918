"""Quadrature rules on [0, 1], in ladders of increasing density.

Two families serve the microfacet integrals. Both are applied between breakpoints, so that
whatever is not smooth happens at the ends of an interval.

* `gauss` (Gauss-Legendre): cheap. Over slopes its nodes are bent by `stretched`, which turns the
  square root that a tangency leaves at the start into a polynomial.
* `double_exponential` (tanh-sinh: Takahasi and Mori, Publ. RIMS Kyoto Univ. 9, 1974): its nodes
  are spaced evenly in the logarithm of the distance to an end, so that a layer of width 1e-9 costs
  no more than one of width 0.1.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from malus.scenes.core.arrays import Float64Array

# Beyond t = 3.2 the tanh-sinh nodes are within 1e-17 of the ends: no double can tell them apart.
_REACH = 3.2


class Rule(NamedTuple):
    """Nodes in (0, 1) and weights, which sum to 1."""

    nodes: Float64Array
    weights: Float64Array


class Rung(NamedTuple):
    """The rules of one step of a ladder: `outer` for the slope r, `inner` for the azimuth φ.

    With `bend` the outer nodes are spaced unevenly (see `stretched`).
    """

    outer: Rule
    inner: Rule
    bend: bool


class Ladder(NamedTuple):
    """Pairs of rules, each about 1.4 times as dense as the one before in each direction.

    One step is believed to shrink the error to `trust` of itself at best, two steps at once to
    `memory`.
    """

    rungs: tuple[Rung, ...]
    trust: float
    memory: float


def gauss(count: int) -> Rule:
    """Gauss-Legendre rule: for integrands that are analytic beyond both ends."""
    x, w = np.polynomial.legendre.leggauss(count)
    return Rule((1.0 + x) / 2.0, w / 2.0)


def double_exponential(count: int) -> Rule:
    """Tanh-sinh rule: for layers, logarithms and algebraic singularities at the ends."""
    t, step = np.linspace(-_REACH, _REACH, count, retstep=True)
    stretch = np.pi * np.sinh(t)
    nodes = 1.0 / (1.0 + np.exp(-stretch))
    weights = float(step) * np.pi * np.cosh(t) * nodes / (1.0 + np.exp(stretch))
    return Rule(nodes, weights / weights.sum())


def stretched(
    low: Float64Array, width: Float64Array, rung: Rung
) -> tuple[Float64Array, Float64Array]:
    """Nodes and weights of the outer rule on intervals from `low`, shape (nodes, intervals).

    Bent nodes are r = low cosh t. Near `low` that is quadratic in t, for the square root of a
    tangency; far from it, it is exponential, because what happens at r = low goes on for r of the
    order of low, however far the interval reaches. An interval from 0 is only bent.
    """
    nodes, weights = rung.outer.nodes[:, None], rung.outer.weights[:, None]
    if not rung.bend:
        return low + width * nodes, width * weights
    scale = np.where(low > 0.0, np.maximum(low, 1e-6 * width), width)
    last = 2.0 * np.arcsinh(np.sqrt(0.5 * width / scale))
    r = low + 2.0 * scale * np.square(np.sinh(0.5 * last * nodes))
    return r, scale * np.sinh(last * nodes) * last * weights


@cache
def cheap_ladder() -> Ladder:
    """Gauss rules for features as wide as the intervals, where errors shrink regularly."""
    counts = ((9, 5), (13, 7), (18, 9), (26, 12), (38, 17), (54, 24))
    rungs = tuple(Rung(gauss(outer), gauss(inner), bend=True) for outer, inner in counts)
    return Ladder(rungs, trust=0.1, memory=0.003)


@cache
def robust_ladder() -> Ladder:
    """Tanh-sinh rules for layers and singularities: the densest gives 13 digits.

    Errors of the others do not shrink regularly.
    """
    rules = [double_exponential(count) for count in (27, 41, 61, 91, 137, 205)]
    rungs = tuple(Rung(rule, rule, bend=False) for rule in rules)
    return Ladder(rungs, trust=1.0, memory=0.003)
