"""Metrics that are computed only where they are asked for, by name.

The noise beside a value is what a perfect method would score against this truth because of the
truth's own Monte Carlo noise: errors below it mean nothing.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.bench.scoring.colour_error import delta_e
from malus.bench.scoring.judge import Measure, Metric, Value
from malus.bench.scoring.metrics import PixelSums, cos_zenith, peak, skills
from malus.bench.scoring.polarisation_error import (
    PolarisationError,
    psnr,
    scaled,
    squared_error,
    ssim,
)
from malus.renderers.truth import Truth
from malus.scenes.core.errors import InputError
from malus.scenes.core.validation import near
from malus.scenes.polarisation import PAPER_ANGLES_DEG, angle_weights

Floats = NDArray[np.float64]
Image = NDArray[np.floating[Any]]


class _Fields:
    """Stokes vectors (pixels, bands, 3) of the truth's mask over the peak of its image.

    `noisy` is the truth plus one draw of its own noise: what a perfect method scores is its noise.
    """

    def __init__(self, truth: Truth) -> None:
        self.peak = peak(truth)
        self.true = scaled(truth.stokes, truth)
        self.noisy = scaled(_noisy(truth), truth)

    def of(self, stokes: Image) -> Floats:
        """Of an estimate's Stokes vectors."""
        return np.divide(stokes, self.peak, dtype=np.float64)


def _noisy(truth: Truth) -> Image:
    return truth.stokes + truth.specular_noise + truth.diffuse_noise


def delta_e76(truth: Truth) -> Measure:
    """Colour difference ΔE76 of I_max, I_min and I(ϑ); 2.3 is just noticeable."""
    return _colour_difference(truth, "delta_e76", "CIE 1976")


def delta_e2000(truth: Truth) -> Measure:
    """Colour difference ΔE2000 of I_max, I_min and I(ϑ)."""
    return _colour_difference(truth, "delta_e2000", "CIE 2000")


def _colour_difference(truth: Truth, name: str, method: str) -> Measure:
    fields, bands = _Fields(truth), truth.scene.wavelengths_nm
    floor = list(delta_e(fields.noisy, fields.true, bands, method))

    def measure(stokes: Image) -> Iterator[Value]:
        found = delta_e(fields.of(stokes), fields.true, bands, method)
        for (suffix, angle, sums), (_, _, noise) in zip(found, floor, strict=True):
            yield Value(name + suffix, sums.mean, noise.mean, angle_deg=angle)
            yield Value(f"{name}{suffix}_std", sums.std, noise.std, angle_deg=angle)

    return measure


def polarisation_error(truth: Truth) -> Measure:
    """Mean absolute errors of DoLP and AoLP (degrees), RMSE of s1 and s2 over the peak, NMSE of
    I_max and I_min.
    """
    fields = _Fields(truth)
    noise = PolarisationError.of(fields.noisy, fields.true)

    def measure(stokes: Image) -> Iterator[Value]:
        found = PolarisationError.of(fields.of(stokes), fields.true)
        yield Value("dolp_mae", found.dolp.mean, noise.dolp.mean)
        yield Value("aolp_mae_deg", math.degrees(found.aolp.mean), math.degrees(noise.aolp.mean))
        yield Value("s1_rmse", found.s1.rms, noise.s1.rms)
        yield Value("s2_rmse", found.s2.rms, noise.s2.rms)
        yield Value("nmse_i_max", found.i_max.mean_square, noise.i_max.mean_square)
        yield Value("nmse_i_min", found.i_min.mean_square, noise.i_min.mean_square)

    return measure


def psnr_values(truth: Truth) -> Measure:
    """Peak signal-to-noise ratio of I(ϑ) in dB; its noise is the largest that can be told."""
    fields = _Fields(truth)
    floor = [squared_error(fields.noisy, fields.true, angle) for angle in PAPER_ANGLES_DEG]

    def measure(stokes: Image) -> Iterator[Value]:
        estimated, whole = fields.of(stokes), PixelSums()
        for angle, noise in zip(PAPER_ANGLES_DEG, floor, strict=True):
            found = squared_error(estimated, fields.true, angle)
            whole = whole + found
            yield Value("psnr", psnr(found), psnr(noise), angle_deg=angle)
        yield Value("psnr", psnr(whole), psnr(sum(floor, PixelSums())))

    return measure


def ssim_values(truth: Truth) -> Measure:
    """Structural similarity of I(ϑ); its noise is the largest that can be told."""
    noisy = _noisy(truth)[truth.mask]
    floor = [ssim(noisy, truth, angle) for angle in PAPER_ANGLES_DEG]

    def measure(stokes: Image) -> Iterator[Value]:
        whole = PixelSums()
        for angle, noise in zip(PAPER_ANGLES_DEG, floor, strict=True):
            found = ssim(stokes, truth, angle)
            whole = whole + found
            yield Value("ssim", found.mean, noise.mean, angle_deg=angle)
        yield Value("ssim", whole.mean, sum(floor, PixelSums()).mean)

    return measure


ZENITHS_DEG = (0, 15, 30, 45, 60, 75, 90)
"""Edges of the bins of zenith angle."""


def zenith_values(truth: Truth) -> Measure:
    """NMSE and skill of the pixels in each bin of zenith angle, over the peak of all of them.

    The noise is that of the guess I(ϑ) = I/2, which a method that keeps the image has to first
    order. Bins without a pixel have no values.
    """
    fields = _Fields(truth)
    place = np.digitize(np.degrees(np.arccos(cos_zenith(truth))), ZENITHS_DEG[1:-1])
    pixels = np.bincount(place, minlength=len(ZENITHS_DEG) - 1)

    filled = np.flatnonzero(pixels)
    polarised = np.array([0.0, 1.0, 1.0])

    def binned(difference: Image) -> Floats:
        return np.bincount(place, _squared(difference))[filled] / pixels[filled]

    guess, noise = binned(fields.true * polarised), binned((fields.noisy - fields.true) * polarised)
    names = [f"zenith_{low}_{high}" for low, high in itertools.pairwise(ZENITHS_DEG)]

    def measure(stokes: Image) -> Iterator[Value]:
        error = binned(fields.of(stokes) - fields.true)
        worth = skills(error - noise, guess - noise, noise, pixels[filled])
        for k, bin_error, floor, skilled in zip(filled, error, noise, worth, strict=True):
            yield Value(f"nmse_{names[k]}", float(bin_error), float(floor))
            yield Value(f"skill_{names[k]}", float(skilled))

    return measure


def _squared(difference: Image) -> Image:
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
}
"""Further metrics by name."""


@functools.cache
def get_metrics(names: tuple[str, ...]) -> tuple[Metric, ...]:
    """The metrics of those names.

    Raises
    ------
    InputError
        If there is none of a name.

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
