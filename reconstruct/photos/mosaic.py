"""Frames of polarisation cameras: a polariser in front of every pixel, four angles in each 2 x 2.

Colour cameras have a colour filter over every such square too, four squares making one of Bayer's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from malus.scenes.core.arrays import AnyArray, BoolArray, Float32Array, Float64Array
from malus.scenes.core.errors import InputError

BAYER_ORDERS = ("rggb", "bggr", "grbg", "gbrg")
_RADIUS = 3
"""Pixels on either side over which a polariser's picture is taken for linear in the guide."""
_ROWS, _OVERLAP = 256, 16
"""Rows that are worked on at a time, and rows beside them that they depend on."""
_REACH = 2
"""Pixels from which a value comes: a sample beside it, of which the guide there is taken away."""
_REACH_OF_COLOURS = 4
"""And those of another colour: two pixels of one polariser, which are two apart."""
_LEAST_FOR_COLOURS = 64
"""Pixels of a side from which what colours do to the squares stands out of a scene's texture."""
_COLOURED = 0.05
"""Difference of the squares of one frame from which it is a colour camera's: in a real frame of a
grey camera it is below 0.01 %, in white noise of 64 x 64 pixels up to 4 %."""
_SIGNIFICANT = 6.0
"""Standard errors from which it is: four places of a dark frame seldom lie 4 apart by chance."""
_NOISE = 1e-4
"""Share of the brightest light below which a difference in the guide is no structure."""


def check_mosaic(mosaic: Sequence[float], bayer: str | None) -> None:
    """Refuse what is no mosaic: not four angles, or an unknown order of colours.

    Raises
    ------
    InputError
        With what is wrong.
    """
    listed = ", ".join(f"{angle:g}" for angle in mosaic)
    if len(mosaic) != 4:
        expected = "the four angles of a 2 x 2 square, row by row, such as 90,45,135,0"
        raise InputError("mosaic", expected, listed or "none", "see the camera's data sheet")
    if bayer is not None and bayer not in BAYER_ORDERS:
        raise InputError("bayer", f"one of {', '.join(BAYER_ORDERS)}", bayer, "choose one of them")


def check_frame(path: Path, frame: Float32Array, bayer: str | None) -> None:
    """Refuse frames (height, width) that are too small for a mosaic. Raises InputError."""
    least = 4 if bayer is None else 12
    if min(frame.shape) < least:
        size = f"{frame.shape[1]} x {frame.shape[0]}"
        expected = f"a frame of {least} x {least} pixels or more"
        raise InputError(str(path), expected, size, "give the frame as the sensor wrote it")


def colour_hints(frame: Float32Array, bayer: str | None) -> list[str]:
    """Hints at a colour camera's frame (height, width) read as grey, and at the wrong diagonal.

    Examples
    --------
    >>> y, x = np.mgrid[:64, :64] // 2
    >>> frame = np.where((y + x) % 2 == 1, 1.0, 0.5).astype(np.float32)  # green, red and blue
    >>> [len(colour_hints(frame, order)) for order in (None, "rggb")]
    [1, 0]
    """
    if min(frame.shape) < _LEAST_FOR_COLOURS:
        return []
    height, width = (length // 4 * 4 for length in frame.shape)
    blocks = frame[:height, :width].reshape(height // 2, 2, width // 2, 2)
    squares = blocks.mean(axis=(1, 3), dtype=np.float64)
    if bayer is None:
        step = _step_of_colours(squares)
        return [_IS_COLOURED.format(step)] if step > _COLOURED else []
    falling, rising = (
        float(np.abs(one - other).mean()) / max(float(squares.mean()), 1e-30)
        for one, other in (
            (squares[::2, ::2], squares[1::2, 1::2]),
            (squares[::2, 1::2], squares[1::2, ::2]),
        )
    )
    is_rising = bayer in ("rggb", "bggr")
    greens, others = (rising, falling) if is_rising else (falling, rising)
    if greens < max(_COLOURED, 2 * others):
        return []
    right = "grbg or gbrg" if is_rising else "rggb or bggr"
    return [_IS_OTHER_DIAGONAL.format(bayer, greens, others, right)]


_IS_COLOURED = (
    "squares of 2 x 2 pixels differ in turn by {:.0%}, as behind the filters of a colour camera: "
    "give the order of its colours as `bayer`"
)
_IS_OTHER_DIAGONAL = (
    "what `bayer` {} calls green differs by {:.0%}, and its red and blue by {:.0%}: the other "
    "diagonal looks green, as in {}"
)


def _step_of_colours(squares: Float64Array) -> float:
    """How far squares of 2 x 2 pixels differ by their place in four, over their mean light.

    From those around each; 0 where noise and texture alone may have made it.
    """
    from scipy.ndimage import correlate

    detail = squares - correlate(squares, np.outer([1, 2, 1], [1, 2, 1]) / 16, mode="mirror")
    height, width = (length // 2 for length in squares.shape)
    by_place = detail.reshape(height, 2, width, 2).mean(axis=(0, 2))
    step, error = float(np.ptp(by_place)), float(detail.std()) / math.sqrt(height * width)
    return step / max(float(squares.mean()), 1e-30) if step > _SIGNIFICANT * error else 0.0


def demosaic(frame: Float32Array, bayer: str | None = None) -> Float32Array:
    """The frame's four pictures (4, height, width, 1 or 3) through one polariser angle each.

    Residual interpolation: every picture is taken for a linear function of an unpolarised guide in
    each small window, and only what that leaves is interpolated. The guide is the mean of 2 x 2
    pixels, in which all four angles are, from the side where it changes least: edges stay sharp and
    do not look polarised, as they do after bilinear interpolation.

    Parameters
    ----------
    frame : (height, width) linear light; the pictures are in the order of a 2 x 2 square, by rows
    bayer : 'rggb', 'bggr', 'grbg' or 'gbrg', colours of the 2 x 2 squares, row by row

    Source: Morimatsu, Monno, Tanaka and Okutomi, "Monochrome and color polarization demosaicking
    using edge-aware residual interpolation", ICIP 2020; the guide is a simpler one. The colours of
    one angle are interpolated first, after Malvar, He and Cutler, ICASSP 2004.

    Examples
    --------
    >>> y, x = np.mgrid[:8, :8]
    >>> frame = np.where(y % 2 == 0, 1.0, 3.0).astype(np.float32)
    >>> demosaic(frame)[:, 3, 3, 0].tolist()
    [1.0, 1.0, 3.0, 3.0]
    """
    if bayer is None:
        return demosaic_grey(frame)[..., None]
    height, width = frame.shape
    result = np.empty((4, height, width, 3), dtype=np.float32)
    coloured = np.empty((height, width, 3), dtype=np.float32)
    for row in (0, 1):
        for column in (0, 1):
            coloured[row::2, column::2] = demosaic_bayer(frame[row::2, column::2], bayer)
    for channel in range(3):
        result[..., channel] = demosaic_grey(coloured[..., channel])
    return result


def demosaic_grey(frame: Float32Array) -> Float32Array:
    """The four pictures (4, height, width) of a frame (height, width) without colour filters."""
    frame = np.asarray(frame, dtype=np.float32)
    floor = _NOISE * max(float(np.abs(frame).max()), 1e-30)
    result = np.empty((4, *frame.shape), dtype=np.float32)
    for first in range(0, len(frame), _ROWS):
        # Strips overlap by more than the windows reach, and begin at an even row.
        above, below = min(first, _OVERLAP), _ROWS + _OVERLAP
        strip = frame[first - above : first + below]
        inner = np.s_[above : above + _ROWS]
        guide = intensity_guide(strip, floor)
        for index in range(4):
            row, column = divmod(index, 2)
            samples = np.zeros_like(strip)
            samples[row::2, column::2] = 1.0
            least = max(floor**2, float(np.finfo(np.float32).tiny))  # of a dark frame
            picture = _residual_interpolation(strip, samples, guide, least)
            result[index, first : first + _ROWS] = picture[inner]
    return result


def intensity_guide(frame: Float32Array, floor: float) -> Float32Array:
    """Mean of all four angles at every pixel (height, width), sharp at edges.

    Each of the four 2 x 2 squares around a pixel holds every angle once; those in which the mean
    changes least count most, because they do not lie across an edge; below `floor` it is even.
    """
    padded = np.pad(frame, 2, mode="reflect")  # by two, which keeps the angles in their places
    squares = 0.25 * (padded[:-1, :-1] + padded[1:, :-1] + padded[:-1, 1:] + padded[1:, 1:])
    gradient = np.abs(np.gradient(squares, axis=0)) + np.abs(np.gradient(squares, axis=1))
    weights = (floor / (gradient + np.float32(floor))) ** 4
    height, width = frame.shape
    total = np.zeros_like(frame)
    total_weight = np.zeros_like(frame)
    for dy in (1, 2):
        for dx in (1, 2):
            part = np.s_[dy : dy + height, dx : dx + width]
            total += weights[part] * squares[part]
            total_weight += weights[part]
    guide = total / np.maximum(total_weight, np.finfo(np.float32).tiny)
    return np.asarray(guide, dtype=np.float32)


def _residual_interpolation(
    frame: Float32Array, samples: Float32Array, guide: Float32Array, floor: float
) -> Float32Array:
    """A picture that is known where `samples` is 1, by its linear relation to the guide."""
    from scipy.ndimage import maximum_filter, minimum_filter

    share = _window_mean(samples)
    mean_guide = _window_mean(samples * guide) / share
    mean_value = _window_mean(samples * frame) / share
    variance = _window_mean(samples * guide**2) / share - mean_guide**2
    covariance = _window_mean(samples * guide * frame) / share - mean_guide * mean_value
    slope = covariance / (np.maximum(variance, 0) + np.float32(floor))
    estimate = _window_mean(slope) * guide + _window_mean(mean_value - slope * mean_guide)
    estimate += bilinear((frame - estimate) * samples, samples)
    # No value leaves the range of those that were measured around it.
    side = 2 * _RADIUS + 1
    lowest = minimum_filter(np.where(samples > 0, frame, np.inf), side)
    highest = maximum_filter(np.where(samples > 0, frame, -np.inf), side)
    return np.clip(estimate, lowest, highest)


def _window_mean(values: AnyArray) -> AnyArray:
    from scipy.ndimage import uniform_filter

    return uniform_filter(values, 2 * _RADIUS + 1, mode="reflect")


def bilinear(values: AnyArray, samples: AnyArray) -> AnyArray:
    """Bilinear interpolation (height, width) of values on a grid of every other pixel.

    `samples` is 1 on that grid and 0 elsewhere, where the values are 0 too; beyond the outermost
    samples the nearest hold.
    """
    from scipy.ndimage import correlate

    kernel = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]], dtype=np.float32) / 4
    weights = correlate(samples, kernel, mode="constant")
    return correlate(values, kernel, mode="constant") / weights


def demosaic_bayer(frame: Float32Array, order: str) -> Float32Array:
    """RGB (height, width, 3) of a frame behind Bayer's filters, by gradient-corrected weights.

    Source: Malvar, He and Cutler, "High-quality linear interpolation for demosaicing of
    Bayer-patterned color images", ICASSP 2004: what a colour's own pixels lack of a straight line
    is added to the others.
    """
    from scipy.ndimage import correlate

    cross = np.array([[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1],
                      [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]], np.float32) / 8  # fmt: skip
    along = np.array([[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1],
                      [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]], np.float32) / 8  # fmt: skip
    diagonal = np.array([[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5],
                         [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]], np.float32) / 8  # fmt: skip
    places = {letter: divmod(order.index(letter), 2) for letter in "rb"}
    crossed, opposite = (correlate(frame, k, mode="mirror") for k in (cross, diagonal))
    in_row, in_column = (correlate(frame, k, mode="mirror") for k in (along, along.T))
    result = np.repeat(frame[..., None], 3, axis=-1)
    for channel, letter in ((0, "r"), (2, "b")):
        row, column = places[letter]
        result[row::2, column::2, 1] = crossed[row::2, column::2]
        # Green pixels have this colour's neighbours in their row, or in their column.
        result[row::2, 1 - column :: 2, channel] = in_row[row::2, 1 - column :: 2]
        result[1 - row :: 2, column::2, channel] = in_column[1 - row :: 2, column::2]
        result[1 - row :: 2, 1 - column :: 2, channel] = opposite[1 - row :: 2, 1 - column :: 2]
    return result


def spread_over_neighbours(clipped: BoolArray, bayer: str | None) -> BoolArray:
    """Pixels whose interpolated values come from clipped ones, at most `_REACH` away.

    What is left of a clipped pixel beyond that comes through the fits in windows, which it shares
    with many others.
    """
    from scipy.ndimage import maximum_filter

    reach = _REACH if bayer is None else _REACH + _REACH_OF_COLOURS
    return np.asarray(maximum_filter(clipped, 2 * reach + 1))
