"""Metrics as three published projects define them, to the letter, for tables that quote theirs.

Each profile is a further metric. Channels are the bands of the scene; a published number is of
three. Where a definition looks at the whole picture, pixels off the mask are black in both images:
they cost no method anything, and raise every PSNR and SSIM. The noise beside a value is what a
perfect method would score because of the truth's own noise. Where a truth has s3, which methods do
not estimate, their s3 counts as 0.

Sources: PolarAnything (Zhang et al., ICCV 2025) with its public code; the RGB-to-Polarization
benchmark (NeurIPS 2025, Datasets and Benchmarks) with its public code; PolarScale (2026).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from malus.bench.scoring.metric_value import MetricValue, StokesMetric
from malus.bench.scoring.metrics import PixelSums, brightest
from malus.bench.scoring.polarisation_error import angle_between, psnr
from malus.scenes import polarisation
from malus.scenes.core.arrays import BoolArray, Float64Array, FloatArray
from malus.scenes.core.errors import InputError

WINDOW, SIGMA = 11, 1.5
"""Side and standard deviation, in pixels, of the Gaussian window of the profiles' SSIM."""

POLARISED_ABOVE = 0.1
"""True degree of polarisation above which PolarScale counts errors of the angle."""

CODES = 255.0
"""Largest code of the 8-bit pictures whose PSNR the RGB-to-Polarization benchmark quotes."""

Values = dict[str, float]


class Pictured(Protocol):
    """What a profile needs of a truth: a render's, or that of a published test set."""

    @property
    def mask(self) -> BoolArray:
        """Pixels (height, width) that count."""

    @property
    def image(self) -> FloatArray:
        """Unpolarised image (height, width, bands)."""

    @property
    def stokes(self) -> FloatArray:
        """Stokes image (height, width, bands, 3)."""

    @property
    def specular_noise(self) -> FloatArray:
        """One draw of the noise (height, width, bands, 3), of two parts that add up."""

    @property
    def diffuse_noise(self) -> FloatArray:
        """The other part."""


@dataclass(frozen=True)
class _Pixels:
    """Stokes vectors (pixels, bands, 3) of a truth's mask over its peak, and as whole frames."""

    mask: BoolArray
    peak: float

    @classmethod
    def of(cls, truth: Pictured) -> _Pixels:
        return cls(truth.mask, brightest(truth.image[truth.mask]))

    def scaled(self, stokes: FloatArray) -> Float64Array:
        return np.divide(stokes, self.peak, dtype=np.float64)

    def frame(self, values: FloatArray) -> Float64Array:
        """Values of the mask's pixels as a picture that is zero everywhere else."""
        picture = np.zeros((*self.mask.shape, *values.shape[1:]))
        picture[self.mask] = values
        return picture


def _metric(
    truth: Pictured, compare: Callable[[_Pixels, Float64Array, Float64Array], Values]
) -> StokesMetric:
    """A metric from a function of the estimated and the true Stokes vectors."""
    pixels = _Pixels.of(truth)
    s3, s3_noise = (getattr(truth, name, None) for name in ("s3", "s3_noise"))
    noise = _with_s3(truth.specular_noise + truth.diffuse_noise, s3_noise)[truth.mask]
    stokes = _with_s3(truth.stokes, s3)[truth.mask]
    true = pixels.scaled(stokes)
    noises = compare(pixels, pixels.scaled(stokes + noise), true)

    def measure(estimated: FloatArray, _change: FloatArray | None = None) -> Iterator[MetricValue]:
        whole = estimated if s3 is None else _with_s3(estimated, np.zeros_like(estimated[..., 0]))
        for name, value in compare(pixels, pixels.scaled(whole), true).items():
            yield MetricValue(name, value, noises.get(name, 0.0))

    return measure


def _with_s3(stokes: FloatArray, s3: FloatArray | None) -> FloatArray:
    """Stokes vectors (..., 4), or (..., 3) where the truth has no fourth component."""
    return stokes if s3 is None else np.concatenate([stokes, s3[..., None]], axis=-1)


def polaranything(truth: Pictured) -> StokesMetric:
    """Errors of AoLP and DoLP, PSNR and SSIM of the encoded polarisation, as in PolarAnything.

    Stokes vectors are averaged over the channels first. The angle counts alike wherever the mask
    is, dark or unpolarised; where nothing is polarised it is 0.
    """
    return _metric(truth, _polaranything)


def _polaranything(pixels: _Pixels, estimated: Float64Array, true: Float64Array) -> Values:
    mean_estimate, mean_true = estimated.mean(axis=1), true.mean(axis=1)
    degrees = [polarisation.dolp(s).clip(0.0, 1.0) for s in (mean_estimate, mean_true)]
    angle = angle_between(polarisation.aolp(mean_estimate), polarisation.aolp(mean_true))
    error = PixelSums.of(degrees[0] - degrees[1])
    codes = encoded(mean_estimate), encoded(mean_true)
    pictures = pixels.frame(codes[0]), pixels.frame(codes[1])
    return {
        "polaranything_aolp_deg": math.degrees(PixelSums.of(angle).mean),
        "polaranything_dolp_mae": PixelSums.of(np.abs(degrees[0] - degrees[1])).mean,
        "polaranything_dolp_mse": error.mean_square,
        "polaranything_psnr": psnr(PixelSums.of(codes[0] - codes[1])),
        "polaranything_ssim": _ssim(*pictures, 1.0, pixels.mask),
    }


def encoded(stokes: FloatArray) -> FloatArray:
    """PolarAnything's encoding (..., 3) of Stokes vectors: sin 2φ, cos 2φ and DoLP, all in [0, 1].

    φ is the angle of polarisation, whose sine and cosine are moved from [−1, 1] to [0, 1].

    Examples
    --------
    >>> encoded(np.array([1.0, 0.0, 0.5])).round(12).tolist()
    [1.0, 0.5, 0.5]
    """
    angle = 2.0 * polarisation.aolp(stokes)
    degree = polarisation.dolp(stokes).clip(0.0, 1.0)
    return np.stack([(np.sin(angle) + 1.0) / 2.0, (np.cos(angle) + 1.0) / 2.0, degree], axis=-1)


def rgb2pol(truth: Pictured) -> StokesMetric:
    """PSNR and SSIM of each polarised Stokes component as an 8-bit picture, and their mean.

    As in the RGB-to-Polarization benchmark: the whole picture of a component, all channels
    together, is scaled so that the truth's smallest value is code 0 and its largest 255; estimates
    are coded on the truth's scale and clipped to it. Codes are not rounded. A component that is
    constant in the truth has no such scale and is left out, also of the mean.
    """
    return _metric(truth, _rgb2pol)


def _rgb2pol(pixels: _Pixels, estimated: Float64Array, true: Float64Array) -> Values:
    values: Values = {}
    for k in range(1, true.shape[-1]):
        component = pixels.frame(true[..., k])
        low, high = component.min(), component.max()
        if high == low:
            continue
        guess = ((pixels.frame(estimated[..., k]) - low) / (high - low)).clip(0.0, 1.0) * CODES
        codes = (component - low) / (high - low) * CODES
        values[f"rgb2pol_psnr_s{k}"] = psnr(PixelSums.of((guess - codes) / CODES))
        values[f"rgb2pol_ssim_s{k}"] = _ssim(guess, codes, CODES)
    for name in ("psnr", "ssim"):
        parts = [value for key, value in values.items() if key.startswith(f"rgb2pol_{name}")]
        if parts:
            values[f"rgb2pol_{name}"] = float(np.mean(parts))
    return values


def polarscale(truth: Pictured) -> StokesMetric:
    """PSNR of the polarised Stokes components, AoLP error and share of impossible pixels.

    As in PolarScale: components are divided by the largest s0 of the scene, the PSNR has a peak of
    1 and is of the whole picture, all components and channels together; the angle counts where the
    true degree of polarisation is above 0.1, channel by channel, and has no value where none is;
    impossible is √(s1² + s2² + s3²) > s0, by more than float32 rounds, or not finite. What they
    call self-consistency is of degrees and angles given beside Stokes vectors: ours follow.
    """
    return _metric(truth, _polarscale)


def _polarscale(pixels: _Pixels, estimated: Float64Array, true: Float64Array) -> Values:
    # The peak of the mask's pixels is the largest s0: everything is divided by it already.
    difference = estimated[..., 1:] - true[..., 1:]
    sums = PixelSums.of(difference)
    everywhere = pixels.mask.size * difference[0].size
    counted = polarisation.dolp(true) > POLARISED_ABOVE
    angles = angle_between(polarisation.aolp(estimated), polarisation.aolp(true))[counted]
    length = np.linalg.norm(estimated[..., 1:], axis=-1)
    slack = 8.0 * float(np.finfo(np.float32).eps)
    possible = length <= estimated[..., 0] * (1.0 + slack)  # False where not finite
    impossible = (~possible).sum()
    values = {
        "polarscale_psnr": psnr(PixelSums(everywhere, sums.total, sums.squares)),
        "polarscale_impossible": float(impossible) / (pixels.mask.size * true.shape[1]),
        "polarscale_aolp_pixels": float(counted.sum()),
    }
    if len(angles):
        values["polarscale_aolp_deg"] = math.degrees(PixelSums.of(angles).mean)
    return values


def _ssim(a: Float64Array, b: Float64Array, peak: float, mask: BoolArray | None = None) -> float:
    """Mean structural similarity, Gaussian window, of pictures (height, width, channels).

    Windows that leave the picture are left out. With a mask, the mean is over its pixels.
    """
    from skimage.metrics import structural_similarity

    if min(a.shape[:2]) < WINDOW:
        size = "×".join(map(str, a.shape[:2]))
        raise InputError("profile", f"at least {WINDOW} pixels a side", size, "leave it out")
    mean, similarity = structural_similarity(
        a, b, data_range=peak, channel_axis=-1, gaussian_weights=True, sigma=SIGMA,
        use_sample_covariance=False, full=True,
    )  # fmt: skip
    return float(mean if mask is None else similarity[mask].mean())


PROFILES: Mapping[str, Callable[[Pictured], StokesMetric]] = {
    "profile:polaranything": polaranything,
    "profile:rgb2pol": rgb2pol,
    "profile:polarscale": polarscale,
}
"""Profiles by the name that `metrics` of a suite and `malus score` take."""
