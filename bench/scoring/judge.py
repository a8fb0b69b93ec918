"""Score of one method on one truth: errors, skill and violations, in all and by band and angle."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from malus.bench.scoring.calibration import calibration_values
from malus.bench.scoring.field_agreement import ALONG, ENERGY, ERROR, TRIVIAL, Agreement
from malus.bench.scoring.masked_pixels import MaskedPixels
from malus.bench.scoring.metric_value import MetricColumns, MetricValue, Place, StokesMetric
from malus.bench.scoring.metrics import (
    Error,
    Residuals,
    brightest,
    cos_zenith,
    nmse_by,
    skill,
    skills,
)
from malus.bench.scoring.own_range import OwnRange
from malus.bench.scoring.pixel_kernels import (
    QuadraticForm,
    ThreeImages,
    count_violations,
    difference_sums,
    products,
)
from malus.bench.scoring.unmixed_pixels import MixedPixels, Unmixed
from malus.reconstruct import Components, Method
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import PAPER_ANGLES_DEG, angle_weights

Metric = Callable[[Truth], StokesMetric]
"""A further metric: computes once a truth what all methods share, see `extra_metrics`."""


@dataclass(frozen=True)
class Score:
    """A method's residuals on one truth and their noise, with those of the trivial guess.

    Attributes
    ----------
    residuals, noise : Residuals
        Errors of the method's estimate, and their change by one draw of the Monte Carlo noise.
    trivial, trivial_noise : Residuals
        The same for the guess I(ϑ) = I/2.
    violations, invalid : int
        Numbers of pixels whose estimate is unphysical, and whose inputs allow no estimate.
    agreement : Agreement
        Slope and rotation of the estimated against the true field.
    extra : tuple of MetricValue
        Values of the further metrics that were asked for, after those of a stated deviation.
    converged : bool or None
        Whether the method's own search converged; None where it searches nothing.
    unmixed : Unmixed or None
        The same residuals without the pixels that see more than one normal; None where nobody
        measured which do.
    own_range : float
        Mean squared error with each polariser image, estimated and true, scaled to [0, 1] by its
        own least and largest value: `malus.bench.scoring.readings`. NaN for a flat image.

    Examples
    --------
    >>> import malus
    >>> scene = malus.Scene(
    ...     shape=malus.Sphere(),
    ...     surface=malus.Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...     light=malus.Distant(incidence_deg=60),
    ...     camera=malus.Camera(resolution=8),
    ... )
    >>> truth = malus.render(scene, renderer="torrance-sparrow")
    >>> result = malus.score(truth, "unpolarised")
    >>> result.skill, result.violations
    (0.0, 0)
    """

    residuals: Residuals
    noise: Residuals
    trivial: Residuals
    trivial_noise: Residuals
    violations: int
    invalid: int
    wavelengths_nm: tuple[float, ...]
    agreement: Agreement
    extra: tuple[MetricValue, ...] = ()
    converged: bool | None = None
    unmixed: Unmixed | None = None
    own_range: float = math.nan

    def __repr__(self) -> str:
        """The headline numbers, in one line."""
        return f"Score(skill={self.skill:.4g}, nmse={self.nmse:.4g}, violations={self.violations})"

    @property
    def nmse(self) -> float:
        """Normalised mean squared error, Monte Carlo noise included."""
        return self.residuals.nmse()

    @property
    def skill(self) -> float:
        """Skill: 1 is perfect, 0 no better than I(ϑ) = I/2; NaN where that guess is pure noise."""
        return _skill_of(self._four)

    @property
    def skill_unmixed(self) -> float:
        """Skill over the pixels of one normal; NaN where nobody measured which these are."""
        if self.unmixed is None:
            return math.nan
        return self.skill if not self.unmixed.mixed else _skill_of(self.unmixed.residuals)

    def values(self) -> Iterator[MetricValue]:
        """All rows of this score in the results table."""
        yield from values_of([self])[0].each()

    @property
    def _four(self) -> tuple[Residuals, Residuals, Residuals, Residuals]:
        return self.residuals, self.noise, self.trivial, self.trivial_noise


@np.errstate(over="ignore", invalid="ignore")  # what is no number is told as none
def values_of(scores: Sequence[Score]) -> list[MetricColumns]:
    """All rows of each score in the results table; the scores are of the same pixels.

    Errors and skills of all scores are computed at once.
    """
    errors = _errors([score._four for score in scores])
    skill = _skills(errors, scores[0].residuals.pixels)
    nmse, noise, *_ = errors
    unmixed = _skills_unmixed(scores, skill[:, 0])
    # Of every group first the error, then the skill.
    by_group = np.stack([nmse, skill], axis=-1).reshape(len(scores), -1)
    noise_by_group = np.stack([noise, np.zeros_like(noise)], axis=-1).reshape(len(scores), -1)
    rows = zip(scores, by_group, noise_by_group, unmixed, strict=True)
    return [_columns(*row) for row in rows]


def _columns(
    score: Score, by_group: Float64Array, noise_by_group: Float64Array, skill_unmixed: float
) -> MetricColumns:
    """All rows of one score, from errors and skills by group and their noise."""
    once = MetricColumns.of(
        [*_values_over_all(score), *_values_unmixed(score, skill_unmixed), *score.extra]
    )
    return MetricColumns(
        _joined(_group_places(score.wavelengths_nm), once.places),
        np.concatenate([by_group, once.value]),
        np.concatenate([noise_by_group, once.noise]),
    )


@functools.lru_cache(maxsize=64)
def _joined(first: tuple[Place, ...], second: tuple[Place, ...]) -> tuple[Place, ...]:
    """Both, as the same object for scores of the same kind."""
    return first + second


@functools.lru_cache(maxsize=64)
def _group_places(wavelengths_nm: tuple[float, ...]) -> tuple[Place, ...]:
    """NMSE and skill over all, for every angle, and for every band."""
    angles = [(None, angle) for angle in PAPER_ANGLES_DEG]
    groups = [(None, None), *angles, *((band, None) for band in wavelengths_nm)]
    return tuple((name, *group) for group in groups for name in ("nmse", "skill"))


def _values_over_all(score: Score) -> Iterator[MetricValue]:
    """The numbers that a score has once."""
    # Extremes have no noise that could be subtracted.
    yield MetricValue("nmse_own_range", score.own_range, math.nan)
    yield MetricValue("gain", *score.agreement.gain)
    yield MetricValue("rotation", *score.agreement.rotation)
    yield MetricValue("facing_skill", *score.agreement.facing_skill)
    yield MetricValue("signal", *score.agreement.signal)
    yield MetricValue("violations", float(score.violations))
    yield MetricValue("invalid", float(score.invalid))


def _values_unmixed(score: Score, skill: float) -> Iterator[MetricValue]:
    """The numbers that some scores have: of the pixels of one normal, and of a method's search."""
    if score.unmixed is not None:
        yield MetricValue("skill_unmixed", skill)
        yield MetricValue("mixed", float(score.unmixed.mixed))
    if score.converged is not None:
        yield MetricValue("converged", float(score.converged))


def _errors(residuals: Sequence[Sequence[Residuals]]) -> Float64Array:
    """NMSE of method, its noise, guess and its noise (4, scores, groups): all, angles, bands."""
    each = nmse_by([one for four in residuals for one in four], _ANGLE_SETS)
    by_angles = each.reshape(-1, 4, *each.shape[1:])
    groups = np.concatenate([by_angles.mean(axis=3), by_angles[:, :, 0]], axis=2)
    groups[np.isinf(groups)] = math.nan  # squares beyond double precision are no number either
    return np.moveaxis(groups, 1, 0)


def _skills(errors: Float64Array, pixels: int) -> Float64Array:
    """Skill (scores, groups) from `_errors`."""
    nmse, noise, guess, guess_noise = errors
    return skills(nmse - noise, guess - guess_noise, guess_noise, pixels)


def _skills_unmixed(scores: Sequence[Score], over_all: Float64Array) -> list[float]:
    """`Score.skill_unmixed` of each, from their skills over all pixels."""
    unmixed = [score.unmixed for score in scores if score.unmixed is not None]
    if len(unmixed) < len(scores) or not unmixed[0].mixed:
        return list(over_all.tolist())  # not told where it is unknown
    pixels = unmixed[0].residuals[0].pixels
    return list(_skills(_errors([one.residuals for one in unmixed]), pixels)[:, 0].tolist())


def _skill_of(residuals: Sequence[Residuals]) -> float:
    """Skill from the residuals of a method and its noise, of the trivial guess and its noise."""
    method, noise, trivial, trivial_noise = (one.nmse() for one in residuals)
    return skill(Error(method, noise), Error(trivial, trivial_noise), residuals[0].pixels)


_ANGLE_SETS = (PAPER_ANGLES_DEG, *((angle,) for angle in PAPER_ANGLES_DEG))


class Judge:
    """Score methods on one truth; what all of them share is computed once.

    Examples
    --------
    >>> from malus.reconstruct import get_method
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=16))
    >>> judge = Judge(render(scene, renderer="torrance-sparrow"))
    >>> round(judge.score(get_method("half_vector")).skill, 6)
    1.0

    Raises
    ------
    InputError
        If no pixel sees an object.
    """

    def __init__(self, truth: Truth) -> None:
        if not truth.mask.any():
            hint = "use more resolution, or a camera that is nearer"
            raise InputError(truth.scene.label, "an object that covers a pixel", "none", hint)
        self.truth = truth
        self._stokes_metrics: dict[Metric, StokesMetric] = {}
        self.pixels = MaskedPixels.of(truth)
        image = self.pixels.observation.image
        self.peak = brightest(image[0])
        self.facing = np.square(np.square(cos_zenith(truth)))  # see Agreement.facing_skill
        self.draws = np.empty((1, 5, len(self.pixels.indices)))
        unpolarised = np.zeros_like(self.pixels.true)
        estimate = image, unpolarised, unpolarised
        moments, ((along, _, error),) = self._sums(estimate)
        self.guess = self._residuals(moments)
        pixels = image, self.pixels.true, self.pixels.draw
        self.own_range = OwnRange(image, self.pixels.true)
        self.mixed = MixedPixels.of(truth, pixels, angle_form())
        self.guess_unmixed = None if self.mixed is None else self.mixed.without(moments, estimate)
        # The guess lacks the whole field: its product with that is minus the field's energy.
        self.totals = -along, error
        (draws,) = self.draws
        draws[ENERGY], draws[TRIVIAL] = -draws[ALONG], draws[ERROR]

    def score(self, method: Method, metrics: Sequence[Metric] = ()) -> Score:
        """Score one method, with further `metrics` besides those that every score has.

        Raises
        ------
        Inapplicable
            Where the method cannot work on this truth.
        """
        return self.score_estimate(self.pixels.estimate(method), metrics)

    @np.errstate(over="ignore", invalid="ignore")
    def score_estimate(self, estimate: Components, metrics: Sequence[Metric] = ()) -> Score:
        """Score an estimate (2, pixels, bands) that a method made of this truth's masked pixels."""
        components = estimate.image, estimate.s1, estimate.s2
        moments, (totals,) = self._sums(components)
        scale = self.peak**2
        residuals, noise = self._residuals(moments)
        return Score(
            residuals,
            noise,
            *self.guess,
            self._violations(estimate),
            estimate.invalid(self.pixels.as_rendered),
            self.truth.scene.wavelengths_nm,
            Agreement(
                np.array([*totals, *self.totals]) / scale,
                products(self.draws[0]) / scale**2,
                self.pixels.true[0].size,
            ),
            (*self._calibration(estimate), *self._extra(estimate, metrics)),
            estimate.converged,
            self._unmixed(moments, components),
            float(self.own_range.errors(estimate)[0]),
        )

    def _extra(self, estimate: Components, metrics: Sequence[Metric]) -> Iterator[MetricValue]:
        if not metrics:
            return
        stokes, change = self.pixels.stokes_of(estimate)
        for metric in metrics:
            if metric not in self._stokes_metrics:
                self._stokes_metrics[metric] = metric(self.truth)
            yield from self._stokes_metrics[metric](stokes, change)

    def _calibration(self, estimate: Components) -> Iterator[MetricValue]:
        """Stated against actual errors, of a method that states them."""
        if estimate.deviation is not None:
            pixels, estimated = self.pixels, np.stack([estimate.s1[0], estimate.s2[0]])
            image, stated = pixels.observation.image[0], estimate.deviation[0]
            yield from calibration_values(image, pixels.true, estimated, stated, pixels.draw)

    def _sums(self, estimate: ThreeImages) -> tuple[Float64Array, Float64Array]:
        """Moments and totals of an estimate, see `difference_sums`; `self.draws` is written."""
        truth = self.pixels.observation.image, self.pixels.true, self.pixels.draw
        image, s1, s2 = (np.ascontiguousarray(component) for component in estimate)
        return difference_sums((image, s1, s2), truth, self.facing, angle_form(), self.draws)

    def _residuals(self, moments: Float64Array, left_out: int = 0) -> tuple[Residuals, Residuals]:
        """Error moments of the estimate, and of its response to one draw of the noise."""
        count = self.pixels.true.shape[1] - left_out
        error, response = (Residuals.of_products(m, self.peak, count) for m in moments)
        return error, response

    def _unmixed(self, moments: Float64Array, estimate: ThreeImages) -> Unmixed | None:
        """Residuals over the pixels of one normal; None where these are unknown."""
        if self.mixed is None or self.guess_unmixed is None:
            return None
        count, kept = len(self.mixed.indices), self.mixed.without(moments, estimate)
        method, guess = self._residuals(kept, count), self._residuals(self.guess_unmixed, count)
        return Unmixed(count, (*method, *guess))

    def _violations(self, estimate: Components) -> int:
        components = estimate.image[0], estimate.s1[0], estimate.s2[0]
        counts = np.empty(1, np.int64)
        picture = self.pixels.observation.image[0]
        count_violations(*components, picture, rounding_slack(components[0].dtype), counts)
        return int(counts[0])


def rounding_slack(dtype: np.dtype[Any]) -> float:
    """The degree of polarisation that a few rounding errors of a type may lead to."""
    return 1.0 + 8.0 * float(np.finfo(dtype).eps)


@functools.cache
def angle_form() -> QuadraticForm:
    """The matrix of the mean squared error over the paper's polariser angles."""
    a, b, c, d, e, f = angle_weights()[np.triu_indices(3)].tolist()
    return a, b, c, d, e, f
