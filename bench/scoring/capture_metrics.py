"""Errors of an estimate on a real capture, as rows of a results table like those of renders."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from malus.bench.scoring.colour_error import difference_sums
from malus.bench.scoring.extra_metrics import polarisation_values
from malus.bench.scoring.metric_value import MetricValue
from malus.bench.scoring.metrics import Residuals, brightest, nmse_by, skills
from malus.bench.scoring.polarisation_error import PolarisationError
from malus.reconstruct.photos.capture import Capture
from malus.reconstruct.photos.capture_fit import CaptureFit
from malus.scenes import polarisation
from malus.scenes.colour import (
    GREY,
    RGB,
    ComparedColours,
    channel_weights,
    differences_from,
    weighted_colours,
)
from malus.scenes.core.arrays import BoolArray, Float64Array, FloatArray
from malus.scenes.polarisation import PAPER_ANGLES_DEG, analyser

_ANGLE_SETS = (PAPER_ANGLES_DEG, *((angle,) for angle in PAPER_ANGLES_DEG))
_NO_POLARISATION = 1e-12
"""NMSE of the guess that single precision makes of pictures that do not differ."""
_ROUNDING = 1e-5
"""Share of its light by which a pixel may be more than completely polarised."""


@dataclass(frozen=True)
class CapturedPixels:
    """Fitted Stokes vectors of a capture's scored pixels, over the peak of its unpolarised image.

    Attributes
    ----------
    stokes : (pixels, channels, 3)
    peak : float
        In the light of the pictures.
    scatter : (pixels, channels)
        Variance of a picture's value there, over the peak's square, from what the fit leaves of
        the pictures; zero where three pictures leave nothing.
    covariance : (3, 3)
        Of the Stokes vector that is fitted to values of variance 1.
    channels : names of the channels

    Examples
    --------
    >>> from malus.reconstruct.photos.capture_fit import fit_capture
    >>> light = polarisation.polarised
    >>> pictures = np.stack([
    ...     np.full((2, 2, 1), light(np.array([1.0, 0.2, 0.0]), angle), np.float32)
    ...     for angle in (0.0, 45.0, 90.0, 135.0)])
    >>> clipped = np.zeros((2, 2), bool)
    >>> capture = Capture(pictures, (0.0, 45.0, 90.0, 135.0), clipped, tuple("abcd"), "linear")
    >>> pixels = CapturedPixels.of(capture, fit_capture(capture), ~clipped)
    >>> values = {row.metric: row.value for row in pixels.values(0.5 * pixels.stokes)}
    >>> round(values["gain"], 6), round(values["scale"], 6)
    (0.5, 2.0)
    """

    stokes: Float64Array
    peak: float
    scatter: Float64Array
    covariance: Float64Array
    channels: tuple[str, ...]

    @classmethod
    def of(cls, capture: Capture, fit: CaptureFit, mask: BoolArray) -> CapturedPixels:
        """The pixels of `mask` (height, width), at least one, with the noise of the fit there."""
        stokes = fit.stokes[mask].astype(np.float64)
        peak = brightest(stokes[..., 0])
        scatter = np.zeros(stokes.shape[:2])
        matrix = analyser(capture.angles_deg)
        count = len(matrix)
        if count > 3:
            squares = np.square(fit.residual[mask], dtype=np.float64) * count
            scatter = np.asarray(squares / (count - 3) / peak**2)
        covariance = np.linalg.inv(matrix.T @ matrix)
        covariance[0] = covariance[:, 0] = 0.0  # methods are given the same s0, with its noise
        names = capture.channels or (RGB if stokes.shape[1] == 3 else GREY)
        return cls(stokes / peak, peak, scatter, np.asarray(covariance, np.float64), names)

    @functools.cached_property
    def noise(self) -> Residuals:
        """Expected error moments of the fit."""
        moments = self.scatter.sum(axis=0)[:, None, None] * self.covariance
        return Residuals(moments, len(self.stokes))

    def values(self, estimated: FloatArray) -> Iterator[MetricValue]:
        """Rows of the table for estimated Stokes vectors (pixels, channels, 3) over the peak.

        `noise` is the part of an NMSE that the noise of the pictures makes. It is in the error of
        the guess I(ϑ) = I/2 too, and not subtracted for the skill: what the fit leaves of the
        pictures is not only noise. Where the guess's error does not rise above it, no skill can be
        told: it is NaN.
        """
        estimate: Float64Array = np.asarray(estimated, dtype=np.float64)
        error = Residuals.of(estimate - self.stokes, 1.0)
        residuals = (error, self.noise, self._guess)
        nmse, noise, guess = nmse_by(residuals, _ANGLE_SETS).mean(axis=2)
        skill = _skills(nmse, guess, noise, error.pixels)
        for angle, *row in zip((None, *PAPER_ANGLES_DEG), nmse, noise, skill, strict=True):
            nmse_value, noise_value, skill_value = map(float, row)
            yield MetricValue("nmse", nmse_value, noise_value, None, angle)
            yield MetricValue("skill", skill_value, 0.0, None, angle)
        yield from self._agreement(estimate, guess[:1], noise[:1])
        yield MetricValue("violations", float(_violations(estimate)))
        yield from polarisation_values(PolarisationError.of(estimate, self.stokes), self._perfect)
        yield from self._colours(estimate)

    def errors(self, estimated: FloatArray) -> tuple[float, float]:
        """NMSE and skill of estimated Stokes vectors over the peak."""
        error = Residuals.of(estimated - self.stokes, 1.0)
        nmse, noise, guess = (np.array([each.nmse()]) for each in (error, self.noise, self._guess))
        return float(nmse[0]), float(_skills(nmse, guess, noise, error.pixels)[0])

    def part(self, chosen: BoolArray) -> CapturedPixels:
        """Some of the pixels, with the same peak."""
        stokes, scatter = self.stokes[chosen], self.scatter[chosen]
        return CapturedPixels(stokes, self.peak, scatter, self.covariance, self.channels)

    def _agreement(
        self, estimated: Float64Array, guess: Float64Array, noise: Float64Array
    ) -> Iterator[MetricValue]:
        """Slope, rotation and best scale of the estimated against the true field."""
        true, field = self.stokes[..., 1:], estimated[..., 1:]
        energy, own, along = (float(np.vdot(a, b)) for a, b in _pairs(true, field))
        across = float((true[..., 0] * field[..., 1] - true[..., 1] * field[..., 0]).sum())
        nan = float("nan")
        yield MetricValue("gain", along / energy if energy > 0 else nan)
        yield MetricValue("rotation", across / energy if energy > 0 else nan)
        yield MetricValue("signal", float(np.sqrt(energy / field[..., 0].size)))
        scale = along / own if own > 0 else nan
        yield MetricValue("scale", scale)
        scaled = estimated * np.array([1.0, scale, scale]) if own > 0 else estimated
        error = np.array([Residuals.of(scaled - self.stokes, 1.0).nmse()])
        skill = _skills(error, guess, noise, len(estimated))
        yield MetricValue("scaled_skill", float(skill[0]) if own > 0 else nan)

    def _colours(self, estimated: Float64Array) -> Iterator[MetricValue]:
        """ΔE76 of I_max, I_min and every I(ϑ); none of bands of a spectrum."""
        if self._true_colours is None:
            return
        maps = differences_from(self._true_colours, estimated)
        for suffix, angle, sums in difference_sums(maps):
            yield MetricValue(f"delta_e76{suffix}", sums.mean, angle_deg=angle)
            yield MetricValue(f"delta_e76{suffix}_std", sums.std, angle_deg=angle)

    @functools.cached_property
    def _guess(self) -> Residuals:
        """Errors of the guess I(ϑ) = I/2."""
        return Residuals.of(self.stokes * np.array([0.0, 1.0, 1.0]), 1.0)

    @functools.cached_property
    def _perfect(self) -> PolarisationError:
        """No error: of how much the pictures' noise makes is not known for these metrics."""
        return PolarisationError.of(self.stokes, self.stokes)

    @functools.cached_property
    def _true_colours(self) -> ComparedColours | None:
        if self.channels not in (RGB, GREY):
            return None
        return weighted_colours(self.stokes, channel_weights(self.channels))


def _skills(
    nmse: Float64Array, guess: Float64Array, noise: Float64Array, pixels: int
) -> Float64Array:
    """Skills of errors with the noise in them; NaN where the guess's do not rise above it."""
    is_told = np.isfinite(skills(nmse - noise, guess - noise, noise, pixels))
    is_told &= guess > _NO_POLARISATION
    return np.where(is_told, skills(nmse, guess, 0.0, pixels), np.nan)


def _pairs(
    true: Float64Array, field: Float64Array
) -> tuple[tuple[Float64Array, Float64Array], ...]:
    return (true, true), (field, field), (true, field)


def _violations(estimated: Float64Array) -> int:
    """Pixels more than completely polarised, of negative light, or not finite."""
    most = np.maximum(estimated[..., 0], 0.0) * (1.0 + _ROUNDING)
    fine = polarisation.polarised_intensity(estimated) <= most  # False where not finite
    return int(np.count_nonzero(~fine.all(axis=-1)))
