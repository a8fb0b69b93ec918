"""Interpolate smooth functions of a few variables at many scattered points.

The function is sampled along lines through the box around the points, which shows how many
Chebyshev coefficients each axis needs; samples on a grid give these coefficients; some of the
points check the result. Where the grid would need more samples than there are points to compute,
the box is halved along the axis that needs most coefficients. In boxes with few points the function
is evaluated without any interpolation.

A Chebyshev series in x is a cosine series in arccos x. Sampled more finely there, it becomes a
cubic spline with mirrored ends, which costs 64 multiplications a point, whatever the degree.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from typing import NamedTuple

import numpy as np

from malus.reconstruct.facets.chebyshev import chebyshev_series, coefficients, lobatto
from malus.scenes.core.arrays import Float64Array, IndexArray

Function = Callable[[Float64Array], Float64Array]
"""Values (count,) at points (count, axes)."""

_FEWEST = 1000  # points below which probing a box costs more than it saves
_LARGEST = 20_000  # samples in one grid, beyond which two halves are cheaper to evaluate
_CHECKED = 32  # points at which a fit is compared with the function
_FINER = 4  # spline intervals for every coefficient: at 3 the spline's error shows, at 6 time does
_CHUNK = 1 << 16  # points that one thread evaluates at a time


class Box(NamedTuple):
    """A box around points; both bounds have shape (axes,)."""

    low: Float64Array
    high: Float64Array

    def angles(self, points: Float64Array) -> Float64Array:
        """arccos of the points' coordinates on [−1, 1] in units of π, (axes, count)."""
        width = np.where(self.high > self.low, self.high - self.low, 1.0)
        unit = (2.0 * points - (self.high + self.low)) / width
        return np.asarray(np.arccos(np.clip(unit, -1.0, 1.0)).T / np.pi)

    def points(self, unit: Float64Array) -> Float64Array:
        """Points (..., axes) from coordinates (..., axes) on [−1, 1]."""
        points = 0.5 * (self.high + self.low) + 0.5 * (self.high - self.low) * unit
        return np.asarray(np.clip(points, self.low, self.high))


def _lines(box: Box, axis: int) -> list[Float64Array]:
    """Points (axes,) that lines along `axis` pass through: the centre, and near the other edges."""
    others = [
        (0.0,) if index == axis or box.high[index] <= box.low[index] else (-0.9, 0.9)
        for index in range(box.low.size)
    ]
    corners = [box.points(np.array(unit)) for unit in product(*others)]
    return [box.points(np.zeros(box.low.size)), *corners] if len(corners) > 1 else corners


def _count_along(function: Function, box: Box, axis: int, tolerance: float) -> int:
    """Number of coefficients along an axis, the largest of several lines."""
    if box.high[axis] <= box.low[axis]:
        return 1

    def count(point: Float64Array) -> int:
        def on_line(x: Float64Array) -> Float64Array:
            points = np.tile(point, (x.size, 1))
            points[:, axis] = x
            return function(points)

        ends = float(box.low[axis]), float(box.high[axis])
        return int(chebyshev_series(on_line, *ends, tolerance).coefficients.size)

    return max(count(point) for point in _lines(box, axis))


def _fit(function: Function, box: Box, counts: list[int]) -> Float64Array:
    """Coefficients of the tensor-product polynomial, shape `counts`."""
    grid = np.meshgrid(
        *(lobatto(count) if count > 1 else np.zeros(1) for count in counts), indexing="ij"
    )
    points = box.points(np.stack(grid, axis=-1)).reshape(-1, len(counts))
    result = function(points).reshape(counts)
    for axis in range(len(counts)):
        result = coefficients(result, axis)
    return result


def _spline(series: Float64Array, order: int) -> Float64Array:
    """B-spline coefficients of a Chebyshev series on uniform angles, `_FINER` times its length."""
    from scipy import fft, ndimage

    values = series
    for axis, count in enumerate(series.shape):
        if count > 1:
            fine = _FINER * (count - 1) + 1
            padded = np.moveaxis(values, axis, -1) * 0.5
            padded[..., 0] *= 2.0
            values = np.moveaxis(fft.dct(padded, type=1, n=fine, axis=-1), -1, axis)
    return np.asarray(ndimage.spline_filter(np.squeeze(values), order, mode="mirror"))


def _evaluate(box: Box, series: Float64Array, points: Float64Array, order: int) -> Float64Array:
    """Values of the series at points of its box, (count, axes) -> (count,)."""
    from scipy import ndimage

    spline = _spline(series, order)
    varying = [axis for axis, count in enumerate(series.shape) if count > 1]
    if not varying:
        return np.full(len(points), float(series.ravel()[0]))
    steps = np.array(spline.shape)[:, None] - 1.0

    def chunk(start: int) -> Float64Array:
        angles = box.angles(points[start : start + _CHUNK])[varying]
        values = ndimage.map_coordinates(
            spline, angles * steps, order=order, mode="mirror", prefilter=False
        )
        return np.asarray(values, np.float64)

    with ThreadPoolExecutor() as pool:  # arccos and map_coordinates release the interpreter's lock
        return np.concatenate(list(pool.map(chunk, range(0, len(points), _CHUNK))))


def _interpolated(
    function: Function, box: Box, points: Float64Array, tolerance: float
) -> Float64Array | int:
    """Values (count,) at the points of a box, or the axis along which to halve it first."""
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


def interpolate(function: Function, points: Float64Array, tolerance: float) -> Float64Array:
    """Values (count,) of `function` at scattered points (count, axes), within about `tolerance`."""
    values = np.empty(len(points))
    remaining: list[IndexArray] = [np.arange(len(points))]
    while remaining:
        chosen = remaining.pop()
        inside = points[chosen]
        if chosen.size < _FEWEST:
            values[chosen] = function(inside)
            continue
        box = Box(inside.min(axis=0), inside.max(axis=0))
        result = _interpolated(function, box, inside, tolerance)
        if isinstance(result, int):
            lower = inside[:, result] <= 0.5 * (box.low[result] + box.high[result])
            remaining += [chosen[lower], chosen[~lower]]
        else:
            values[chosen] = result
    return values
