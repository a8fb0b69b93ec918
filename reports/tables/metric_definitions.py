"""What every metric of a results table means: definition, unit, direction and source."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

from malus.scenes.core.arrays import Float64Array

Number = TypeVar("Number", float, Float64Array)

Better = Literal["higher", "lower", "nearer 1", "nearer 0", ""]
"""Which values are better; empty where none is."""

OURS = "malus"
PAPER = "Gu, Huynh and Robles-Kelly"
POLARANYTHING = "PolarAnything (Zhang et al., ICCV 2025), paper and public code"
RGB2POL = "RGB-to-Polarization benchmark (NeurIPS 2025, Datasets and Benchmarks), public code"
POLARSCALE = "PolarScale (2026)"


@dataclass(frozen=True)
class MetricDefinition:
    """One metric of a results table, or several whose names match a pattern.

    Attributes
    ----------
    name : str
        As the column `metric` has it; `*` stands for what differs.
    label : str
        For the head of a table.
    unit : str
        Empty for a plain number.
    better : 'higher', 'lower', 'nearer 1', 'nearer 0' or ''
    definition, source : str
    asked_for : str
        What `metrics` of a suite has to name; empty where every score has it.

    Examples
    --------
    >>> definition_of("polaranything_psnr").unit
    'dB'
    """

    name: str
    label: str
    unit: str
    better: Better
    definition: str
    source: str = OURS
    asked_for: str = ""

    def matches(self, metric: str) -> bool:
        """Whether a metric of a table is this one."""
        pattern = ".*".join(map(re.escape, self.name.split("*")))
        return re.fullmatch(pattern, metric) is not None

    @property
    def arrow(self) -> str:
        """Direction of better values, for the head of a table."""
        return {"higher": "↑", "lower": "↓", "nearer 1": "→1", "nearer 0": "→0"}.get(
            self.better, ""
        )

    def best(self, values: Sequence[float]) -> float:
        """The best of some values.

        Examples
        --------
        >>> definition_of("nmse").best([0.2, 0.1]), definition_of("gain").best([0.2, 1.1])
        (0.1, 1.1)
        """
        return max(values, key=self.goodness)

    def goodness(self, value: Number) -> Number:
        """A value, or an array of values, turned so that larger is better."""
        ideal = {"nearer 1": 1.0, "nearer 0": 0.0}.get(self.better)
        if ideal is not None:
            return -abs(value - ideal)
        return value if self.better == "higher" else -value


def _of(source: str, asked_for: str, *lines: tuple[str, str, str, Better, str]) -> list[
    MetricDefinition
]:  # fmt: skip
    return [MetricDefinition(*line, source, asked_for) for line in lines]


_EVERY_SCORE = _of(
    OURS,
    "",
    ("nmse", "NMSE", "", "lower",
     "mean square of I(ϑ) − truth over pixels, bands and the paper's five polariser angles, over "
     "the squared peak of the unpolarised image"),
    ("skill", "skill", "", "higher",
     "1 − NMSE / NMSE of the guess I(ϑ) = I/2, noise subtracted from both: 1 is perfect, 0 no "
     "better than the guess; none where the noise is too large to tell it"),
    ("skill_unmixed", "skill, unmixed", "", "higher",
     "skill over the pixels that see one normal; none where nobody measured which do"),
    ("mixed", "mixed", "", "", "number of pixels that see more than one normal, of the scene"),
    ("gain", "gain", "", "nearer 1",
     "slope of the estimated (s1, s2) against the true ones, least squares"),
    ("rotation", "rotation", "", "nearer 0",
     "Σ s × ŝ / Σ s·s of the true and estimated (s1, s2): of a field turned by δ "
     "at equal strength sin 2δ (its gain is cos 2δ)"),
    ("facing_skill", "facing skill", "", "higher",
     "skill with squared errors weighted by cos⁴ of the angle between normal and view direction: "
     "surfaces facing the camera"),
    ("signal", "signal", "", "",
     "true polarised intensity over the peak, root mean square: of the scene, not of a method"),
    ("violations", "violations", "", "lower",
     "number of pixels whose estimate is unphysical in some band: polarised beyond all light, "
     "I_max + I_min other than I, or not finite"),
    ("invalid", "invalid", "", "lower", "number of pixels whose inputs allow no estimate"),
    ("converged", "converged", "", "higher", "1 where the method's own search converged"),
    ("calibration", "calibration", "", "nearer 1",
     "mean of the squared error of s1/s0 and s2/s0 over the variance that the method states, where "
     "light is above 1 % of the peak: more than 1 is too sure"),
    ("deviation_rank", "stated error's rank", "", "higher",
     "rank correlation (Spearman), over pixels and bands, of the deviation that the method states "
     "with its actual error: 1 where it knows exactly where it errs"),
    ("inapplicable", "inapplicable", "", "lower", "1 where the method cannot work on the scene"),
)  # fmt: skip

_CAPTURES = [
    *_of(OURS, "",
         ("scale", "scale", "", "nearer 1",
          "of real captures: factor on the estimated s1 and s2 that fits the true ones best; below "
          "0 they are turned by 90°"),
         ("scaled_skill", "skill at the best scale", "", "higher",
          "of real captures: skill after that factor"),
         ("nmse_object_*", "NMSE of an object", "", "lower",
          "of one of several objects in a capture"),
         ("skill_object_*", "skill on an object", "", "higher",
          "of one of several objects in a capture")),
    *_of(PAPER + ", Figure 5, a reading of “normalised”", "",
         ("nmse_own_range", "NMSE, own range", "", "lower",
          "mean square error with each polariser image, estimated and true, scaled to [0, 1] by "
          "its own smallest and largest value")),
]  # fmt: skip

_COLOUR = [
    *_of(PAPER + ", Table I", "delta_e76",
         ("delta_e76*", "ΔE76", "", "lower",
          "colour difference CIE 1976 of I_max, I_min or I(ϑ), mean over pixels and, `_std`, its "
          "standard deviation; 2.3 is just noticeable")),
    *_of("CIE 142-2001", "delta_e2000",
         ("delta_e2000*", "ΔE2000", "", "lower",
          "colour difference CIEDE2000 of I_max, I_min or I(ϑ), mean over pixels and, `_std`, its "
          "standard deviation")),
]  # fmt: skip

_POLARISATION = [
    *_of(OURS, "polarisation",
         ("dolp_mae", "DoLP MAE", "", "lower",
          "mean absolute error of the degree of linear polarisation over pixels and bands"),
         ("aolp_mae_deg", "AoLP MAE", "°", "lower",
          "mean absolute error of the angle of linear polarisation modulo 180°, weighted by true "
          "polarised intensity"),
         ("s1_rmse", "s1 RMSE", "", "lower", "root mean square error of s1 over the peak"),
         ("s2_rmse", "s2 RMSE", "", "lower", "root mean square error of s2 over the peak"),
         ("s3_rmse", "s3 RMSE", "", "lower", "root mean square of the true s3 over the peak, which "
          "methods do not estimate, where a truth has it"),
         ("nmse_i_max", "NMSE of I_max", "", "lower", "mean square error of I_max over peak²"),
         ("nmse_i_min", "NMSE of I_min", "", "lower", "mean square error of I_min over peak²")),
    *_of(OURS, "psnr", ("psnr", "PSNR of I(ϑ)", "dB", "higher",
         "−10 log10 of the mean square error of I(ϑ) over the peak of the unpolarised image")),
    *_of("Wang et al., IEEE TIP 13 (2004)", "ssim", ("ssim", "SSIM of I(ϑ)", "", "higher",
         "structural similarity of I(ϑ), 7 × 7 window, mean over the mask, bands and angles")),
    *_of(OURS, "zenith",
         ("nmse_zenith_*", "NMSE by zenith", "", "lower", "NMSE of pixels in a bin of the angle "
          "between normal and view, degrees"),
         ("skill_zenith_*", "skill by zenith", "", "higher", "skill of the pixels in such a bin")),
]  # fmt: skip

_PROFILES = [
    *_of(POLARANYTHING, "profile:polaranything",
         ("polaranything_aolp_deg", "AoLP MAE", "°", "lower",
          "Stokes averaged over channels; min(|Δ|, 180° − |Δ|), mean over the mask, unweighted: "
          "dark and unpolarised pixels count alike, an angle of nothing is 0"),
         ("polaranything_dolp_mae", "DoLP MAE", "", "lower",
          "Stokes averaged over channels; absolute error of DoLP clipped to [0, 1], over the mask "
          "(as the paper words it)"),
         ("polaranything_dolp_mse", "DoLP MSE", "", "lower",
          "the same, squared (as the public code computes it)"),
         ("polaranything_psnr", "PSNR (encoded)", "dB", "higher",
          "of the picture (sin 2φ + 1, cos 2φ + 1, 2 DoLP) / 2, peak 1, over the mask"),
         ("polaranything_ssim", "SSIM (encoded)", "", "higher",
          "of the same picture, 0 off the mask; 11 × 11 Gaussian, σ 1.5, mean over the mask")),
    *_of(RGB2POL, "profile:rgb2pol",
         ("rgb2pol_psnr", "PSNR", "dB", "higher",
          "mean of those of the components s1, s2 (and s3) that vary in the truth"),
         ("rgb2pol_ssim", "SSIM", "", "higher",
          "mean of those of the components s1, s2 (and s3) that vary in the truth"),
         ("rgb2pol_psnr_s*", "PSNR of a component", "dB", "higher",
          "20 log10(255 / RMSE) of the whole picture, all channels; coded 0 … 255 between the "
          "truth's smallest and largest value, estimates clipped, black off the mask"),
         ("rgb2pol_ssim_s*", "SSIM of a component", "", "higher",
          "of the same codes, 11 × 11 Gaussian, σ 1.5, windows inside the picture, mean of "
          "channels")),
    *_of(POLARSCALE, "profile:polarscale",
         ("polarscale_psnr", "PSNR", "dB", "higher",
          "s1, s2 (and s3) over the scene's largest s0, peak 1, whole picture, all channels and "
          "components; black off the mask"),
         ("polarscale_aolp_deg", "AoLP MAE", "°", "lower",
          "modulo 180°, mean over pixels and channels whose true DoLP is above 0.1; no value "
          "where there is none"),
         ("polarscale_aolp_pixels", "AoLP pixels", "", "",
          "number of pixels and channels behind polarscale_aolp_deg"),
         ("polarscale_impossible", "impossible", "", "lower",
          "share of the picture's pixels and channels with √(s1² + s2² + s3²) > s0")),
]  # fmt: skip

DEFINITIONS: tuple[MetricDefinition, ...] = (
    *_EVERY_SCORE, *_CAPTURES, *_COLOUR, *_POLARISATION, *_PROFILES,
)  # fmt: skip
"""Metrics in the order in which they are told."""


def definition_of(metric: str) -> MetricDefinition:
    """The definition of a metric of a table; one without words where nobody defined it.

    Examples
    --------
    >>> definition_of("skill_zenith_0_15").label, definition_of("of_a_plugin").label
    ('skill by zenith', 'of_a_plugin')
    """
    exact = (one for one in DEFINITIONS if one.name == metric)
    matching = (one for one in DEFINITIONS if one.matches(metric))
    unknown = MetricDefinition(metric, metric, "", "", "")
    return next(exact, None) or next(matching, None) or unknown
