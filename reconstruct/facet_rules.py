"""One-dimensional quadrature rules on [0, 1], and the ladder of them that integrals climb.

Two families serve the microfacet integrals. Both are applied between breakpoints, so that
whatever is not smooth happens at the ends of an interval.

* `gauss` and `bent` (Gauss-Legendre, plain or with nodes bent towards both ends by 3t² − 2t³,
  which turns the square roots that a tangency leaves at an end into polynomials): cheap.
* `double_exponential` (tanh-sinh: Takahasi and Mori, Publ. RIMS Kyoto Univ. 9, 1974): its nodes
  lie as densely in the logarithm of the distance to an end as elsewhere, so that a layer of
  width 1e-9 costs no more than one of width 0.1.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Beyond t = 3.2 the tanh-sinh nodes are within 1e-17 of the ends: no double can tell them apart.
_REACH = 3.2


class Rule(NamedTuple):
    """Nodes in (0, 1) and weights, which sum to 1."""

    nodes: FloatArray
    weights: FloatArray


class Rung(NamedTuple):
    """The rules of one step of a ladder: `outer` for the slope r, `inner` for the azimuth φ."""

    outer: Rule
    inner: Rule


def gauss(count: int) -> Rule:
    """Gauss-Legendre: for integrands that are analytic beyond both ends."""
    x, w = np.polynomial.legendre.leggauss(count)
    return Rule((1.0 + x) / 2.0, w / 2.0)


def bent(count: int) -> Rule:
    """Gauss-Legendre in t with s = 3t² − 2t³: for square roots at the ends."""
    t, w = gauss(count)
    return Rule(t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) * w)


def double_exponential(count: int) -> Rule:
    """Tanh-sinh: for layers, logarithms and algebraic singularities at the ends."""
    t, step = np.linspace(-_REACH, _REACH, count, retstep=True)
    stretch = np.pi * np.sinh(t)
    nodes = 1.0 / (1.0 + np.exp(-stretch))
    weights = float(step) * np.pi * np.cosh(t) * nodes / (1.0 + np.exp(stretch))
    return Rule(nodes, weights / weights.sum())


@cache
def cheap_ladder() -> tuple[Rung, ...]:
    """Rungs for integrands whose features are as wide as the intervals, each 1.5 times denser."""
    return tuple(Rung(bent(n), gauss(m)) for n, m in ((8, 6), (12, 9), (18, 14), (27, 21), (40, 32)))


@cache
def robust_ladder() -> tuple[Rung, ...]:
    """Rungs for layers and singularities."""
    rules = [double_exponential(count) for count in (27, 41, 61, 91, 137, 205)]
    return tuple(Rung(rule, rule) for rule in rules)
