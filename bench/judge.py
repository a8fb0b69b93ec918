"""One method on one truth: errors, skill and violations, whole and by band and angle."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from malus.bench.agreement import Agreement, TrueField
from malus.bench.metrics import (
    Error,
    Floats,
    Image,
    Residuals,
    Target,
    peak,
    skill,
    violations,
)
from malus.bench.view import observe
from malus.reconstruct import Components, Method, get_method
from malus.renderers.truth import Truth
from malus.scenes.polarisation import PAPER_ANGLES_DEG


@dataclass(frozen=True)
class Value:
    """One number of a results table; band and angle are None where it is over all of them."""

    metric: str
    value: float
    noise: float = 0.0
    band_nm: float | None = None
    angle_deg: float | None = None


Metric = Callable[[Components, Truth], Iterable[Value]]
"""A further metric: what it says of an estimate, given the truth. See `extra_metrics`."""


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
        sets = [PAPER_ANGLES_DEG, *((angle,) for angle in PAPER_ANGLES_DEG)]
        parts = (self.residuals, self.noise, self.trivial, self.trivial_noise)
        errors = np.stack([part.nmse_by(sets) for part in parts])
        yield from self._values(errors[:, 0].mean(axis=-1))
        yield Value("gain", *self.agreement.gain)
        yield Value("rotation", *self.agreement.rotation)
        yield Value("facing_skill", *self.agreement.facing_skill)
        yield Value("signal", *self.agreement.signal)
        for row, angle in enumerate(PAPER_ANGLES_DEG, start=1):
            yield from self._values(errors[:, row].mean(axis=-1), angle_deg=angle)
        for band, wavelength in enumerate(self.wavelengths_nm):
            yield from self._values(errors[:, 0, band], band_nm=wavelength)
        yield Value("violations", float(self.violations))
        yield Value("invalid", float(self.invalid))
        if self.converged is not None:
            yield Value("converged", float(self.converged))
        yield from self.extra

    def _values(
        self, errors: Floats, band_nm: float | None = None, angle_deg: float | None = None
    ) -> Iterator[Value]:
        """NMSE and skill from the four errors of method, noise, trivial guess and its noise."""
        nmse, noise, trivial, trivial_noise = (float(error) for error in errors)
        worth = skill(Error(nmse, noise), Error(trivial, trivial_noise), self.residuals.pixels)
        yield Value("nmse", nmse, noise, band_nm, angle_deg)
        yield Value("skill", worth, 0.0, band_nm, angle_deg)


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
    """

    def __init__(self, truth: Truth) -> None:
        self.truth = truth
        self.half = truth.halves()[0]
        self.targets = Target.of(truth), Target.of(self.half)
        self.peak = peak(truth)
        self.field = TrueField(truth, self.peak)
        guess = get_method("unpolarised")
        _, difference, change = self._differences(guess)
        self.trivial = Residuals.of(difference, self.peak), Residuals.of(change, self.peak)

    def score(self, method: Method, metrics: Sequence[Metric] = ()) -> Score:
        """The score of one method; raises Inapplicable where it cannot work on this truth.

        `metrics` are further ones that cost more than those that every score has.
        """
        estimate, difference, change = self._differences(method)
        return Score(
            Residuals.of(difference, self.peak),
            Residuals.of(change, self.peak),
            *self.trivial,
            violations(estimate, self.truth.image, self.truth.mask),
            estimate.invalid(self.truth.mask),
            self.truth.scene.wavelengths_nm,
            self.field.agreement(difference, change),
            tuple(value for metric in metrics for value in metric(estimate, self.truth)),
            estimate.converged,
        )

    def _differences(self, method: Method) -> tuple[Components, Image, Image]:
        """The estimate, what it misses by, and what one draw of the noise changes in that."""
        whole, half = self.targets
        estimate = method.reconstruct(observe(self.truth, method.needs))
        difference = whole.missed_by(estimate)
        # The half truth is this truth plus one draw of its noise, seen through the method.
        shifted = half.missed_by(method.reconstruct(observe(self.half, method.needs)))
        shifted -= difference
        return estimate, difference, shifted


def score(truth: Truth, method: Method | str) -> Score:
    """Score one method, or the method of that name, on one truth."""
    return Judge(truth).score(get_method(method) if isinstance(method, str) else method)
