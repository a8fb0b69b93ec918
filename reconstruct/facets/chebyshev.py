"""Functions of one variable as Chebyshev series whose length follows from their own coefficients.

Trefethen, *Approximation Theory and Approximation Practice*, chapters 2 to 4 and 8.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

FloatArray = NDArray[np.float64]
Function = Callable[[FloatArray], FloatArray]

_FIRST = 25
# Where a series is compared with the function, as fractions of the interval: geometrically towards
# both ends, where layers are, and somewhere inside.
_UNSEEN = np.array([2e-5, 4e-4, 8e-3, 0.11, 0.39, 0.71, 0.93, 0.993, 0.9997, 0.99998])
_MOST = 97  # samples, from where two series on half the interval are the better deal


class Series(NamedTuple):
    """Coefficients of T_0, T_1, … on [low, high], and whether they reached the tolerance."""

    low: float
    high: float
    coefficients: FloatArray
    settled: bool


def lobatto(count: int) -> FloatArray:
    """Points on [−1, 1] from 1 down; every second point of 2 count − 1 is a point of count."""
    return np.asarray(np.cos(np.pi * np.arange(count) / max(count - 1, 1)))


def coefficients(values: FloatArray, axis: int = -1) -> FloatArray:
    """Coefficients of the polynomial through values at Lobatto points along `axis`."""
    count = values.shape[axis]
    if count == 1:
        return values
    result = np.moveaxis(dct(values, type=1, axis=axis) / (count - 1), axis, 0)
    result[0] *= 0.5
    result[-1] *= 0.5
    return np.moveaxis(result, 0, axis)


def needed(series: FloatArray, tolerance: float) -> int:
    """How many leading coefficients to keep so that the others sum up to at most `tolerance`."""
    rest = np.cumsum(np.abs(series[::-1]))
    return max(1, series.size - int(np.searchsorted(rest, tolerance, side="right")))


def _on_unit(x: FloatArray, low: float, high: float) -> FloatArray:
    return np.asarray((2.0 * x - (high + low)) / (high - low))


def chebyshev_series(function: Function, low: float, high: float, tolerance: float) -> Series:
    """Series of a function on [low, high] within about `tolerance`.

    Samples are doubled, keeping the old ones, until the last two coefficients (two, because in a
    nearly even or odd function every other one is small) are within `tolerance`, and so are the
    errors at some points that are no samples.
    """
    centre, half = 0.5 * (high + low), 0.5 * (high - low)
    unseen = low + (high - low) * _UNSEEN
    seen = np.concatenate([np.clip(centre + half * lobatto(_FIRST), low, high), unseen])
    values, truth = np.split(function(seen), [_FIRST])
    while True:
        found = coefficients(values)
        settled = bool(np.abs(found[-2:]).sum() <= tolerance)
        if settled:
            guess = np.polynomial.chebyshev.chebval(_on_unit(unseen, low, high), found)
            settled = bool(np.max(np.abs(guess - truth)) <= tolerance)
        if settled or values.size >= _MOST:
            keep = needed(found, 0.5 * tolerance) if settled else found.size
            return Series(low, high, found[:keep], settled)
        count = 2 * values.size - 1
        denser = np.empty(count)
        denser[::2] = values
        denser[1::2] = function(centre + half * lobatto(count)[1::2])
        values = denser


def chebyshev_pieces(
    function: Function, low: float, high: float, tolerance: float, narrowest: float
) -> list[Series]:
    """Series on pieces of [low, high], halved where one is not enough, in ascending order.

    Pieces are not halved below the width `narrowest`.
    """
    piece = chebyshev_series(function, low, high, tolerance)
    if piece.settled or high - low < 2.0 * narrowest:
        return [piece]
    middle = 0.5 * (low + high)
    return [
        *chebyshev_pieces(function, low, middle, tolerance, narrowest),
        *chebyshev_pieces(function, middle, high, tolerance, narrowest),
    ]


def evaluate_pieces(pieces: list[Series], x: FloatArray) -> FloatArray:
    """Values at flat `x`; beyond the ends, the nearest end's."""
    edges = np.array([piece.low for piece in pieces[1:]])
    where = np.searchsorted(edges, x, side="right")
    values = np.empty(x.shape)
    for index in np.unique(where):
        piece = pieces[index]
        chosen = where == index
        inside = np.clip(x[chosen], piece.low, piece.high)
        unit = _on_unit(inside, piece.low, piece.high)
        values[chosen] = np.polynomial.chebyshev.chebval(unit, piece.coefficients)
    return values
