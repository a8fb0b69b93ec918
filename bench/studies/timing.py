"""Timing for benchmarks: the seconds of one run, and median and spread of several."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Seconds(NamedTuple):
    """Seconds of one run, by the clock and of processor time."""

    clock: float
    processor: float


def timed(work: Callable[[], object]) -> Seconds:
    """Seconds that one call of `work` takes; freeing its result is not counted.

    Examples
    --------
    >>> timed(lambda: sum(range(10))).clock > 0
    True
    """
    started = Seconds(time.perf_counter(), time.process_time())
    result = work()
    ended = Seconds(time.perf_counter(), time.process_time())
    del result
    return Seconds(ended.clock - started.clock, ended.processor - started.processor)


def median_and_spread(
    work: Callable[[], object], repeats: int, units: float = 1.0
) -> tuple[float, float]:
    """Median seconds a unit of work and half their interquartile range, after one run to warm up.

    Parameters
    ----------
    work : function
        Called `repeats` + 1 times.
    units : float
        Number of units, values or megapixels for example, that one call computes.
    """
    work()
    seconds = [timed(work).clock / units for _ in range(repeats)]
    low, middle, high = np.quantile(seconds, [0.25, 0.5, 0.75])
    return float(middle), float(high - low) / 2
