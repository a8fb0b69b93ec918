"""Differences between runs that rendered the same scenes with other random numbers.

Another seed or another number of samples changes the noise of all scenes together: they share
their random numbers. How alike the changes are from scene to scene then tells nothing of how large
chance makes their mean. Of `gain`, `rotation` and `facing_skill` every scene tells a standard
error; NMSE, skill and the metrics made of images have none.
"""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from malus.reports.tables.rows import overall_rows
from malus.scenes.core.arrays import BoolArray, Float64Array

TOLERANCES = {"gain": 0.005, "rotation": 0.005, "facing_skill": 0.01}
"""Metrics whose standard error is known, and the change of each that no run is asked about. It
stands for noise, too, that halves of the samples do not show: for a perfect method, whose measured
error is nearly nothing."""

HIDDEN_NOISE = 1.6
"""Factor on standard errors measured from halves of the samples. The halves share the pixels'
mean normals and the mask, whose noise they do not show: over 24 seeds the spread of gains was up
to 1.6 times the measured error (distant light, roughness 0.4), usually 0.7 to 1.2 times. At 16²
pixels and 16 samples it was up to 3.9 times; tolerances take that up: 86 gates of other seeds
raised no false alarm."""

SAME_SIGNAL = 1e-5
"""Relative difference of true polarised intensities up to which renders are the same images."""


def signals(table: pd.DataFrame) -> pd.Series[float]:
    """True polarised intensity by method and scene; empty of results that do not tell it."""
    rows = overall_rows(table, "signal")
    values = rows.set_index(["method", "scene"])["value"].astype(float)
    return values[~values.index.duplicated()]


def same_images(before: pd.Series[float], after: pd.Series[float]) -> bool:
    """Whether the scenes of two runs, in one order, have the same images, by their signals.

    Where a run does not tell them, as of real captures, they are taken for the same.

    Examples
    --------
    >>> same_images(pd.Series([0.1, 0.2]), pd.Series([0.1, 0.201]))
    False
    """
    a, b = before.to_numpy(np.float64), after.to_numpy(np.float64)
    untold: BoolArray = np.isnan(a) | np.isnan(b)
    return bool((untold | np.isclose(a, b, rtol=SAME_SIGNAL, atol=0.0)).all())


def weighted_means(values: Float64Array, signal: Float64Array) -> Float64Array:
    """Means of rows (rows, scenes) over scenes, weighted by true polarised energy; NaN without.

    The mean of gains is then the slope over the pixels of all scenes.

    Examples
    --------
    >>> weighted_means(np.array([[0.5, 1.0]]), np.array([1.0, 3.0])).round(9).tolist()
    [0.95]
    """
    energy = signal**2
    with np.errstate(invalid="ignore"):
        return np.asarray(values @ (energy / energy.sum()))


def noise_width(metric: str, before: float, after: float, quantile: float) -> float:
    """Largest change of a pooled metric that noise and tolerance explain.

    Parameters
    ----------
    metric : one of `TOLERANCES`
    before, after : float
        Means of the scenes' standard errors, added as they stand: their errors need not cancel.
    quantile : float
        Of the standard normal distribution, two-sided.
    """
    return TOLERANCES[metric] + quantile * HIDDEN_NOISE * math.hypot(before, after)
