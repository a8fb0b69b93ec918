"""Errors of the degree and angle of polarisation, of the Stokes components and of the images.

Every metric follows from sums over the mask's pixels and bands. Sums of parts of an image add up
to those of the whole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from malus.bench.scoring.metrics import PixelSums, WeightedSum, peak
from malus.renderers.truth import Truth
from malus.scenes import polarisation
from malus.scenes.core.arrays import Float64Array, FloatArray
from malus.scenes.core.errors import InputError

SSIM_WINDOW = 7
"""Side of the window of the structural similarity, scikit-image's default."""


@dataclass(frozen=True)
class PolarisationError:
    """Sums over pixels of the errors of DoLP, AoLP, s1, s2, I_max and I_min.

    They are absolute errors of DoLP and AoLP, the latter weighted by true polarised intensity.
    Stokes components and weights are divided by the peak of the unpolarised image.

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=16))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> true = scaled(truth.stokes, truth)
    >>> turned = true * [1.0, -1.0, -1.0]
    >>> round(float(np.degrees(PolarisationError.of(turned, true).aolp.mean)), 6)
    90.0
    """

    dolp: PixelSums
    aolp: WeightedSum
    s1: PixelSums
    s2: PixelSums
    i_max: PixelSums
    i_min: PixelSums

    @classmethod
    def of(cls, estimated: FloatArray, true: FloatArray) -> Self:
        """Sums over `scaled` Stokes vectors (..., 3)."""
        difference = estimated - true
        extremes = zip(polarisation.extremes(estimated), polarisation.extremes(true), strict=True)
        return cls(
            PixelSums.of(np.abs(polarisation.dolp(estimated) - polarisation.dolp(true))),
            WeightedSum.of(
                angle_between(polarisation.aolp(estimated), polarisation.aolp(true)),
                polarisation.polarised_intensity(true),
            ),
            PixelSums.of(difference[..., 1]),
            PixelSums.of(difference[..., 2]),
            *(PixelSums.of(e - t) for e, t in extremes),
        )

    def __add__(self, other: Self) -> PolarisationError:
        """Sums over the pixels of both."""
        return PolarisationError(
            self.dolp + other.dolp,
            self.aolp + other.aolp,
            self.s1 + other.s1,
            self.s2 + other.s2,
            self.i_max + other.i_max,
            self.i_min + other.i_min,
        )


def scaled(stokes: FloatArray, truth: Truth) -> Float64Array:
    """Stokes vectors (pixels, bands, 3) of the truth's mask over the peak of its image, float64."""
    return stokes[truth.mask].astype(np.float64) / peak(truth)


def angle_between(a: FloatArray, b: FloatArray) -> Float64Array:
    """Absolute difference of two orientations modulo 180°, radians in [0, π/2].

    Examples
    --------
    >>> round(float(np.degrees(angle_between(np.radians(179.0), np.radians(2.0)))), 9)
    3.0
    """
    difference = np.abs(np.asarray(a - b, dtype=np.float64)) % np.pi
    return np.asarray(np.minimum(difference, np.pi - difference))


def squared_error(estimated: FloatArray, true: FloatArray, angle: float) -> PixelSums:
    """Sums of I_est(ϑ) − I_true(ϑ) over `scaled` Stokes vectors; ϑ in degrees."""
    return PixelSums.of(polarisation.polarised(estimated - true, angle))


def psnr(sums: PixelSums) -> float:
    """Peak signal-to-noise ratio in dB; the peak is that of the unpolarised image.

    Examples
    --------
    >>> round(psnr(PixelSums.of(np.array([0.1, -0.1]))), 9)
    20.0
    """
    mean_square = sums.mean_square
    return math.inf if mean_square == 0.0 else -10.0 * math.log10(mean_square)


def ssim(estimated: FloatArray, truth: Truth, angle: float) -> PixelSums:
    """Structural similarity of I(ϑ): one number an image, as sums over images.

    A window spans many pixels, so that no part of an image has a similarity of its own: images can
    be added, parts of one cannot. The value is the mean of the similarity map over the mask, both
    images black outside it, the mean over bands, data range the peak of the unpolarised image.

    Parameters
    ----------
    estimated : (pixels, bands, 3)
        Stokes vectors of the mask's pixels.

    Raises
    ------
    InputError
        If the image is smaller than the window.
    """
    from skimage.metrics import structural_similarity

    mask = truth.mask
    if min(mask.shape) < SSIM_WINDOW:
        size = "×".join(map(str, mask.shape))
        raise InputError("ssim", f"at least {SSIM_WINDOW} pixels a side", size, "leave it out")
    images = []
    for stokes in (truth.stokes[mask], estimated):
        image = np.zeros(truth.image.shape)
        image[mask] = polarisation.polarised(stokes.astype(np.float64), angle)
        images.append(image)
    _, similarity = structural_similarity(
        *images, win_size=SSIM_WINDOW, data_range=peak(truth), channel_axis=-1, full=True
    )
    return PixelSums.of(np.atleast_1d(similarity[mask].mean()))
