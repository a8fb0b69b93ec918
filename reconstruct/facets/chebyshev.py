"""Chebyshev series of functions of one variable, as long as a tolerance asks for.

Trefethen, *Approximation Theory and Approximation Practice*, chapters 2 to 4 and 8.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from malus.scenes.core.arrays import Float64Array

Function = Callable[[Float64Array], Float64Array]

_FEWEST_SAMPLES = 25
# Points at which a series is compared with the function, as fractions of the interval: spaced
# geometrically towards both ends, where thin layers are, and some inside.
_TEST_POINTS = np.array([2e-5, 4e-4, 8e-3, 0.11, 0.39, 0.71, 0.93, 0.993, 0.9997, 0.99998])
_MOST_SAMPLES = 97  # beyond which two series on half the interval cost less


class Series(NamedTuple):
    """Coefficients of T_0, T_1, … on [low, high]; `settled` if they reached the tolerance."""

    low: float
    high: float
    coefficients: Float64Array
    settled: bool


def lobatto(count: int) -> Float64Array:
    """Points on [−1, 1] from 1 down; every second point of 2 count − 1 is a point of count."""
    return np.asarray(np.cos(np.pi * np.arange(count) / max(count - 1, 1)))


def coefficients(values: Float64Array, axis: int = -1) -> Float64Array:
    """Coefficients of the polynomial through values at Lobatto points along `axis`."""
    count = values.shape[axis]
    if count == 1:
        return values
    values = np.moveaxis(values, axis, 0)
    # A cosine transform is a Fourier transform of the even continuation; scipy's own takes as long
    # to import as all tables of a family to make.
    result = np.fft.rfft(np.concatenate([values, values[-2:0:-1]]), axis=0).real / (count - 1)
    result[0] *= 0.5
    result[-1] *= 0.5
    return np.moveaxis(result, 0, axis)


def needed(series: Float64Array, tolerance: float) -> int:
    """Number of leading coefficients to keep so that the others sum up to at most `tolerance`."""
    rest = np.cumsum(np.abs(series[::-1]))
    return max(1, series.size - int(np.searchsorted(rest, tolerance, side="right")))


def _on_unit(x: Float64Array, low: float, high: float) -> Float64Array:
    """Coordinates on [low, high] mapped to [−1, 1]."""
    return np.asarray((2.0 * x - (high + low)) / (high - low))


def chebyshev_series(function: Function, low: float, high: float, tolerance: float) -> Series:
    """Series of a function on [low, high] within about `tolerance`.

    Samples are doubled, keeping the old ones, until the last two coefficients (two, because in a
    nearly even or odd function every other one is small) are within `tolerance`, and so are the
    errors at some points that are no samples.
    """
    centre, half = 0.5 * (high + low), 0.5 * (high - low)
    test_points = low + (high - low) * _TEST_POINTS
    samples = np.clip(centre + half * lobatto(_FEWEST_SAMPLES), low, high)
    values, expected = np.split(function(np.concatenate([samples, test_points])), [_FEWEST_SAMPLES])
    while True:
        series = coefficients(values)
        settled = bool(np.abs(series[-2:]).sum() <= tolerance)
        if settled:
            tested = np.polynomial.chebyshev.chebval(_on_unit(test_points, low, high), series)
            settled = bool(np.max(np.abs(tested - expected)) <= tolerance)
        if settled or values.size >= _MOST_SAMPLES:
            keep = needed(series, 0.5 * tolerance) if settled else series.size
            return Series(low, high, series[:keep], settled)
        count = 2 * values.size - 1
        denser = np.empty(count)
        denser[::2] = values
        denser[1::2] = function(centre + half * lobatto(count)[1::2])
        values = denser


def chebyshev_pieces(
    function: Function, low: float, high: float, tolerance: float, narrowest: float
) -> list[Series]:
    """Series on pieces of [low, high] in ascending order, halved where one series is not enough.

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


def evaluate_pieces(pieces: list[Series], x: Float64Array) -> Float64Array:
    """Values of piecewise series at flat `x`; beyond the ends, those of the nearest end."""
    edges = np.array([piece.low for piece in pieces[1:]])
    piece_of = np.searchsorted(edges, x, side="right")
    values = np.empty(x.shape)
    for index in np.unique(piece_of):
        piece = pieces[index]
        chosen = piece_of == index
        inside = np.clip(x[chosen], piece.low, piece.high)
        unit = _on_unit(inside, piece.low, piece.high)
        values[chosen] = np.polynomial.chebyshev.chebval(unit, piece.coefficients)
    return values
