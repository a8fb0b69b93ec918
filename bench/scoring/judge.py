"""One method on one truth: errors, skill and violations, whole and by band and angle."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from malus.bench.scoring.field_agreement import ALONG, ENERGY, ERROR, TRIVIAL, Agreement
from malus.bench.scoring.masked_pixels import MaskedPixels
from malus.bench.scoring.metrics import (
    Error,
    Floats,
    Image,
    Residuals,
    brightest,
    cos_zenith,
    nmse_by,
    skill,
    skills,
)
from malus.bench.scoring.pixel_kernels import (
    Form,
    Planes,
    count_violations,
    difference_sums,
    products,
)
from malus.reconstruct import Components, Method, get_method
from malus.renderers.truth import Truth
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import PAPER_ANGLES_DEG, angle_weights


class Value(NamedTuple):
    """One number of a results table; band and angle are None where it is over all of them."""

    metric: str
    value: float
    noise: float = 0.0
    band_nm: float | None = None
    angle_deg: float | None = None


Measure = Callable[[Image], Iterable[Value]]
"""What a further metric says of the Stokes vectors (pixels, bands, 3) of the mask's pixels."""

Metric = Callable[[Truth], Measure]
"""A further metric: told the truth, it does what all methods share. See `extra_metrics`."""


@dataclass(frozen=True)
class Score:
    """A method's residuals on one truth and their noise, with those of the trivial guess.

    Attributes
    ----------
    residuals, noise : Residuals
        Of the method on the whole truth, and of the change that one draw of the Monte Carlo noise
        makes to its residual.
    trivial, trivial_noise : Residuals
        The same for the guess I(ϑ) = I/2.
    violations, invalid : int
        Pixels whose estimate is unphysical, and whose inputs were so that there is none.
    agreement : Agreement
        Slope and rotation of the estimated against the true field.
    extra : tuple of Value
        Of the further metrics that were asked for.
    converged : bool or None
        As the method says of its own search; None where it searches nothing.
    """

    residuals: Residuals
    noise: Residuals
    trivial: Residuals
    trivial_noise: Residuals
    violations: int
    invalid: int
    wavelengths_nm: tuple[float, ...]
    agreement: Agreement
    extra: tuple[Value, ...] = ()
    converged: bool | None = None

    @property
    def nmse(self) -> float:
        """Normalised mean squared error, Monte Carlo noise included."""
        return self.residuals.nmse()

    @property
    def skill(self) -> float:
        """1 is perfect, 0 no better than "unpolarised"; NaN where that guess is pure noise."""
        method = Error(self.residuals.nmse(), self.noise.nmse())
        trivial = Error(self.trivial.nmse(), self.trivial_noise.nmse())
        return skill(method, trivial, self.residuals.pixels)

    def values(self) -> Iterator[Value]:
        """Everything for the results table."""
        parts = (self.residuals, self.noise, self.trivial, self.trivial_noise)
        by_set = nmse_by(parts, _ANGLE_SETS)
        # Over all, for every angle, for every band.
        nmse, noise, guess, guess_noise = np.hstack([by_set.mean(axis=2), by_set[:, 0]])
        worth = skills(nmse - noise, guess - guess_noise, guess_noise, self.residuals.pixels)
        angles, bands = PAPER_ANGLES_DEG, self.wavelengths_nm
        places = [(None, None), *((None, a) for a in angles), *((b, None) for b in bands)]
        errors = zip(places, nmse.tolist(), noise.tolist(), worth.tolist(), strict=True)
        for (band, angle), error, floor, skilled in errors:
            yield Value("nmse", error, floor, band, angle)
            yield Value("skill", skilled, 0.0, band, angle)
        yield Value("gain", *self.agreement.gain)
        yield Value("rotation", *self.agreement.rotation)
        yield Value("facing_skill", *self.agreement.facing_skill)
        yield Value("signal", *self.agreement.signal)
        yield Value("violations", float(self.violations))
        yield Value("invalid", float(self.invalid))
        if self.converged is not None:
            yield Value("converged", float(self.converged))
        yield from self.extra


_ANGLE_SETS = (PAPER_ANGLES_DEG, *((angle,) for angle in PAPER_ANGLES_DEG))


class Judge:
    """Scores methods on one truth; what they share is computed once.

    Examples
    --------
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
        self._measures: dict[Metric, Measure] = {}
        self.sight = MaskedPixels.of(truth)
        known = self.sight.known
        self.peak = brightest(known.image[0])
        self.facing = np.square(np.square(cos_zenith(truth)))  # see Agreement.facing_skill
        self.draws = np.empty((5, len(self.sight.pixels)))
        nothing = np.zeros_like(self.sight.true)
        moments, (along, _, error) = self._sums((known.image, nothing, nothing))
        self.guess = self._residuals(moments)
        # The guess lacks the whole field: its product with that is minus the field's energy.
        self.totals = -along, error
        self.draws[ENERGY], self.draws[TRIVIAL] = -self.draws[ALONG], self.draws[ERROR]

    def score(self, method: Method, metrics: Sequence[Metric] = ()) -> Score:
        """The score of one method; raises Inapplicable where it cannot work on this truth.

        `metrics` are further ones that cost more than those that every score has.
        """
        return self.score_estimate(self.sight.estimate(method), metrics)

    def score_estimate(self, estimate: Components, metrics: Sequence[Metric] = ()) -> Score:
        """The score of what a method made of this truth's sight."""
        moments, totals = self._sums((estimate.image, estimate.s1, estimate.s2))
        scale = self.peak**2
        residuals, noise = self._residuals(moments)
        return Score(
            residuals,
            noise,
            *self.guess,
            self._violations(estimate),
            estimate.invalid(self.sight.as_rendered),
            self.truth.scene.wavelengths_nm,
            Agreement(
                np.array([*totals, *self.totals]) / scale,
                products(self.draws) / scale**2,
                self.sight.true[0].size,
            ),
            tuple(self._extra(estimate, metrics)) if metrics else (),
            estimate.converged,
        )

    def _extra(self, estimate: Components, metrics: Sequence[Metric]) -> Iterator[Value]:
        stokes = np.stack([estimate.image[0], estimate.s1[0], estimate.s2[0]], axis=-1)
        for metric in metrics:
            if metric not in self._measures:
                self._measures[metric] = metric(self.truth)
            yield from self._measures[metric](stokes)

    def _sums(self, estimate: Planes) -> tuple[Floats, Floats]:
        """Moments and totals; the draws of these totals are written."""
        known = self.sight.known.image, self.sight.true, self.sight.draw
        image, s1, s2 = (np.ascontiguousarray(plane) for plane in estimate)
        return difference_sums((image, s1, s2), known, self.facing, _form(), self.draws)

    def _residuals(self, moments: Floats) -> tuple[Residuals, Residuals]:
        """Of an estimate, and of what one draw of the noise changes in it."""
        pixels = self.sight.true.shape[1]
        whole, change = (Residuals.of_products(part, self.peak, pixels) for part in moments)
        return whole, change

    def _violations(self, estimate: Components) -> int:
        planes = estimate.image[0], estimate.s1[0], estimate.s2[0]
        # A few rounding errors of the dtype are allowed.
        slack = 1.0 + 8.0 * float(np.finfo(planes[0].dtype).eps)
        return count_violations(*planes, self.sight.known.image[0], slack)


@functools.cache
def _form() -> Form:
    a, b, c, d, e, f = angle_weights()[np.triu_indices(3)].tolist()
    return a, b, c, d, e, f


def score(truth: Truth, method: Method | str) -> Score:
    """Score one method, or the method of that name, on one truth."""
    return Judge(truth).score(get_method(method) if isinstance(method, str) else method)
