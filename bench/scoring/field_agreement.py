"""How an estimated polarisation field lies along and across the true one, and how sure that is.

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

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ALONG, ACROSS, ERROR, ENERGY, TRIVIAL = range(5)


@dataclass(frozen=True)
class Agreement:
    """Sums over pixels and bands, divided by the squared peak, and their covariance by noise.

    Attributes
    ----------
    totals : (5,)
        Σ (ŝ − s)·s and Σ s × ŝ over the polarised parts (s1, s2), Σ n_z⁴ of the squared error over
        polariser angles; Σ s·s, and the squared error of the trivial guess I(ϑ) = I/2.
        Noise-corrected.
    covariance : (5, 5)
        Of the totals, from one draw of the noise a pixel; pixels are independent.
    count : int
        Pixels times bands.

    Examples
    --------
    A method that finds nine tenths of a noiseless field has a gain of 0.9:

    >>> totals = np.array([-0.1, 0.0, 0.01, 1.0, 1.0])
    >>> round(Agreement(totals, np.zeros((5, 5)), count=4).gain[0], 12)
    0.9
    """

    totals: Floats
    covariance: Floats
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

        The sine of twice the mean error of the angle, times the gain; positive where the estimate
        is turned anticlockwise. 0 is perfect.
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
        """Skill of what faces the viewer, and its standard error; 1 is perfect.

        Pixels weigh by the fourth power of the zenith angle's cosine: those of the rim come and go
        with the samples, and where the error sits there, the plain skill jumps by 13 times the
        noise that the halves can show (measured: distant light, roughness 0.4).
        """
        part, error = self._ratio(ERROR, TRIVIAL)
        return 1.0 - part, error

    def _ratio(self, top: int, bottom: int) -> tuple[float, float]:
        """Quotient of two totals and its standard error, NaN where there is nothing below."""
        if not self.totals[bottom] > 0.0:
            return math.nan, math.nan
        below = float(self.totals[bottom])
        quotient = float(self.totals[top]) / below
        covariance = self.covariance
        variance = (
            float(covariance[top, top])
            - 2.0 * quotient * float(covariance[top, bottom])
            + quotient**2 * float(covariance[bottom, bottom])
        )
        # NaN stays: the greater of it and zero would be zero.
        return quotient, math.sqrt(0.0 if variance < 0.0 else variance) / below

    def _error(self, index: int) -> float:
        return math.sqrt(float(self.covariance[index, index]))
