"""Standard errors of scenes whose light partly comes by rare paths.

A pixel that has not met a rare bright path is too dark and, judged by its own samples, too sure of
it: squares of residuals over errors are then far above 1 in the mean, without bound where a
pixel's samples are all equal. What is rare in a pixel is less rare in its neighbourhood, where
the same paths carry the variance.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

OBJECT_WEIGHT = 0.1
"""What the mean over the whole object counts, in pixels: it is there for windows without light."""


def pooled(variance: NDArray[Any], owner: NDArray[np.integer[Any]]) -> NDArray[Any]:
    """Variances as the mean over the 3 by 3 pixels about each that see the same object.

    The mean over all pixels of that object is added with a small weight, so that no variance is
    zero where others of its object are not.

    Parameters
    ----------
    variance : (height, width, bands, 3)
        Each pixel's own, from its own samples.
    owner : (height, width)
        Number of the object that a pixel sees; where it is negative, the pixel's own is kept.

    Examples
    --------
    >>> seen = np.array([[0, 0, 1], [0, 0, -1]])
    >>> pooled(np.array([[4.0, 0, 7], [0, 0, 5]])[..., None, None], seen)[..., 0, 0].tolist()
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
        seen = owner == index
        total[seen] += OBJECT_WEIGHT * variance[seen].mean(axis=0, dtype=np.float64)
    mean = total / (count + OBJECT_WEIGHT)
    return np.where(own >= 0, mean, variance).astype(variance.dtype)
