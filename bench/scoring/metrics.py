"""Scores as functions of sums over pixels that can be added.

The error through a polariser is linear in the Stokes difference Δs, so that its mean square over
pixels, and over any set of angles, is a quadratic form in the second moments Σ Δs Δsᵀ of a band:
no image per angle is ever made.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from malus.renderers.truth import Truth
from malus.scenes.polarisation import PAPER_ANGLES_DEG, angle_weights

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


Floats = NDArray[np.float64]

SIGNIFICANCE = 10.0
"""Standard deviations by which the trivial guess must rise above the noise to have a skill: the
skill then carries an error of at most about a tenth."""

_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


@dataclass(frozen=True)
class Residuals:
    """Second moments of Stokes differences, summed over pixels.

    Attributes
    ----------
    moments : (bands, 3, 3)
        Σ Δs Δsᵀ over pixels, divided by the squared peak of the unpolarised image.
    pixels : int
    """

    moments: Floats
    pixels: int

    def __add__(self, other: Self) -> Residuals:
        """Sums over the pixels of both."""
        return Residuals(self.moments + other.moments, self.pixels + other.pixels)

    @classmethod
    def of(cls, difference: Image, peak: float) -> Residuals:
        """Moments of Stokes differences (pixels, bands, 3) that are divided by `peak`."""
        scaled = difference.astype(np.float64) / peak
        moments = np.einsum("pbi,pbj->bij", scaled, scaled, optimize=True)
        return cls(moments, len(difference))

    @classmethod
    def of_products(cls, products: Floats, peak: float, pixels: int) -> Residuals:
        """From the six distinct products (00 01 02 11 12 22, bands) of `pixel_kernels`."""
        return cls(products.T[:, _SYMMETRIC] / peak**2, pixels)

    def nmse(self, angles_deg: tuple[float, ...] = PAPER_ANGLES_DEG) -> float:
        """Normalised mean squared error over pixels, bands and polariser angles.

        Examples
        --------
        >>> one = Residuals.of(np.array([[[0.2, 0.0, 0.0]]]), peak=1.0)
        >>> round(one.nmse(), 12)
        0.01
        """
        return float(nmse_by([self], (angles_deg,)).mean())


def nmse_by(parts: Sequence[Residuals], angle_sets: tuple[tuple[float, ...], ...]) -> Floats:
    """NMSE of residuals of the same pixels, for sets of angles and every band apart.

    Returns
    -------
    (parts, sets, bands) array; NaN without pixels.
    """
    pixels = parts[0].pixels
    moments = np.stack([part.moments.reshape(-1, 9).T for part in parts])
    if pixels == 0:
        return np.full((len(parts), len(angle_sets), moments.shape[2]), np.nan)
    return np.asarray(_forms(angle_sets) @ moments / pixels)


@functools.cache
def _forms(angle_sets: tuple[tuple[float, ...], ...]) -> Floats:
    return np.stack([angle_weights(angles).ravel() for angles in angle_sets])


@dataclass(frozen=True)
class Error:
    """A normalised mean squared error and the part of it that Monte Carlo noise made."""

    nmse: float
    noise: float

    @property
    def bias(self) -> float:
        """What is left without the noise; unbiased, so that it can be negative by chance."""
        return self.nmse - self.noise


def skill(method: Error, trivial: Error, pixels: int) -> float:
    """1 − NMSE / NMSE of the trivial guess, noise subtracted from both; NaN without a signal.

    Parameters
    ----------
    method, trivial : Error
        Of a method and of the guess I(ϑ) = I/2 on the same pixels.
    pixels : int
        Number of pixels; sets how well the noise itself is known.

    Examples
    --------
    >>> skill(Error(0.002, 0.001), Error(0.011, 0.001), pixels=1000)
    0.9
    """
    return float(
        skills(np.array([method.bias]), np.array([trivial.bias]), trivial.noise, pixels)[0]
    )


def skills(
    method_bias: Floats,
    trivial_bias: Floats,
    trivial_noise: Floats | float,
    pixels: NDArray[np.intp] | int,
) -> Floats:
    """The same of many pairs of errors: for their biases, and the noise of the guess."""
    # The noise is a mean of about `pixels` squares: its own relative deviation is √(2/pixels).
    spread = trivial_noise * np.sqrt(2.0 / np.maximum(pixels, 1))
    told = (trivial_bias > SIGNIFICANCE * spread) & (trivial_bias > 0.0)
    share = np.divide(method_bias, trivial_bias, out=np.full(told.shape, np.nan), where=told)
    return 1.0 - share


def cos_zenith(truth: Truth) -> Floats:
    """Cosine of the angle between normal and direction to the camera, (pixels of the mask,)."""
    cosine = truth.normals[..., 2]
    if truth.view_direction is not None:
        cosine = np.einsum("hwi,hwi->hw", truth.normals, truth.view_direction)
    return np.clip(cosine[truth.mask], 0.0, 1.0, dtype=np.float64)


def peak(truth: Truth) -> float:
    """Largest value of the unpolarised image over mask and bands; 1 where all is dark."""
    return brightest(truth.image[truth.mask])


def brightest(lit: Image) -> float:
    """Largest value of what lies in the mask; 1 where all is dark."""
    largest = float(lit.max()) if lit.size else 0.0
    return largest if largest > 0 else 1.0
