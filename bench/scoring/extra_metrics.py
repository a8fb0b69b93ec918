"""Further metrics, computed only where a suite names them: colour, DoLP and AoLP, PSNR, SSIM.

The noise beside a value is what a perfect method would score against this truth because of the
truth's own Monte Carlo noise: errors below it mean nothing. By zenith angle it is the method's own.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from malus.bench.scoring.colour_error import delta_e
from malus.bench.scoring.judge import Metric
from malus.bench.scoring.metric_value import MetricValue, StokesMetric
from malus.bench.scoring.metrics import PixelSums, cos_zenith, peak, skills
from malus.bench.scoring.polarisation_error import (
    PolarisationError,
    psnr,
    scaled,
    squared_error,
    ssim,
)
from malus.bench.scoring.profiles import PROFILES
from malus.reconstruct.methods import TRIVIAL
from malus.renderers.truth import Truth
from malus.scenes.colour import compared_colours
from malus.scenes.core.arrays import Float64Array, FloatArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.validation import near
from malus.scenes.polarisation import PAPER_ANGLES_DEG, angle_weights


class _RelativeStokes:
    """Stokes vectors (pixels, bands, 3) of the truth's mask over the peak of its image.

    `noisy` is the truth plus one draw of its own noise: a perfect method's score is that of it.
    """

    def __init__(self, truth: Truth) -> None:
        self.peak = peak(truth)
        self.true = scaled(truth.stokes, truth)
        self.noisy = scaled(_noisy(truth), truth)

    def of(self, stokes: FloatArray) -> Float64Array:
        """Stokes vectors of an estimate over the same peak."""
        return np.divide(stokes, self.peak, dtype=np.float64)


def _noisy(truth: Truth) -> FloatArray:
    return truth.stokes + truth.specular_noise + truth.diffuse_noise


def delta_e76(truth: Truth) -> StokesMetric:
    """Colour difference ΔE76 of I_max, I_min and I(ϑ); 2.3 is just noticeable."""
    return _colour_difference(truth, "delta_e76", "CIE 1976")


def delta_e2000(truth: Truth) -> StokesMetric:
    """Colour difference ΔE2000 of I_max, I_min and I(ϑ)."""
    return _colour_difference(truth, "delta_e2000", "CIE 2000")


def _colour_difference(truth: Truth, name: str, method: str) -> StokesMetric:
    relative = _RelativeStokes(truth)
    true = compared_colours(relative.true, truth.scene.wavelengths_nm)
    noises = list(delta_e(relative.noisy, true, method))

    def measure(stokes: FloatArray, _change: FloatArray | None = None) -> Iterator[MetricValue]:
        differences = delta_e(relative.of(stokes), true, method)
        for (suffix, angle, sums), (_, _, noise) in zip(differences, noises, strict=True):
            yield MetricValue(name + suffix, sums.mean, noise.mean, angle_deg=angle)
            yield MetricValue(f"{name}{suffix}_std", sums.std, noise.std, angle_deg=angle)

    return measure


def polarisation_error(truth: Truth) -> StokesMetric:
    """Errors of DoLP, AoLP, s1, s2, I_max and I_min, and s3 where the truth has it.

    Mean absolute errors of DoLP and AoLP (degrees), RMSE of s1 and s2 over the peak, NMSE of I_max
    and I_min. Methods estimate linear polarisation: their error of s3 is all of it.
    """
    relative = _RelativeStokes(truth)
    circular = list(_circular(truth))
    noise = PolarisationError.of(relative.noisy, relative.true)

    def measure(stokes: FloatArray, _change: FloatArray | None = None) -> Iterator[MetricValue]:
        yield from polarisation_values(
            PolarisationError.of(relative.of(stokes), relative.true), noise
        )
        yield from circular

    return measure


def _circular(truth: Truth) -> Iterator[MetricValue]:
    """Rms of the true s3 over the peak, where the truth has one, and that of its noise."""
    if truth.s3 is None or truth.s3_noise is None:
        return
    own, noise = (
        PixelSums.of(s3[truth.mask].astype(np.float64) / peak(truth))
        for s3 in (truth.s3, truth.s3_noise)
    )
    yield MetricValue("s3_rmse", own.rms, noise.rms)


def polarisation_values(
    error: PolarisationError, noise: PolarisationError
) -> Iterator[MetricValue]:
    """Rows of the table from the errors of an estimate, and those of a perfect one."""
    aolp_noise_deg = math.degrees(noise.aolp.mean)
    yield MetricValue("dolp_mae", error.dolp.mean, noise.dolp.mean)
    yield MetricValue("aolp_mae_deg", math.degrees(error.aolp.mean), aolp_noise_deg)
    yield MetricValue("s1_rmse", error.s1.rms, noise.s1.rms)
    yield MetricValue("s2_rmse", error.s2.rms, noise.s2.rms)
    yield MetricValue("nmse_i_max", error.i_max.mean_square, noise.i_max.mean_square)
    yield MetricValue("nmse_i_min", error.i_min.mean_square, noise.i_min.mean_square)


def psnr_values(truth: Truth) -> StokesMetric:
    """Peak signal-to-noise ratio of I(ϑ) in dB; its noise is the largest measurable value."""
    relative = _RelativeStokes(truth)
    noises = [squared_error(relative.noisy, relative.true, angle) for angle in PAPER_ANGLES_DEG]

    def measure(stokes: FloatArray, _change: FloatArray | None = None) -> Iterator[MetricValue]:
        estimated, all_angles = relative.of(stokes), PixelSums()
        for angle, noise in zip(PAPER_ANGLES_DEG, noises, strict=True):
            error = squared_error(estimated, relative.true, angle)
            all_angles = all_angles + error
            yield MetricValue("psnr", psnr(error), psnr(noise), angle_deg=angle)
        yield MetricValue("psnr", psnr(all_angles), psnr(sum(noises, PixelSums())))

    return measure


def ssim_values(truth: Truth) -> StokesMetric:
    """Structural similarity of I(ϑ); its noise is the largest measurable value."""
    noisy = _noisy(truth)[truth.mask]
    noises = [ssim(noisy, truth, angle) for angle in PAPER_ANGLES_DEG]

    def measure(stokes: FloatArray, _change: FloatArray | None = None) -> Iterator[MetricValue]:
        all_angles = PixelSums()
        for angle, noise in zip(PAPER_ANGLES_DEG, noises, strict=True):
            similarity = ssim(stokes, truth, angle)
            all_angles = all_angles + similarity
            yield MetricValue("ssim", similarity.mean, noise.mean, angle_deg=angle)
        yield MetricValue("ssim", all_angles.mean, sum(noises, PixelSums()).mean)

    return measure


ZENITHS_DEG = (0, 15, 30, 45, 60, 75, 90)
"""Edges of the bins of zenith angle."""


def zenith_values(truth: Truth) -> StokesMetric:
    """NMSE and skill of the pixels in each bin of zenith angle, over the peak of all of them.

    The noise is what a draw of the truth's noise changes in the method's errors; where that is not
    known, that of the guess I(ϑ) = I/2. Bins without a pixel have no values.
    """
    relative = _RelativeStokes(truth)
    bins = np.digitize(np.degrees(np.arccos(cos_zenith(truth))), ZENITHS_DEG[1:-1])
    pixels = np.bincount(bins, minlength=len(ZENITHS_DEG) - 1)

    filled = np.flatnonzero(pixels)
    polarised = np.array([0.0, 1.0, 1.0])

    def binned(difference: FloatArray) -> Float64Array:
        return np.bincount(bins, _squared(difference))[filled] / pixels[filled]

    guess, of_guess = (
        binned(relative.true * polarised),
        binned((relative.noisy - relative.true) * polarised),
    )
    names = [f"zenith_{low}_{high}" for low, high in itertools.pairwise(ZENITHS_DEG)]

    def measure(stokes: FloatArray, change: FloatArray | None = None) -> Iterator[MetricValue]:
        error = binned(relative.of(stokes) - relative.true)
        noise = of_guess if change is None else binned(relative.of(change))
        skill = skills(error - noise, guess - of_guess, of_guess, pixels[filled])
        for k, bin_error, bin_noise, bin_skill in zip(filled, error, noise, skill, strict=True):
            yield MetricValue(f"nmse_{names[k]}", float(bin_error), float(bin_noise))
            yield MetricValue(f"skill_{names[k]}", float(bin_skill))

    return measure


def _squared(difference: FloatArray) -> FloatArray:
    """Squared error (pixels,) of Stokes differences (pixels, bands, 3): mean of bands, angles."""
    weighted = difference.reshape(-1, 3) @ angle_weights()
    sums = np.einsum("pbi,pbi->p", weighted.reshape(difference.shape), difference)
    return np.asarray(sums / difference.shape[1])


METRICS: dict[str, Metric] = {
    "delta_e76": delta_e76,
    "delta_e2000": delta_e2000,
    "polarisation": polarisation_error,
    "psnr": psnr_values,
    "ssim": ssim_values,
    "zenith": zenith_values,
    **PROFILES,
}
"""Further metrics by name."""


GUESS = TRIVIAL.name
"""The method that guesses I(ϑ) = I/2; profiles stand beside its values."""


def with_guess(methods: Sequence[str], metrics: Sequence[str]) -> tuple[str, ...]:
    """Names of methods, and that of the trivial guess where a profile is asked for.

    Examples
    --------
    >>> with_guess(["eq8"], ["profile:rgb2pol"]), with_guess(["eq8"], ["psnr"])
    (('unpolarised', 'eq8'), ('eq8',))
    """
    needed = GUESS not in methods and any(name in PROFILES for name in metrics)
    return (GUESS, *methods) if needed else tuple(methods)


@functools.cache
def get_metrics(names: tuple[str, ...]) -> tuple[Metric, ...]:
    """Look metrics up by their names.

    Raises
    ------
    InputError
        Unknown name.

    Examples
    --------
    >>> len(get_metrics(("psnr", "ssim")))
    2
    """
    for name in names:
        if name not in METRICS:
            hint = near(name, METRICS) or "correct the name"
            raise InputError("metric", f"one of {', '.join(METRICS)}", name, hint)
    return tuple(METRICS[name] for name in names)
