"""Whether the pictures of a capture show the same pixels: shifts between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from malus.scenes.core.arrays import Float32Array, Float64Array, FloatArray
from malus.scenes.polarisation import analyser

MOVED = 0.25
"""Pixels of shift between two pictures from which edges look polarised."""
_SURE = 4.0
"""Standard errors from which a shift is more than noise."""
_ALIKE = 0.5
"""Correlation of two pictures, shifted onto each other, from which they show the same thing."""
_FAINT = 0.002
"""Relative root mean square of details below which a picture has none."""
_EXPLAINED = 0.5
"""Share of the unlike details that may be left where a shift explains them."""
_OF_SHIFTS = 0.4
"""Share of the residual that shifts would make from which they are believed: still pictures with
noise of 0.6 % of their light have up to 0.42, nine in ten moved ones more."""
_STEPS = 8
_TILE = 384
"""Pixels a side that are compared."""
_HALF = 0.15
"""Pixels by which shifts may differ from the half pixel between sub-grids."""


class Shift(NamedTuple):
    """Pixels downwards and to the right by which a picture is moved against the first."""

    down: float
    right: float

    @property
    def length(self) -> float:
        """Pixels of the whole shift."""
        return float(np.hypot(self.down, self.right))


class Alignment(NamedTuple):
    """A shift, and the share of the unlike details that is left after it: 1 where none helps."""

    shift: Shift
    left_over: float


NOT_MOVED = Alignment(Shift(0.0, 0.0), 1.0)


def measure_shifts(pictures: Float32Array, angles_deg: Sequence[float]) -> tuple[Shift, ...]:
    """Shift of every picture (pictures, height, width, channels) against the first.

    A polariser changes how bright a part is, but not where its details are: so details are
    compared, relative to the light around them. Four pictures or more have then to fit a sinusoid
    as badly as if moved so: details of the polarisation look moved between still pictures. Where
    that shows nothing, as on strongly polarised objects, a picture is compared with the sinusoid
    through the others. Where a picture has no details, as a smooth gradient, or where noise would
    make as much of a shift, it is zero.

    Examples
    --------
    >>> y, x = np.mgrid[:48, :49]
    >>> waves = 2 + np.sin(x * 0.9) * np.cos(y * 0.7) + np.sin(0.6 * (x + y))
    >>> three = np.stack([waves[:, 1:], waves[:, :-1], waves[:, 1:]])[..., None]
    >>> [round(shift.right, 1) for shift in measure_shifts(three, (0.0, 45.0, 90.0))]
    [0.0, 1.0, 0.0]
    """
    tile = _richest_tile(_details(pictures[0].mean(axis=-1)))
    grey = np.stack([picture[tile].mean(axis=-1) for picture in pictures]).astype(np.float64)
    details = [_details(image) for image in grey]
    aligned = [_align(details[0], other) for other in details[1:]]
    shifts = [Shift(0.0, 0.0), *(alignment.shift for alignment in aligned)]
    if any(shift.length > MOVED for shift in shifts):
        if len(shifts) < 4 or _fit_as_if_moved(grey, angles_deg, shifts):
            return tuple(shifts)
        shifts = [Shift(0.0, 0.0) for _ in shifts]
    for index, shift in _moved_against_others(grey, angles_deg).items():
        shifts[index] = shift
    return tuple(shifts)


def _fit_as_if_moved(
    grey: Float64Array, angles_deg: Sequence[float], shifts: Sequence[Shift]
) -> bool:
    """Whether pictures fit the sinusoid better moved back, or as badly as such shifts make them."""
    from scipy.ndimage import shift as shifted

    matrix = analyser(angles_deg)
    inside = _inside(grey[0], _margin(np.abs(shifts).max(axis=0)))
    back = np.stack(
        [shifted(g, (-s.down, -s.right), order=3) for g, s in zip(grey, shifts, strict=True)]
    )

    def left(pictures: Float64Array) -> float:
        values = pictures[:, *inside].reshape(len(pictures), -1)
        return float(np.linalg.norm(values - matrix @ (np.linalg.pinv(matrix) @ values)))

    return left(grey) > min(left(back), _OF_SHIFTS * left(grey - back))


def _moved_against_others(grey: Float64Array, angles_deg: Sequence[float]) -> dict[int, Shift]:
    """Pictures that fit the sinusoid through the others only when they are moved, worst first."""
    shifts: dict[int, Shift] = {}
    left = list(range(len(grey)))
    while len(left) >= 4:
        matrix = analyser([angles_deg[i] for i in left])
        alignments: dict[int, Alignment] = {}
        for row, index in enumerate(left):
            others = [other for other in left if other != index]
            weights = matrix[row] @ np.linalg.pinv(np.delete(matrix, row, axis=0))
            predicted = np.tensordot(weights, grey[others], axes=1)
            alignments[index] = _align(_details(predicted), _details(grey[index]))
        worst = min(alignments, key=lambda index: alignments[index].left_over)
        alignment = alignments[worst]
        if alignment.left_over > _EXPLAINED or alignment.shift.length <= MOVED:
            break
        shifts[worst] = alignment.shift
        left.remove(worst)
    return shifts


def _details(grey: FloatArray) -> Float64Array:
    """Differences from the light around every pixel, divided by that light."""
    from scipy.ndimage import gaussian_filter

    width = max(1.0, min(4.0, min(grey.shape) / 12))
    margin = min(int(4 * width), min(grey.shape) - 1)
    # Reflected about the value at the border, a straight gradient goes on as it is.
    values = np.pad(grey.astype(np.float64), margin, mode="reflect", reflect_type="odd")
    fine = gaussian_filter(values, 0.7)  # a shift by parts of a pixel needs a smooth picture
    around = gaussian_filter(values, width)
    floor = 0.02 * float(np.abs(values).mean()) + 1e-30
    details = (fine - around) / (np.abs(around) + floor)
    # Once more, because what is left of a smooth curve is a smooth curve again.
    details -= gaussian_filter(details, width)
    return details[margin:-margin, margin:-margin]


def _richest_tile(details: Float64Array) -> tuple[slice, slice]:
    """The square with the most details, where a picture is larger than needs be."""
    rows, columns = (range(0, max(side - _TILE, 0) + 1, _TILE // 2) for side in details.shape)
    tiles = [(slice(row, row + _TILE), slice(c, c + _TILE)) for row in rows for c in columns]
    return max(tiles, key=lambda tile: float(np.minimum(np.square(details[tile]), 1.0).sum()))


def _align(first: Float64Array, other: Float64Array) -> Alignment:
    """The shift that lays one picture's details over another's; zero where there is none."""
    from skimage.registration import phase_cross_correlation

    if min(first.shape) < 8 or min(first.std(), other.std()) < _FAINT:
        return NOT_MOVED
    coarse = -phase_cross_correlation(first, other)[0].astype(np.float64)
    starts = [np.zeros(2), coarse] if np.hypot(*coarse) > 1 else [np.zeros(2)]
    tried = [_refine(first, other, start) for start in starts]
    offset, error, alike = max(tried, key=lambda result: result[2])
    still = _correlation(first, other, (2, 2))
    is_far = np.abs(offset).max() > min(first.shape) / 4
    if is_far or alike < max(_ALIKE, still) or np.hypot(*offset) < _SURE * np.hypot(*error):
        return NOT_MOVED
    # Shares of the details that stay unlike, after the shift and before it.
    left_over = np.sqrt((1 - min(alike, 1.0) ** 2) / max(1 - max(still, 0.0) ** 2, 1e-12))
    return Alignment(Shift(float(offset[0]), float(offset[1])), float(left_over))


def _refine(
    first: Float64Array, other: Float64Array, start: Float64Array
) -> tuple[Float64Array, Float64Array, float]:
    """A shift improved step by step from `start`, its standard errors, and the correlation then."""
    from scipy.ndimage import shift as shifted

    offset, error = start, np.full(2, np.inf)
    for _ in range(_STEPS):
        aligned = shifted(other, -offset, order=3, mode="nearest")
        change, error = _step(first, aligned, _margin(offset))
        offset = offset + change
        if np.hypot(*change) < 0.005 or np.abs(offset).max() > min(first.shape) / 3:
            break
    aligned = shifted(other, -offset, order=3, mode="nearest")
    return offset, error, _correlation(first, aligned, _margin(offset))


def _margin(offset: Float64Array) -> Sequence[int]:
    """Pixels at the border that a shift brings in from outside, and two more."""
    return [int(side) for side in np.ceil(np.abs(offset)) + 2]


def _step(
    first: Float64Array, aligned: Float64Array, margin: Sequence[int]
) -> tuple[Float64Array, Float64Array]:
    """Least-squares shift (down, right) between nearly aligned pictures, and standard errors.

    Source: Lucas and Kanade, 1981; the gain between the two is fitted with it.
    """
    down, right = np.gradient(first, axis=0), np.gradient(first, axis=1)
    inside = _inside(first, margin)
    columns = np.stack([-down[inside].ravel(), -right[inside].ravel(), first[inside].ravel()], -1)
    values = aligned[inside].ravel()
    normal = columns.T @ columns
    if np.linalg.cond(normal) > 1e10:
        return np.zeros(2), np.full(2, np.inf)
    inverse = np.linalg.inv(normal)
    solution = inverse @ (columns.T @ values)
    noise = values - columns @ solution
    gain = solution[2] if abs(solution[2]) > 1e-3 else 1.0
    # Neighbours share their noise, as both pictures are smoothed: a tenth of them are apart.
    variance = 10.0 * float(noise @ noise) / max(len(values) - 3, 1)
    errors = np.sqrt(np.diag(inverse)[:2] * variance) / abs(gain)
    return solution[:2] / gain, errors


def _correlation(first: Float64Array, other: Float64Array, margin: Sequence[int]) -> float:
    inside = _inside(first, margin)
    a, b = first[inside].ravel(), other[inside].ravel()
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / scale if scale > 0 else 0.0


def _inside(image: Float64Array, margin: Sequence[int]) -> tuple[slice, slice]:
    """All but a margin, of which at least four pixels a side are left."""
    rows, columns = (
        min(int(m), (side - 4) // 2) for m, side in zip(margin, image.shape, strict=True)
    )
    return slice(rows, image.shape[0] - rows), slice(columns, image.shape[1] - columns)


def is_sub_grids(shifts: Sequence[Shift]) -> bool:
    """Whether four pictures stand half a pixel apart, as the sub-grids of a polarisation camera.

    Examples
    --------
    >>> is_sub_grids([Shift(0, 0), Shift(0, 0.5), Shift(0.5, 0), Shift(0.5, 0.5)])
    True
    """
    if len(shifts) != 4:
        return False
    corners = {(round(2 * shift.down), round(2 * shift.right)) for shift in shifts}
    near = all(abs(part - round(2 * part) / 2) < _HALF for shift in shifts for part in shift)
    rows, columns = {c[0] for c in corners}, {c[1] for c in corners}
    apart = all(len(s) == 2 and max(s) - min(s) == 1 for s in (rows, columns))
    return near and apart and len(corners) == 4
