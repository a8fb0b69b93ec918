"""Chebyshev series of functions of one variable, as long as a tolerance asks for.

Trefethen, *Approximation Theory and Approximation Practice*, chapters 2 to 4 and 8.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np

from malus.scenes.core.arrays import Float64Array, IndexArray

Function = Callable[[Float64Array], Float64Array]

_Found = TypeVar("_Found")
Search: TypeAlias = Generator[Float64Array, Float64Array, _Found]
"""Yields points, is sent the values of a function there, and returns what it found of it."""

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
    """Series of a function on [low, high] within about `tolerance`, see `series_search`."""
    (series,) = together([series_search(low, high, tolerance)], lambda x, _: function(x))
    return series


def together(
    searches: Sequence[Search[_Found]],
    function: Callable[[Float64Array, IndexArray], Float64Array],
) -> list[_Found]:
    """What each of several searches finds; they go on side by side.

    One call of the function has the points that all of them ask for: many small calls would take
    several times as long. It is told the number of the search that each point belongs to.

    Examples
    --------
    >>> powers = [series_search(0.0, 1.0, 1e-9) for _ in range(2)]
    >>> [one.coefficients.round(6).tolist() for one in together(powers, lambda x, n: x ** (1 + n))]
    [[0.5, 0.5], [0.375, 0.5, 0.125]]
    """
    found: dict[int, _Found] = {}
    asked = {number: next(search) for number, search in enumerate(searches)}
    while asked:
        sizes = [points.size for points in asked.values()]
        owners = np.repeat(np.array(list(asked), dtype=np.intp), sizes)
        values = function(np.concatenate(list(asked.values())), owners)
        answers = zip(list(asked), np.split(values, np.cumsum(sizes)[:-1]), strict=True)
        asked = {}
        for number, answer in answers:
            try:
                asked[number] = searches[number].send(answer)
            except StopIteration as end:
                found[number] = end.value
    return [found[number] for number in range(len(searches))]


def series_search(low: float, high: float, tolerance: float) -> Search[Series]:
    """Find the series of a function on [low, high] within about `tolerance`.

    Samples are doubled, keeping the old ones, until the last two coefficients (two, because in a
    nearly even or odd function every other one is small) are within `tolerance`, and so are the
    errors at some points that are no samples.
    """
    centre, half = 0.5 * (high + low), 0.5 * (high - low)
    test_points = low + (high - low) * _TEST_POINTS
    samples = np.clip(centre + half * lobatto(_FEWEST_SAMPLES), low, high)
    first = yield np.concatenate([samples, test_points])
    values, expected = np.split(first, [_FEWEST_SAMPLES])
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
        denser[1::2] = yield centre + half * lobatto(count)[1::2]
        values = denser


def pieces_search(
    low: float, high: float, tolerance: float, narrowest: float
) -> Search[list[Series]]:
    """Find series on pieces of [low, high] in ascending order, halved where one is not enough.

    Pieces are not halved below the width `narrowest`.
    """
    piece = yield from series_search(low, high, tolerance)
    if piece.settled or high - low < 2.0 * narrowest:
        return [piece]
    middle = 0.5 * (low + high)
    lower = yield from pieces_search(low, middle, tolerance, narrowest)
    upper = yield from pieces_search(middle, high, tolerance, narrowest)
    return [*lower, *upper]


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
