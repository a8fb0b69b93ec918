"""How honest a method is about its own error: the stated deviation against the actual error."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from malus.bench.scoring.metric_value import MetricValue
from malus.bench.scoring.metrics import brightest
from malus.scenes.core.arrays import FloatArray

LIT = 0.01
"""Share of the peak below which light is too little for its ratio s1/s0 to be measured."""
_SURE = 1e-6
"""Smallest deviation that counts: rounding of single precision, lest a stated 0 divides."""


def calibration_values(
    image: FloatArray,
    true: FloatArray,
    estimated: FloatArray,
    deviation: FloatArray,
    draw: FloatArray | None = None,
) -> Iterator[MetricValue]:
    """Rows of the table from a stated standard deviation of s1/s0 and of s2/s0.

    Parameters
    ----------
    image, deviation : (pixels, bands)
        Total light, and the standard deviation that the method states.
    true, estimated : (2, pixels, bands)
        s1 and s2.
    draw : (2, pixels, bands), optional
        One draw of the noise of `true`: what it makes of `calibration` stands beside that.

    Notes
    -----
    `calibration` is the mean of the squared error over the stated variance, 1 where the method
    knows how well it does and more where it is too sure; `deviation_rank` is the rank correlation
    (Spearman) of the stated deviation with the actual error over pixels and bands. An image without
    light has neither.

    Examples
    --------
    >>> image, true = np.ones((3, 1)), np.zeros((2, 3, 1))
    >>> error = np.array([0.1, -0.2, 0.3])[:, None]
    >>> honest = calibration_values(image, true, np.stack([error, error]), np.abs(error))
    >>> [round(row.value, 9) for row in honest]
    [1.0, 1.0]
    """
    lit = image > LIT * brightest(image)
    if not lit.any():
        return
    stated = np.maximum(deviation[lit], _SURE).astype(np.float64)
    light = image[lit].astype(np.float64)
    error = (estimated[:, lit] - true[:, lit]) / light
    noise = 0.0 if draw is None else float(np.mean(np.square(draw[:, lit] / light / stated)))
    yield MetricValue("calibration", float(np.mean(np.square(error / stated))), noise)
    yield MetricValue("deviation_rank", _rank_correlation(stated, np.hypot(*error)))


def _rank_correlation(a: FloatArray, b: FloatArray) -> float:
    """Spearman's rank correlation; NaN where all values of one are equal."""
    from scipy.stats import rankdata

    ranks = [rankdata(values) - (values.size + 1) / 2 for values in (a, b)]
    spread = math.sqrt(float(np.vdot(ranks[0], ranks[0]) * np.vdot(ranks[1], ranks[1])))
    return float(np.vdot(*ranks)) / spread if spread > 0 else math.nan
