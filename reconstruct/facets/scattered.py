"""Smooth functions of a few variables at many scattered points, from few evaluations.

The box around the points is probed along lines, which tells how many Chebyshev coefficients each
axis needs; a tensor of samples gives them; some of the points check the result. Where the tensor
would need more samples than there are points to compute, the box is halved along its most
demanding axis, and boxes with few points are computed without any interpolation.

A Chebyshev series in x is a cosine series in arccos x. Sampled more finely there it makes a cubic
spline with mirrored ends that costs 64 multiplications a point, whatever the degree.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from malus.reconstruct.facets.chebyshev import chebyshev_series, coefficients, lobatto

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]
Function = Callable[[FloatArray], FloatArray]  # points (count, axes) -> values (count,)

_FEWEST = 1000  # points below which probing a box costs more than it saves
_LARGEST = 20_000  # samples in one tensor, from where two halves are cheaper to evaluate
_CHECKED = 32  # points at which a fit is compared with the function
_FINER = 4  # spline intervals for every coefficient: at 3 the spline's error shows, at 6 time does
_CHUNK = 1 << 16  # points that one thread evaluates at a time


class Box(NamedTuple):
    """Bounds, shape (axes,) each."""

    low: FloatArray
    high: FloatArray

    def angles(self, points: FloatArray) -> FloatArray:
        """arccos of the coordinates on [−1, 1] as fractions of π from the upper end, transposed."""
        width = np.where(self.high > self.low, self.high - self.low, 1.0)
        unit = (2.0 * points - (self.high + self.low)) / width
        return np.asarray(np.arccos(np.clip(unit, -1.0, 1.0)).T / np.pi)

    def at(self, unit: FloatArray) -> FloatArray:
        """Points at unit coordinates (..., axes)."""
        points = 0.5 * (self.high + self.low) + 0.5 * (self.high - self.low) * unit
        return np.asarray(np.clip(points, self.low, self.high))


def _lines(box: Box, axis: int) -> list[FloatArray]:
    """Points that lines along `axis` run through: the centre and near the edges of the others."""
    others = [
        (0.0,) if index == axis or box.high[index] <= box.low[index] else (-0.9, 0.9)
        for index in range(box.low.size)
    ]
    corners = [box.at(np.array(unit)) for unit in product(*others)]
    return [box.at(np.zeros(box.low.size)), *corners] if len(corners) > 1 else corners


def _count_along(function: Function, box: Box, axis: int, tolerance: float) -> int:
    """Coefficients that the most demanding of some lines needs."""
    if box.high[axis] <= box.low[axis]:
        return 1

    def along(through: FloatArray) -> int:
        def line(x: FloatArray) -> FloatArray:
            points = np.tile(through, (x.size, 1))
            points[:, axis] = x
            return function(points)

        ends = float(box.low[axis]), float(box.high[axis])
        return int(chebyshev_series(line, *ends, tolerance).coefficients.size)

    return max(along(through) for through in _lines(box, axis))


def _fit(function: Function, box: Box, counts: list[int]) -> FloatArray:
    """Coefficients of the tensor-product polynomial, shape `counts`."""
    grid = np.meshgrid(
        *(lobatto(count) if count > 1 else np.zeros(1) for count in counts), indexing="ij"
    )
    points = box.at(np.stack(grid, axis=-1)).reshape(-1, len(counts))
    result = function(points).reshape(counts)
    for axis in range(len(counts)):
        result = coefficients(result, axis)
    return result


def _spline(series: FloatArray, order: int) -> FloatArray:
    """B-spline coefficients of a Chebyshev series on uniform angles, `_FINER` times its length."""
    values = series
    for axis, count in enumerate(series.shape):
        if count > 1:
            fine = _FINER * (count - 1) + 1
            padded = np.moveaxis(values, axis, -1) * 0.5
            padded[..., 0] *= 2.0
            values = np.moveaxis(fft.dct(padded, type=1, n=fine, axis=-1), -1, axis)
    return np.asarray(ndimage.spline_filter(np.squeeze(values), order, mode="mirror"))


def _evaluate(box: Box, series: FloatArray, points: FloatArray, order: int) -> FloatArray:
    """Values of the series at points of its box, (count, axes) -> (count,)."""
    spline = _spline(series, order)
    extended = [axis for axis, count in enumerate(series.shape) if count > 1]
    if not extended:
        return np.full(len(points), float(series.ravel()[0]))
    steps = np.array(spline.shape)[:, None] - 1.0

    def chunk(start: int) -> FloatArray:
        angles = box.angles(points[start : start + _CHUNK])[extended]
        where = angles * steps
        values = ndimage.map_coordinates(spline, where, order=order, mode="mirror", prefilter=False)
        return np.asarray(values, np.float64)

    with ThreadPoolExecutor() as pool:  # both calls leave the interpreter lock
        return np.concatenate(list(pool.map(chunk, range(0, len(points), _CHUNK))))


def _interpolated(
    function: Function, box: Box, points: FloatArray, tolerance: float
) -> FloatArray | int:
    """Values at the points of a box, or the axis along which to halve it first."""
    axes = range(box.low.size)
    counts = [_count_along(function, box, axis, 0.25 * tolerance) for axis in axes]
    hardest = int(np.argmax(counts))
    if np.prod(counts) > min(_LARGEST, len(points) // 2):
        return hardest
    series = _fit(function, box, counts)
    values = _evaluate(box, series, points, order=3 if tolerance > 1e-7 else 5)
    check = np.linspace(0, len(points) - 1, _CHECKED).astype(np.intp)
    worst = np.max(np.abs(values[check] - function(points[check])))
    return values if worst <= tolerance else hardest


def interpolate(function: Function, points: FloatArray, tolerance: float) -> FloatArray:
    """`function` at many scattered points (count, axes), within about `tolerance`."""
    values = np.empty(len(points))
    todo: list[IndexArray] = [np.arange(len(points))]
    while todo:
        chosen = todo.pop()
        inside = points[chosen]
        if chosen.size < _FEWEST:
            values[chosen] = function(inside)
            continue
        box = Box(inside.min(axis=0), inside.max(axis=0))
        found = _interpolated(function, box, inside, tolerance)
        if isinstance(found, int):
            lower = inside[:, found] <= 0.5 * (box.low[found] + box.high[found])
            todo += [chosen[lower], chosen[~lower]]
        else:
            values[chosen] = found
    return values
