"""Normalised mean squared error and skill, from sums over pixels that can be added.

The error through a polariser is linear in the Stokes difference Δs, so that its mean square over
pixels, and over any set of angles, is a quadratic form in the second moments Σ Δs Δsᵀ of a band:
no image per angle is ever made.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from malus.renderers.truth import Truth
from malus.scenes.core.arrays import Float64Array, FloatArray, IntArray
from malus.scenes.polarisation import PAPER_ANGLES_DEG, angle_weights


@dataclass(frozen=True)
class PixelSums:
    """Count, sum and sum of squares of one number a pixel.

    Examples
    --------
    >>> sums = PixelSums.of(np.array([1.0, 2.0])) + PixelSums.of(np.array([6.0]))
    >>> sums.mean, round(sums.std, 3)
    (3.0, 2.16)
    """

    count: int = 0
    total: float = 0.0
    squares: float = 0.0

    @classmethod
    def of(cls, values: FloatArray) -> Self:
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
        """Mean over the pixels; NaN without pixels."""
        return self.total / self.count if self.count else math.nan

    @property
    def mean_square(self) -> float:
        """Mean of the squares over the pixels; NaN without pixels."""
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
    def of(cls, values: FloatArray, weights: FloatArray) -> Self:
        """Sums of arrays of one shape, in float64."""
        weights = np.asarray(weights, dtype=np.float64)
        return cls(float(weights.sum()), float(np.vdot(weights, np.asarray(values, np.float64))))

    def __add__(self, other: Self) -> WeightedSum:
        """Sums over the pixels of both."""
        return WeightedSum(self.weight + other.weight, self.total + other.total)

    @property
    def mean(self) -> float:
        """Weighted mean; NaN without weight."""
        return self.total / self.weight if self.weight > 0 else math.nan


SIGNIFICANCE = 10.0
"""Standard deviations by which the trivial guess must rise above the noise to have a skill: the
skill then carries an error of at most about a tenth."""

LEAST_ERROR = float(np.finfo(np.float32).eps) ** 2
"""NMSE of the guess below which a truth has no polarisation: what light of single precision rounds
to, which is the same in both halves of the samples, so that no noise shows it."""

MOST_SKILL = 1.5
"""A skill beyond is none: five times its error above a perfect one. So much more noise was expected
than there is error only where a method does not answer to noise smoothly, such as a search that
ends in another minimum."""

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

    moments: Float64Array
    pixels: int

    def __add__(self, other: Self) -> Residuals:
        """Sums over the pixels of both."""
        return Residuals(self.moments + other.moments, self.pixels + other.pixels)

    @classmethod
    def of(cls, difference: FloatArray, peak: float) -> Residuals:
        """Moments of Stokes differences (pixels, bands, 3) that are divided by `peak`."""
        scaled = difference.astype(np.float64) / peak
        moments = np.einsum("pbi,pbj->bij", scaled, scaled, optimize=True)
        return cls(moments, len(difference))

    @classmethod
    def of_products(cls, products: Float64Array, peak: float, pixels: int) -> Residuals:
        """Moments from the six distinct products (00 01 02 11 12 22, bands) of `pixel_kernels`."""
        return cls(products.T[:, _SYMMETRIC] / peak**2, pixels)

    @classmethod
    def of_several(
        cls, products: Float64Array, peaks: Sequence[float], pixels: int
    ) -> list[Residuals]:
        """The same of scenes whose bands stand side by side, each with its own peak."""
        moments = products.T[:, _SYMMETRIC].reshape(len(peaks), -1, 3, 3)
        return [cls(own / peak**2, pixels) for own, peak in zip(moments, peaks, strict=True)]

    def nmse(self, angles_deg: tuple[float, ...] = PAPER_ANGLES_DEG) -> float:
        """Normalised mean squared error over pixels, bands and polariser angles.

        Examples
        --------
        >>> residuals = Residuals.of(np.array([[[0.2, 0.0, 0.0]]]), peak=1.0)
        >>> round(residuals.nmse(), 12)
        0.01
        """
        return float(nmse_by([self], (angles_deg,)).mean())


def nmse_by(
    residuals: Sequence[Residuals], angle_sets: tuple[tuple[float, ...], ...]
) -> Float64Array:
    """NMSE of several residuals on the same pixels, for every set of angles and every band.

    Returns
    -------
    (residuals, sets, bands) array; NaN without pixels.
    """
    pixels = residuals[0].pixels
    moments = np.stack([r.moments.reshape(-1, 9).T for r in residuals])
    if pixels == 0:
        return np.full((len(residuals), len(angle_sets), moments.shape[2]), np.nan)
    return np.asarray(_angle_forms(angle_sets) @ moments / pixels)


@functools.cache
def _angle_forms(angle_sets: tuple[tuple[float, ...], ...]) -> Float64Array:
    """Quadratic form (sets, 9) of the mean squared error over each set of polariser angles."""
    return np.stack([angle_weights(angles).ravel() for angles in angle_sets])


@dataclass(frozen=True)
class Error:
    """A normalised mean squared error, and the part of it that is expected from noise."""

    nmse: float
    noise: float

    @property
    def bias(self) -> float:
        """NMSE minus the expected noise: unbiased, so that it can be negative by chance."""
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
    method_bias: Float64Array,
    trivial_bias: Float64Array,
    trivial_noise: Float64Array | float,
    pixels: IntArray | int,
) -> Float64Array:
    """Skill of many pairs of errors at once, from their biases and the noise of the guess.

    NaN where the guess does not rise above noise and rounding, and above `MOST_SKILL`.
    """
    # The noise is a mean of about `pixels` squares: its own relative deviation is √(2/pixels).
    spread = trivial_noise * np.sqrt(2.0 / np.maximum(pixels, 1))
    significant = trivial_bias > np.maximum(SIGNIFICANCE * spread, LEAST_ERROR)
    undefined = np.full(significant.shape, np.nan)
    skill = 1.0 - np.divide(method_bias, trivial_bias, out=undefined, where=significant)
    return np.where(skill > MOST_SKILL, np.nan, skill)


def cos_zenith(truth: Truth) -> Float64Array:
    """Cosine of the angle between normal and direction to the camera, (pixels of the mask,)."""
    cosine = truth.normals[..., 2]
    if truth.view_direction is not None:
        cosine = np.einsum("hwi,hwi->hw", truth.normals, truth.view_direction)
    return np.clip(cosine[truth.mask], 0.0, 1.0, dtype=np.float64)


def peak(truth: Truth) -> float:
    """Largest value of the unpolarised image over mask and bands; 1 where all is dark."""
    return brightest(truth.image[truth.mask])


def brightest(radiances: FloatArray) -> float:
    """Largest radiance of the mask's pixels; 1 where all is dark."""
    largest = float(radiances.max()) if radiances.size else 0.0
    return largest if largest > 0 else 1.0
