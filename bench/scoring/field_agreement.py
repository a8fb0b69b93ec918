"""Slope and rotation of an estimated against the true polarisation field, with standard errors.

Near a perfect method NMSE and skill move as the square of its error and are mostly noise. The
slope of the estimated on the true Stokes field is linear in the error: a degree of polarisation
that is 2 % too large makes it 2 % too large. All sums are products of two independent halves of
the samples, so that Monte Carlo noise does not bias them, and they come with the variance that
the noise gives them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

from malus.bench.scoring.metrics import LEAST_ERROR
from malus.scenes.core.arrays import Float64Array

ALONG, ACROSS, ERROR, ENERGY, TRIVIAL = range(5)
"""Indices of the totals of an `Agreement`."""


@dataclass(frozen=True)
class Agreement:
    """Sums over pixels and bands, divided by the squared peak, and their covariance from noise.

    Attributes
    ----------
    totals : (5,)
        Σ (ŝ − s)·s and Σ s × ŝ over the polarised parts (s1, s2); the squared error over polariser
        angles, weighted by cos⁴ of the angle between normal and view direction; Σ s·s, and
        the squared error of the trivial guess I(ϑ) = I/2, weighted likewise. Noise-corrected.
    covariance : (5, 5)
        Of the totals, from one draw of the noise a pixel; pixels are independent.
    count : int
        Pixels times bands.

    Examples
    --------
    A method that finds nine tenths of a noiseless field has a gain of 0.9:

    >>> import numpy as np
    >>> totals = np.array([-0.1, 0.0, 0.01, 1.0, 1.0])
    >>> round(Agreement(totals, np.zeros((5, 5)), count=4).gain[0], 12)
    0.9
    """

    totals: Float64Array
    covariance: Float64Array
    count: int

    def __add__(self, other: Self) -> Agreement:
        """Sums over the pixels of both, whose noises are independent."""
        return Agreement(
            self.totals + other.totals,
            self.covariance + other.covariance,
            self.count + other.count,
        )

    @property
    def gain(self) -> tuple[float, float]:
        """Slope of the estimated on the true field, and its standard error; 1 is perfect."""
        slope, error = self._ratio(ALONG, ENERGY)
        return 1.0 + slope, error

    @property
    def rotation(self) -> tuple[float, float]:
        """Part of the estimate that lies across the true field, and its standard error.

        Of a field turned by δ at equal strength it is sin 2δ, and its gain cos 2δ; positive where
        the estimate is turned anticlockwise. 0 is perfect.
        """
        return self._ratio(ACROSS, ENERGY)

    @property
    def signal(self) -> tuple[float, float]:
        """Root mean square of the true polarised intensity over the peak, and its error."""
        mean = self.totals[ENERGY] / max(self.count, 1)
        if not mean > 0.0:
            return 0.0, math.nan
        return math.sqrt(mean), self._error(ENERGY) / max(self.count, 1) / (2.0 * math.sqrt(mean))

    @property
    def facing_skill(self) -> tuple[float, float]:
        """Skill that weighs surfaces facing the camera most, and its standard error; 1 is perfect.

        Pixels weigh by cos⁴ of the angle between normal and view direction: those of the rim come
        and go with the samples, and where the error sits there, the plain skill jumps by 13 times
        the noise that the halves can show (measured: distant light, roughness 0.4).
        """
        ratio, error = self._ratio(ERROR, TRIVIAL)
        return 1.0 - ratio, error

    def _ratio(self, numerator: int, denominator: int) -> tuple[float, float]:
        """Ratio of two totals and its standard error, NaN where the denominator is rounding."""
        divisor = float(self.totals[denominator])
        if not divisor > LEAST_ERROR * self.count:
            return math.nan, math.nan
        ratio = float(self.totals[numerator]) / divisor
        covariance = self.covariance
        variance = (
            float(covariance[numerator, numerator])
            - 2.0 * ratio * float(covariance[numerator, denominator])
            + ratio * ratio * float(covariance[denominator, denominator])
        )
        # max(variance, 0) would turn NaN into 0, and the power of a huge ratio raises.
        return ratio, math.sqrt(0.0 if variance < 0.0 else variance) / divisor

    def _error(self, index: int) -> float:
        return math.sqrt(float(self.covariance[index, index]))
