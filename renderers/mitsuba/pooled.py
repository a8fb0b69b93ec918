"""Standard errors of scenes whose light partly comes by rare paths.

A pixel that no rare bright path has reached is too dark, and its own samples underestimate its
error: in the mean, squared residuals are then far above squared errors, and where all samples of a
pixel are equal, its error would be 0. Some of the pixels around it were reached by such paths and
show the variance.
"""

from __future__ import annotations

import itertools

import numpy as np

from malus.scenes.core.arrays import AnyArray

OBJECT_WEIGHT = 0.1
"""Weight, in pixels, of the mean over the whole object: for pixels with no light around them."""


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
