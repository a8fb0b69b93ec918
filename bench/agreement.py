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
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from malus.renderers.truth import Truth
from malus.scenes.polarisation import angle_weights

Floats = NDArray[np.float64]
Image = NDArray[np.floating[Any]]

ALONG, ACROSS, ENERGY, ERROR, TRIVIAL = range(5)


@dataclass(frozen=True)
class Agreement:
    """Sums over pixels and bands, divided by the squared peak, and their covariance by noise.

    Attributes
    ----------
    totals : (5,)
        Σ (ŝ − s)·s, Σ s × ŝ, Σ s·s over the polarised parts (s1, s2); Σ n_z⁴ of the squared error
        over polariser angles; the same of the trivial guess I(ϑ) = I/2. Noise-corrected.
    covariance : (5, 5)
        Of the totals, from one draw of the noise a pixel; pixels are independent.
    count : int
        Pixels times bands.
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

        Pixels weigh by the fourth power of their normal's z: those of the rim come and go with
        the samples, and where the error sits there, the plain skill jumps by 13 times the noise
        that the halves can show (measured: distant light, roughness 0.4).
        """
        part, error = self._ratio(ERROR, TRIVIAL)
        return 1.0 - part, error

    def _ratio(self, top: int, bottom: int) -> tuple[float, float]:
        """Quotient of two totals and its standard error, NaN where there is nothing below."""
        if not self.totals[bottom] > 0.0:
            return math.nan, math.nan
        quotient = float(self.totals[top] / self.totals[bottom])
        slope = np.zeros(len(self.totals))
        slope[top] += 1.0
        slope[bottom] -= quotient
        variance = float(slope @ self.covariance @ slope)
        return quotient, math.sqrt(max(variance, 0.0)) / float(self.totals[bottom])

    def _error(self, index: int) -> float:
        return math.sqrt(float(self.covariance[index, index]))


class TrueField:
    """What all methods share on one truth: its polarised part, and one draw of its noise.

    Examples
    --------
    A method that finds nine tenths of the polarisation has a gain of 0.9:

    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=16))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> difference = truth.stokes[truth.mask] * [0.0, -0.1, -0.1]
    >>> found = TrueField(truth, peak=1.0).agreement(difference, 0.0 * difference)
    >>> round(found.gain[0], 12)
    0.9
    """

    def __init__(self, truth: Truth, peak: float) -> None:
        mask = truth.mask
        self.peak = peak
        self.bands = truth.specular.shape[2]
        true = _polarised_part(truth.specular[mask] + truth.diffuse[mask])
        draw = _polarised_part(truth.specular_noise[mask] + truth.diffuse_noise[mask])
        self.true, self.draw = _flat(true), _flat(draw)
        self.across, self.across_draw = _flat(_turned(true)), _flat(_turned(draw))
        self.form = angle_weights().astype(true.dtype)
        self.facing = np.clip(truth.normals[mask][:, 2].astype(np.float64), 0.0, 1.0) ** 4
        self.energy = _self_products(self.true, self.draw, np.eye(3, dtype=true.dtype))
        self.trivial = _weighted(self.facing, *_self_products(self.true, self.draw, self.form))

    def agreement(self, difference: Image, change: Image) -> Agreement:
        """Agreement of one estimate.

        Parameters
        ----------
        difference : (pixels, bands, 3)
            Estimated minus true Stokes vectors at the mask's pixels.
        change : (pixels, bands, 3)
            How the draw of the noise changes that difference.
        """
        residual, noise = _flat(difference), _flat(change)
        pairs = [
            _cross_products(residual, noise, self.true, self.draw),
            _cross_products(residual, noise, self.across, self.across_draw),
            self.energy,
            _weighted(self.facing, *_self_products(residual, noise, self.form)),
            self.trivial,
        ]
        scale = self.peak**2
        totals = np.array([values.sum() for values, _ in pairs]) / scale
        draws = np.stack([draw for _, draw in pairs]) / scale
        return Agreement(totals, draws @ draws.T, len(self.true) * self.bands)


def _polarised_part(stokes: Image) -> Image:
    """Stokes vectors without their s0."""
    result = stokes.copy()
    result[..., 0] = 0
    return result


def _turned(stokes: Image) -> Image:
    """(0, −s2, s1): a product of b with it is the cross product s × b of the polarised parts."""
    return np.stack([0 * stokes[..., 0], -stokes[..., 2], stokes[..., 1]], axis=-1)


def _cross_products(a: Image, a_draw: Image, b: Image, b_draw: Image) -> tuple[Floats, Floats]:
    """a·b a pixel without the bias of noise, and what a draw of the noise adds to it.

    With halves a ± a', b ± b', the mean of the two products of independent halves is
    a·b − a'·b'; to first order noise changes it by a·b' + a'·b.
    """
    values = _by_pixel(a, b) - _by_pixel(a_draw, b_draw)
    return values, _by_pixel(a, b_draw) + _by_pixel(a_draw, b)


def _self_products(a: Image, a_draw: Image, form: Image) -> tuple[Floats, Floats]:
    """The same for the quadratic form aᵀ W a."""
    weighted, weighted_draw = ((v.reshape(-1, 3) @ form).reshape(a.shape) for v in (a, a_draw))
    values = _by_pixel(weighted, a) - _by_pixel(weighted_draw, a_draw)
    return values, 2.0 * _by_pixel(weighted, a_draw)


def _weighted(weights: Floats, *values: Floats) -> tuple[Floats, ...]:
    return tuple(weights * value for value in values)


def _by_pixel(a: Image, b: Image) -> Floats:
    """Scalar products over bands too: the noise of all bands of a pixel is one draw."""
    return np.asarray(np.einsum("pi,pi->p", a, b), dtype=np.float64)


def _flat(stokes: Image) -> Image:
    """(pixels, bands, 3) as one vector a pixel."""
    return np.ascontiguousarray(stokes).reshape(len(stokes), -1)
