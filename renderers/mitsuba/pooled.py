"""Standard errors of pixels to which light comes by few of their samples.

A pixel that no rare bright path has reached is too dark, and its own samples underestimate its
error: in the mean, squared residuals are then far above squared errors, and where all samples of a
pixel are equal, its error would be 0. Some of the pixels around it were reached by such paths and
show the variance. Of light along paths any pixel may lack some; a lamp is rarely met where most of
it is below the horizon or hidden, and there few samples of a pixel are lit.
"""

from __future__ import annotations

import itertools

import numpy as np

from malus.scenes.core.arrays import AnyArray

OBJECT_WEIGHT = 0.1
"""Weight, in pixels, of the mean over the whole object: for pixels with no light around them."""

ENOUGH = 10.0
"""Least number of lit samples, of equal brightness, whose spread is taken for a pixel's own."""
LEAST_SHARE = 0.125
"""Or this share of all samples: of two or four, chance alone would choose the pixels to pool."""


def pooled(variance: AnyArray, owner: AnyArray) -> AnyArray:
    """Mean variance of the 3 by 3 pixels around each that show the same object.

    The mean over all pixels of that object is added with a small weight, so that no variance is
    zero where others of its object are not.

    Parameters
    ----------
    variance : (height, width, bands, 3)
        Variance from each pixel's own samples.
    owner : (height, width)
        Number of the object in a pixel; where it is negative, the pixel's own variance is kept.

    Examples
    --------
    >>> owner = np.array([[0, 0, 1], [0, 0, -1]])
    >>> pooled(np.array([[4.0, 0, 7], [0, 0, 5]])[..., None, None], owner)[..., 0, 0].tolist()
    [[1.0, 1.0, 7.0], [1.0, 1.0, 5.0]]
    """
    height, width = owner.shape
    own = owner[..., None, None]
    around = np.pad(variance, [(1, 1), (1, 1), (0, 0), (0, 0)])
    owners = np.pad(own, [(1, 1), (1, 1), (0, 0), (0, 0)], constant_values=-1)
    total, count = np.zeros(variance.shape), np.zeros(own.shape)
    for row, column in itertools.product(range(3), repeat=2):
        there = slice(row, row + height), slice(column, column + width)
        same = owners[there] == own
        total += np.where(same, around[there], 0)
        count += same
    for index in np.unique(owner[owner >= 0]):
        on_object = owner == index
        total[on_object] += OBJECT_WEIGHT * variance[on_object].mean(axis=0, dtype=np.float64)
    mean = total / (count + OBJECT_WEIGHT)
    return np.where(own >= 0, mean, variance).astype(variance.dtype)


def pooled_where_rare(variance: AnyArray, s0: AnyArray, owner: AnyArray, samples: int) -> AnyArray:
    """As `pooled`, without the mean over the object, where few samples are lit.

    If k of many samples are lit, equally bright, the squared mean is k times its variance. What is
    dark among dark pixels keeps an error of 0: the lamp is not to be seen from there.

    Parameters
    ----------
    variance : (height, width, bands, 3)
        Variance of the mean of each pixel's own samples.
    s0 : (height, width, bands)
        These means.
    owner : (height, width)
        As for `pooled`.
    samples : int
        Samples a pixel.

    Examples
    --------
    >>> variance = np.array([[0.0, 0.0, 9.0, 1.0]])[..., None, None]
    >>> s0, owner = np.array([[0.0, 0.0, 5.0, 4.0]])[..., None], np.zeros((1, 4), int)
    >>> pooled_where_rare(variance, s0, owner, samples=64)[0, :, 0, 0].round(3).tolist()
    [0.0, 3.0, 3.333, 1.0]
    """
    enough = min(ENOUGH, LEAST_SHARE * samples)
    rare = np.square(s0) <= enough * variance[..., 0]  # squares may be too small for both sides
    rows, columns = np.nonzero(rare.any(axis=-1) & (owner >= 0))
    around = np.pad(variance, [(1, 1), (1, 1), (0, 0), (0, 0)])
    owners = np.pad(owner, 1, constant_values=-1)
    total, count = np.zeros((len(rows), *variance.shape[2:])), np.zeros((len(rows), 1, 1))
    for row, column in itertools.product(range(3), repeat=2):
        same = (owners[rows + row, columns + column] == owner[rows, columns])[:, None, None]
        total += np.where(same, around[rows + row, columns + column], 0)
        count += same
    result, own = variance.copy(), variance[rows, columns]
    result[rows, columns] = np.where(rare[rows, columns][..., None], total / count, own)
    return result
