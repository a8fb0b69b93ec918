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
from malus.bench.scoring.image_error import PolarisationError, psnr, scaled, squared_error, ssim
from malus.bench.scoring.judge import Metric, Value
from malus.bench.scoring.metrics import Error, cos_zenith, skill
from malus.bench.scoring.sums import PixelSums
from malus.reconstruct import Components
from malus.renderers.truth import Truth
from malus.scenes.errors import InputError
from malus.scenes.polarisation import PAPER_ANGLES_DEG, angle_weights
from malus.scenes.problems import near

Image = NDArray[np.floating[Any]]


def _noisy(truth: Truth) -> Image:
    """The truth plus one draw of its own noise: what a perfect method scores is its noise."""
    return truth.stokes + truth.specular_noise + truth.diffuse_noise


def _fields(estimate: Components, truth: Truth) -> tuple[Image, Image, Image]:
    """Estimated, noisy and true Stokes vectors (pixels, bands, 3) over the peak."""
    estimated, noisy, true = (
        scaled(stokes, truth) for stokes in (estimate.stokes, _noisy(truth), truth.stokes)
    )
    return estimated, noisy, true


def delta_e76(estimate: Components, truth: Truth) -> Iterator[Value]:
    """Colour difference ΔE76 of I_max, I_min and I(ϑ); 2.3 is just noticeable."""
    return _colour_difference(estimate, truth, "delta_e76", "CIE 1976")


def delta_e2000(estimate: Components, truth: Truth) -> Iterator[Value]:
    """Colour difference ΔE2000 of I_max, I_min and I(ϑ)."""
    return _colour_difference(estimate, truth, "delta_e2000", "CIE 2000")


def _colour_difference(
    estimate: Components, truth: Truth, name: str, method: str
) -> Iterator[Value]:
    estimated, noisy, true = _fields(estimate, truth)
    bands = truth.scene.wavelengths_nm
    found, floor = (delta_e(field, true, bands, method) for field in (estimated, noisy))
    for (suffix, angle, sums), (_, _, noise) in zip(found, floor, strict=True):
        yield Value(name + suffix, sums.mean, noise.mean, angle_deg=angle)
        yield Value(f"{name}{suffix}_std", sums.std, noise.std, angle_deg=angle)


def polarisation_error(estimate: Components, truth: Truth) -> Iterator[Value]:
    """Mean absolute errors of DoLP and AoLP (degrees), RMSE of s1 and s2 over the peak, NMSE of
    I_max and I_min.
    """
    estimated, noisy, true = _fields(estimate, truth)
    found, noise = (PolarisationError.of(field, true) for field in (estimated, noisy))
    yield Value("dolp_mae", found.dolp.mean, noise.dolp.mean)
    yield Value("aolp_mae_deg", math.degrees(found.aolp.mean), math.degrees(noise.aolp.mean))
    yield Value("s1_rmse", found.s1.rms, noise.s1.rms)
    yield Value("s2_rmse", found.s2.rms, noise.s2.rms)
    yield Value("nmse_i_max", found.i_max.mean_square, noise.i_max.mean_square)
    yield Value("nmse_i_min", found.i_min.mean_square, noise.i_min.mean_square)


def psnr_values(estimate: Components, truth: Truth) -> Iterator[Value]:
    """Peak signal-to-noise ratio of I(ϑ) in dB; its noise is the largest that can be told."""
    estimated, noisy, true = _fields(estimate, truth)
    whole, floor = PixelSums(), PixelSums()
    for angle in PAPER_ANGLES_DEG:
        found, noise = (squared_error(field, true, angle) for field in (estimated, noisy))
        whole, floor = whole + found, floor + noise
        yield Value("psnr", psnr(found), psnr(noise), angle_deg=angle)
    yield Value("psnr", psnr(whole), psnr(floor))


def ssim_values(estimate: Components, truth: Truth) -> Iterator[Value]:
    """Structural similarity of I(ϑ); its noise is the largest that can be told."""
    pictures = estimate.stokes, _noisy(truth)
    whole, floor = PixelSums(), PixelSums()
    for angle in PAPER_ANGLES_DEG:
        found, noise = (ssim(stokes, truth, angle) for stokes in pictures)
        whole, floor = whole + found, floor + noise
        yield Value("ssim", found.mean, noise.mean, angle_deg=angle)
    yield Value("ssim", whole.mean, floor.mean)


ZENITHS_DEG = (0, 15, 30, 45, 60, 75, 90)
"""Edges of the bins of zenith angle."""


def zenith_values(estimate: Components, truth: Truth) -> Iterator[Value]:
    """NMSE and skill of the pixels in each bin of zenith angle, over the peak of all of them.

    The noise is that of the guess I(ϑ) = I/2, which a method that keeps the image has to first
    order. Bins without a pixel have no values.
    """
    estimated, noisy, true = _fields(estimate, truth)
    place = np.digitize(np.degrees(np.arccos(cos_zenith(truth))), ZENITHS_DEG[1:-1])
    pixels = np.bincount(place, minlength=len(ZENITHS_DEG) - 1)
    polarised = np.array([0.0, 1.0, 1.0])
    method, guess, noise = (
        np.bincount(place, _squared(d), len(pixels)) / np.maximum(pixels, 1)
        for d in (estimated - true, true * polarised, (noisy - true) * polarised)
    )
    for k, (low, high) in enumerate(itertools.pairwise(ZENITHS_DEG)):
        if not pixels[k]:
            continue
        errors = Error(float(method[k]), float(noise[k])), Error(float(guess[k]), float(noise[k]))
        yield Value(f"nmse_zenith_{low}_{high}", errors[0].nmse, errors[0].noise)
        yield Value(f"skill_zenith_{low}_{high}", skill(*errors, int(pixels[k])))


def _squared(difference: Image) -> Image:
    """Squared error (pixels,) of Stokes differences (pixels, bands, 3): mean of bands, angles."""
    weighted = difference @ angle_weights()
    return np.einsum("pbi,pbi->p", weighted, difference) / difference.shape[1]


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
