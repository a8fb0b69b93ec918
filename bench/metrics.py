"""Scores as functions of sums over pixels that can be added.

The error through a polariser is linear in the Stokes difference Δs, so that its mean square over
pixels, and over any set of angles, is a quadratic form in the second moments Σ Δs Δsᵀ of a band:
no image per angle is ever made.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct import Components
from malus.renderers.truth import Truth
from malus.scenes.polarisation import PAPER_ANGLES_DEG, angle_weights

Floats = NDArray[np.float64]
Image = NDArray[np.floating[Any]]

SIGNIFICANCE = 10.0
"""Standard deviations by which the trivial guess must rise above the noise to have a skill: the
skill then carries an error of at most about a tenth."""


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

    def nmse(self, angles_deg: tuple[float, ...] = PAPER_ANGLES_DEG) -> float:
        """Normalised mean squared error over pixels, bands and polariser angles.

        Examples
        --------
        >>> one = Residuals.of(np.array([[[0.2, 0.0, 0.0]]]), peak=1.0)
        >>> round(one.nmse(), 12)
        0.01
        """
        return float(self.nmse_by([angles_deg]).mean())

    def nmse_by(self, angle_sets: Sequence[tuple[float, ...]]) -> Floats:
        """The same for several sets of angles and every band apart, shape (sets, bands)."""
        if self.pixels == 0:
            return np.full((len(angle_sets), len(self.moments)), np.nan)
        forms = np.stack([angle_weights(angles).ravel() for angles in angle_sets])
        return forms @ self.moments.reshape(-1, 9).T / self.pixels


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
    # The noise is a mean of about `pixels` squares: its own relative deviation is √(2/pixels).
    spread = trivial.noise * math.sqrt(2.0 / max(pixels, 1))
    if not trivial.bias > SIGNIFICANCE * spread or trivial.bias <= 0.0:
        return math.nan
    return 1.0 - method.bias / trivial.bias


@dataclass(frozen=True)
class Target:
    """The pixels of a truth's mask and the Stokes vectors (pixels, bands, 3) to be met there."""

    pixels: NDArray[np.intp]
    stokes: Image

    @classmethod
    def of(cls, truth: Truth) -> Self:
        """The target that a truth sets."""
        pixels = np.flatnonzero(truth.mask)
        bands = truth.specular.shape[2]
        lobes = (lobe.reshape(-1, bands, 3)[pixels] for lobe in (truth.specular, truth.diffuse))
        return cls(pixels, sum(lobes, np.zeros((), truth.specular.dtype)))

    def missed_by(self, estimate: Components) -> Image:
        """Estimated minus true Stokes vectors, (pixels, bands, 3)."""
        difference = np.empty_like(self.stokes)
        bands = self.stokes.shape[1]
        for k, component in enumerate((estimate.image, estimate.s1, estimate.s2)):
            plane = component.reshape(-1, bands)[self.pixels]
            np.subtract(plane, self.stokes[..., k], out=difference[..., k])
        return difference


def peak(truth: Truth) -> float:
    """Largest value of the unpolarised image over mask and bands; 1 where all is dark."""
    lit = truth.image[truth.mask]
    largest = float(lit.max()) if lit.size else 0.0
    return largest if largest > 0 else 1.0


def violations(estimate: Components, image: Image, mask: NDArray[np.bool_]) -> int:
    """Pixels with I_min < 0, DoLP > 1, |I_max + I_min − I| > 1e-5 I, or a value not finite.

    Examples
    --------
    >>> one = np.ones((1, 1, 1))
    >>> violations(Components(one, 2 * one, 0 * one), one, np.ones((1, 1), bool))
    1
    """
    total, s1, s2 = estimate.image[mask], estimate.s1[mask], estimate.s2[mask]
    finite = np.isfinite(total) & np.isfinite(s1) & np.isfinite(s2)
    with np.errstate(invalid="ignore", over="ignore"):
        # I_min < 0 and DoLP > 1 are one condition; a few rounding errors of the dtype are allowed.
        slack = 1.0 + 8.0 * float(np.finfo(total.dtype).eps)
        overpolarised = np.hypot(s1, s2) > total * slack
        unequal = np.abs(total - image[mask]) > 1e-5 * np.abs(image[mask])
    return int(np.any(~finite | overpolarised | unequal, axis=-1).sum())
