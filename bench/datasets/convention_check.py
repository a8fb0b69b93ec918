"""Detect predictions that are rotated, mirrored or rescaled, from the images themselves.

Turning all angles by 90° negates s1 and s2; counting them clockwise, or rows from the bottom,
negates s2. If predictions fit the truth several times better after such a change than as they
are, their maker probably counts otherwise. All that is needed are sums that can be added.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from malus.bench.scoring.metrics import peak
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import FloatArray

_BETTER = 4.0
"""Factor by which another convention must fit better before it is suspected. A bad method in the
right convention seldom fits twice as well in a wrong one; a good method in a wrong convention fits
tens of times better."""
_SCALE = (0.8, 1.25)
"""Factors between predicted and true intensity that a method may have without a remark."""

CHANGES = {
    (-1.0, -1.0): "turned by 90°: angles are counted from the vertical",
    (1.0, -1.0): "with s2 negated: angles are anticlockwise as displayed, rows from the top",
    (-1.0, 1.0): "with s1 negated: angles are anticlockwise from the vertical as displayed",
}
"""Signs of s1 and s2 in another convention, and what the convention here is."""


@dataclass(frozen=True)
class ConventionSums:
    """Sums over pixels, bands and scenes of products of predicted and true Stokes vectors.

    Attributes
    ----------
    predicted, true : float
        Σ s1² + s2² of the prediction and of the truth.
    cross1, cross2 : float
        Σ of predicted times true s1, and s2.
    cross0, true0 : float
        Σ of predicted times true s0, and of true s0².
    """

    predicted: float = 0.0
    true: float = 0.0
    cross1: float = 0.0
    cross2: float = 0.0
    cross0: float = 0.0
    true0: float = 0.0

    @classmethod
    def of(cls, predicted: FloatArray, truth: Truth) -> ConventionSums:
        """Sums over a scene's mask, relative to the peak so that scenes weigh the same."""
        scale = 1.0 / peak(truth)
        p = predicted[truth.mask].astype(np.float64) * scale
        t = truth.stokes[truth.mask].astype(np.float64) * scale
        return cls(
            predicted=float(np.sum(p[..., 1:] ** 2)),
            true=float(np.sum(t[..., 1:] ** 2)),
            cross1=float(np.sum(p[..., 1] * t[..., 1])),
            cross2=float(np.sum(p[..., 2] * t[..., 2])),
            cross0=float(np.sum(p[..., 0] * t[..., 0])),
            true0=float(np.sum(t[..., 0] ** 2)),
        )

    def __add__(self, other: ConventionSums) -> ConventionSums:
        """Sums over the scenes of both."""
        names = self.__dataclass_fields__
        return ConventionSums(*(getattr(self, name) + getattr(other, name) for name in names))

    def residual(self, sign1: float = 1.0, sign2: float = 1.0) -> float:
        """Σ of squared differences of s1 and s2, with the prediction's signs changed."""
        cross = sign1 * self.cross1 + sign2 * self.cross2
        return max(self.predicted + self.true - 2.0 * cross, 0.0)

    def suspicions(self) -> Iterator[str]:
        """What looks like a mistake of convention, one sentence each.

        Examples
        --------
        >>> print(*ConventionSums(1, 1, -0.5, -0.5, 2, 1).suspicions(), sep="; ")
        s1 and s2 fit the truth 1000+ times better turned by 90°: angles are counted from the
        vertical; intensities are 2 times those of the scenes
        """
        if self.true > 0.0 and self.predicted > 0.0:
            best = min(CHANGES, key=lambda signs: self.residual(*signs))
            # Fits to better than a thousandth are all alike: rounding decides between them.
            floor = 1e-3 * self.residual()
            better = self.residual() / max(self.residual(*best), floor, 1e-300)
            if better > _BETTER:
                times = f"{better:.0f}" if better < 999 else "1000+"
                yield f"s1 and s2 fit the truth {times} times better {CHANGES[best]}"
        if self.true0 > 0.0:
            scale = self.cross0 / self.true0
            if not _SCALE[0] <= scale <= _SCALE[1]:
                yield f"intensities are {scale:.3g} times those of the scenes"
