"""Means over pixels as sums that can be added, so that parts of a run can be scored apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class PixelSums:
    """Count, sum and sum of squares of one number a pixel.

    Examples
    --------
    >>> whole = PixelSums.of(np.array([1.0, 2.0])) + PixelSums.of(np.array([6.0]))
    >>> whole.mean, round(whole.std, 3)
    (3.0, 2.16)
    """

    count: int = 0
    total: float = 0.0
    squares: float = 0.0

    @classmethod
    def of(cls, values: Image) -> Self:
        """Sums of an array of any shape, in float64."""
        values = np.asarray(values, dtype=np.float64)
        return cls(values.size, float(values.sum()), float(np.vdot(values, values)))

    def __add__(self, other: Self) -> PixelSums:
        """Sums over the pixels of both."""
        return PixelSums(
            self.count + other.count, self.total + other.total, self.squares + other.squares
        )

    @property
    def mean(self) -> float:
        """NaN without pixels."""
        return self.total / self.count if self.count else math.nan

    @property
    def mean_square(self) -> float:
        """NaN without pixels."""
        return self.squares / self.count if self.count else math.nan

    @property
    def rms(self) -> float:
        """Root of the mean square."""
        return math.sqrt(self.mean_square)

    @property
    def std(self) -> float:
        """Standard deviation over the pixels themselves, not of their mean."""
        # Rounding can leave a tiny negative variance where all pixels are equal.
        return math.sqrt(max(self.mean_square - self.mean**2, 0.0)) if self.count else math.nan


@dataclass(frozen=True)
class WeightedSum:
    """Sum of weights and of weighted values.

    Examples
    --------
    >>> WeightedSum.of(np.array([1.0, 4.0]), weights=np.array([2.0, 1.0])).mean
    2.0
    """

    weight: float = 0.0
    total: float = 0.0

    @classmethod
    def of(cls, values: Image, weights: Image) -> Self:
        """Sums of arrays of one shape, in float64."""
        weights = np.asarray(weights, dtype=np.float64)
        return cls(float(weights.sum()), float(np.vdot(weights, np.asarray(values, np.float64))))

    def __add__(self, other: Self) -> WeightedSum:
        """Sums over the pixels of both."""
        return WeightedSum(self.weight + other.weight, self.total + other.total)

    @property
    def mean(self) -> float:
        """NaN without weight."""
        return self.total / self.weight if self.weight > 0 else math.nan
