"""Detect predictions in another convention or unit, from the images themselves.

Each common mistake is made on the true s1 and s2: angles counted otherwise, s1 and s2 exchanged,
an angle doubled or in another unit, other frames, a division by s0, 8-bit codes in place of
radiance. If the
predictions are several times nearer to the result than to the truth, their maker probably made that
mistake. All that is needed are sums that can be added over scenes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from malus.bench.datasets.frame_mistakes import frame_turns
from malus.bench.scoring.metrics import peak
from malus.renderers.truth import Truth
from malus.scenes import polarisation
from malus.scenes.core.arrays import FloatArray

_BETTER = 4.0
"""Factor by which another convention must fit better before it is suspected. A bad method in the
right convention seldom fits twice as well in a wrong one; a good method in a wrong convention fits
tens of times better."""
_SCALE = (0.8, 1.25)
"""Factors between predicted and true intensity that a method may have without a remark."""
_TOO_STRONG = 4.0
"""Factor between predicted and true s1 and s2 that no method has that keeps DoLP below 1."""
_OF_BYTES = (1 / 300, 1 / 200)
"""Factors that a division by 255 too many leaves, give or take what a method gets wrong."""
_SAMPLE = 30_000
"""Values of a scene that are compared with each mistake: many more would tell no more."""

Mistake = Callable[[FloatArray, FloatArray], FloatArray]
"""What s1 and s2 (n, 2) become of true and of predicted Stokes vectors (n, 3)."""


def _with_signs(sign1: float, sign2: float, exchanged: bool = False) -> Mistake:
    """Other signs of s1 and s2, and s1 in the place of s2."""
    order = [2, 1] if exchanged else [1, 2]
    return lambda true, _: true[:, order] * np.array([sign1, sign2])


def _with_phase(angle_of: Callable[[FloatArray], FloatArray]) -> Mistake:
    """s1 and s2 of another polariser angle ψ, which is made of the true Stokes vectors."""

    def mistaken(true: FloatArray, _: FloatArray) -> FloatArray:
        half = polarisation.polarised_intensity(true) / 2
        return polarisation.stokes_from_extremes(half, -half, angle_of(true))[:, 1:]

    return mistaken


def _aolp_times(factor: float) -> list[Mistake]:
    """The angle of polarisation times a factor, before it is doubled; in the usual ranges.

    In [0, π) and in (−π/2, π/2], from the horizontal and from the vertical.
    """

    def centred(angle: FloatArray) -> FloatArray:
        return np.where(angle > np.pi / 2, angle - np.pi, angle)

    quarter = np.pi / 2  # ψ is a quarter turn from AoLP
    return [
        _with_phase(lambda true: factor * polarisation.aolp(true) + quarter),
        _with_phase(lambda true: factor * centred(polarisation.aolp(true)) + quarter),
        _with_phase(lambda true: factor * polarisation.phase(true)),
        _with_phase(lambda true: factor * centred(polarisation.phase(true))),
    ]


def _over_s0(true: FloatArray) -> FloatArray:
    """True s1/s0 and s2/s0 (n, 2), 0 where there is no light."""
    return np.divide(
        true[:, 1:], true[:, :1], out=np.zeros_like(true[:, 1:]), where=true[:, :1] > 0
    )


def _coded(zero: float, values: Callable[[FloatArray], FloatArray]) -> Mistake:
    """Codes that stand at `zero` where nothing is polarised, with the steps that fit best."""

    def mistaken(true: FloatArray, predicted: FloatArray) -> FloatArray:
        polarised = values(true)
        square = float(np.sum(polarised**2))
        step = float(np.sum((predicted[:, 1:] - zero) * polarised)) / square if square else 0.0
        return zero + step * polarised

    return mistaken


def _radiance(true: FloatArray) -> FloatArray:
    return true[:, 1:]


_DEGREE = np.pi / 180

MISTAKES: dict[str, list[Mistake]] = {
    "turned by 90°: angles are counted from the vertical": [_with_signs(-1, -1)],
    "with s2 negated: angles are anticlockwise as displayed, rows from the top": [
        _with_signs(1, -1)
    ],
    "with s1 negated: angles are anticlockwise from the vertical as displayed": [
        _with_signs(-1, 1)
    ],
    "with s1 and s2 exchanged: s1 is light along +x, s2 at +45°": [
        _with_signs(1, 1, exchanged=True),
        _with_signs(-1, -1, exchanged=True),
    ],
    "turned by 45°: s1 is light along +x, s2 at +45°": [
        _with_signs(-1, 1, exchanged=True),
        _with_signs(1, -1, exchanged=True),
    ],
    "multiplied by s0: they seem to be divided by it": [lambda true, _: _over_s0(true)],
    "with half the angle: the angle of polarisation seems to be doubled once too often": (
        _aolp_times(2.0)
    ),
    "with twice the angle: s1 and s2 go with cosine and sine of twice the angle of polarisation": (
        _aolp_times(0.5)
    ),
    "with the angle in radians: its degrees seem to be taken for radians": (
        _aolp_times(1 / _DEGREE)
    ),
    "with the angle in radians: it seems to be converted from degrees once too often": (
        _aolp_times(_DEGREE)
    ),
    "taken as 8-bit codes about 127.5: they are radiances, 0 without polarisation": [
        _coded(zero, values) for zero in (127.5, 128.0) for values in (_radiance, _over_s0)
    ],
    "taken as codes about 0.5: they are radiances, 0 without polarisation": [
        _coded(0.5, values) for values in (_radiance, _over_s0)
    ],
}
"""What fits better, in words, and the mistakes that it points to; likelier ones first."""


def _in_frame(true: FloatArray, turn: FloatArray, bands: int, every: int) -> FloatArray:
    """Stokes vectors (n, 3) in frames turned by an angle a pixel, for each of them in a sample."""
    return polarisation.in_turned_frame(true, np.repeat(turn, bands)[::every])


@dataclass(frozen=True)
class ConventionSums:
    """Sums over pixels, bands and scenes, relative to the peak of each scene.

    Attributes
    ----------
    predicted, true : float
        Σ s1² + s2² of the prediction and of the truth.
    cross : float
        Σ of predicted times true s1 and s2.
    cross0, true0 : float
        Σ of predicted times true s0, and of true s0².
    as_is : float
        Σ of squared differences of s1 and s2 from the truth, over a sample of the pixels.
    mistaken : dict of str to tuple of float
        The same from the truth with each of `MISTAKES`, and in the frames of `frame_turns`.
    """

    predicted: float = 0.0
    true: float = 0.0
    cross: float = 0.0
    cross0: float = 0.0
    true0: float = 0.0
    as_is: float = 0.0
    mistaken: dict[str, tuple[float, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, predicted: FloatArray, truth: Truth) -> ConventionSums:
        """Sums over a scene's mask, relative to the peak so that scenes weigh the same."""
        with np.errstate(over="ignore", invalid="ignore"):  # numbers near the largest that there is
            return cls._of(predicted, truth)

    @classmethod
    def _of(cls, predicted: FloatArray, truth: Truth) -> ConventionSums:
        weight = 1.0 / peak(truth) ** 2
        p = predicted[truth.mask].astype(np.float64).reshape(-1, 3)
        t = truth.stokes[truth.mask].astype(np.float64).reshape(-1, 3)
        sums = cls(
            predicted=weight * float(np.sum(p[:, 1:] ** 2)),
            true=weight * float(np.sum(t[:, 1:] ** 2)),
            cross=weight * float(np.sum(p[:, 1:] * t[:, 1:])),
            cross0=weight * float(np.sum(p[:, 0] * t[:, 0])),
            true0=weight * float(np.sum(t[:, 0] ** 2)),
        )
        every = -(-len(t) // _SAMPLE) or 1
        bands = truth.stokes.shape[2]
        p, t, weight = p[::every], t[::every], weight * every
        return replace(
            sums,
            as_is=weight * float(np.sum((p - t)[:, 1:] ** 2)),
            mistaken={
                words: tuple(
                    weight * float(np.sum((p[:, 1:] - mistake(t, p)) ** 2)) for mistake in kinds
                )
                for words, kinds in MISTAKES.items()
            }
            | {
                words: tuple(
                    weight * float(np.sum((p - _in_frame(t, turn, bands, every))[:, 1:] ** 2))
                    for turn in turns
                )
                for words, turns in frame_turns(truth).items()
            },
        )

    def __add__(self, other: ConventionSums) -> ConventionSums:
        """Sums over the scenes of both."""
        numbers = ("predicted", "true", "cross", "cross0", "true0", "as_is")
        total = {name: getattr(self, name) + getattr(other, name) for name in numbers}
        if not self.mistaken or not other.mistaken:
            return ConventionSums(**total, mistaken=self.mistaken or other.mistaken)
        both = {
            words: tuple(map(sum, zip(sums, other.mistaken[words], strict=True)))
            for words, sums in self.mistaken.items()
        }
        return ConventionSums(**total, mistaken=both)

    def suspicions(self) -> Iterator[str]:
        """What looks like a mistake of convention or unit, one sentence each.

        Examples
        --------
        >>> turned, *_ = MISTAKES
        >>> sums = ConventionSums(1, 1, -1, 2, 1, as_is=4, mistaken={turned: (0.0,)})
        >>> print(*sums.suspicions(), sep="; ")
        s1 and s2 fit the truth 1000+ times better turned by 90°: angles are counted from the
        vertical; intensities are 2 times those of the scenes
        """
        intensity = self.cross0 / self.true0 if self.true0 > 0.0 else 1.0
        if self.true > 0.0 and self.predicted > 0.0:
            yield from self._mistake()
            yield from self._too_strong(intensity)
        if not _SCALE[0] <= intensity <= _SCALE[1]:
            yield f"intensities are {intensity:.3g} times those of the scenes"

    def _mistake(self) -> Iterator[str]:
        """The mistake that fits best, where it fits much better than the truth at any scale."""
        # Fits to better than a thousandth are all alike: rounding decides between them.
        floor = max(1e-3 * self.as_is, 1e-300)
        residuals = {words: max(min(sums), floor) for words, sums in self.mistaken.items()}
        best = min(residuals, key=residuals.__getitem__, default=None)
        better = self.as_is / residuals[best] if best is not None else 0.0
        only_scaled = best is not None and self._left() < _BETTER * residuals[best]
        if better > _BETTER and not only_scaled:
            times = f"{better:.0f}" if better < 999 else "1000+"
            yield f"s1 and s2 fit the truth {times} times better {best}"

    def _too_strong(self, intensity: float) -> Iterator[str]:
        """s1 and s2 of another scale than s0, where they are those of the truth otherwise."""
        factor = self.cross / self.true
        fits = self.predicted + self.true - 2.0 * self.cross > _BETTER * self._left()
        as_intensity = _SCALE[0] <= factor / intensity <= _SCALE[1] if intensity > 0 else False
        unlikely = factor > _TOO_STRONG or _OF_BYTES[0] < factor < _OF_BYTES[1]
        if fits and unlikely and not as_intensity:
            yield f"s1 and s2 are {factor:.3g} times those of the scenes"

    def _left(self) -> float:
        """Σ of squared differences of s1 and s2 from the truth times the factor that fits best."""
        factor = max(self.cross, 0.0) / self.true
        return max(self.predicted - factor * self.cross, 0.0)
