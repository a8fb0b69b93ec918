"""Scores of one method on many scenes of a family at once: their bands stand side by side.

Scenes that come from the same renders share pixels, normals, light and roughness, and differ in
index and albedo only. They are one picture of many bands: interpolated, reconstructed and compared
in one pass over its pixels, without whole images of any scene.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from malus.bench.scoring.field_agreement import ALONG, ENERGY, ERROR, TRIVIAL, Agreement
from malus.bench.scoring.judge import Score, angle_form, rounding_slack
from malus.bench.scoring.masked_pixels import two_rows
from malus.bench.scoring.metrics import Residuals, cos_zenith
from malus.bench.scoring.observe import inputs
from malus.bench.scoring.own_range import OwnRange
from malus.bench.scoring.pixel_kernels import (
    MOST_BANDS,
    ThreeImages,
    count_violations,
    difference_sums,
    gather_family,
    products,
)
from malus.bench.scoring.unmixed_pixels import MixedPixels, Unmixed
from malus.reconstruct import Components, Inapplicable, Method, Observation
from malus.reconstruct.observation import INPUTS
from malus.renderers.families.interpolated import Family
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import Float64Array, FloatArray
from malus.scenes.scene import Scene

BANDS_AT_ONCE = 48
"""Bands side by side: enough that Python's part is small, few enough that they stay in cache, and
the same for any number of threads, so that results are too."""


class NotTogether(Exception):  # no error: the scenes are scored one by one
    """These scenes have to be scored one by one."""


def groups(scenes: Sequence[Scene]) -> Iterator[tuple[Scene, ...]]:
    """Scenes of a family in groups of at most `BANDS_AT_ONCE` bands, or of one scene."""
    size = max(1, BANDS_AT_ONCE // len(scenes[0].wavelengths_nm))
    for start in range(0, len(scenes), size):
        yield tuple(scenes[start : start + size])


@dataclass(frozen=True)
class FamilyPixels:
    """The mask's pixels of some scenes of a family, with the bands of all of them side by side.

    Attributes
    ----------
    scenes : Scenes of as many bands each
    first : Truth
        Of one scene: it has the mask, normals and light of all.
    observation : Observation
        A picture of (2, pixels): as rendered, and with one draw of the noise added.
    true, draw : (2, pixels, all bands)
        s1 and s2 of the truths, and of the draw of their noise.
    """

    scenes: tuple[Scene, ...]
    first: Truth
    observation: Observation
    true: FloatArray
    draw: FloatArray

    @classmethod
    def of(cls, family: Family, scenes: tuple[Scene, ...], first: Truth) -> FamilyPixels:
        """Interpolate the pixels of some scenes from the renders of their family.

        `first` is the truth of any scene of the family.

        Raises
        ------
        NotTogether
            Where scenes differ in their number of bands, their light is not known by lobe, or
            nothing covers a pixel.
        """
        bands = {len(scene.wavelengths_nm) for scene in scenes}
        together = len(bands) == 1 and bands.pop() * len(scenes) <= MOST_BANDS
        if not (together and first.mask.any() and all(scene.lobes_known for scene in scenes)):
            raise NotTogether
        covered = np.flatnonzero(family.lobes.covered)
        weights, albedo = family.weights_of(scenes)
        specular, diffuse, image, true, draw = (
            np.empty((2, len(covered), len(albedo)), np.float32) for _ in range(5)
        )
        gather_family(
            covered,
            family.lobes.specular,
            family.lobes.diffuse,
            weights,
            albedo,
            (specular, diffuse, image),
            (true, draw),
        )
        shared = inputs(first, INPUTS - {"specular", "diffuse", "eta", "illuminant"})
        indices = np.flatnonzero(first.mask)
        observation = Observation(
            image=image,
            mask=np.ones(image.shape[:2], dtype=bool),
            specular=specular,
            diffuse=diffuse,
            eta=np.concatenate([scene.eta for scene in scenes]),
            **{name: two_rows(value, indices, first.mask.shape) for name, value in shared.items()},
        )
        return cls(scenes, first, observation, true, draw)

    def estimate(self, method: Method) -> Components:
        """Estimate of a method that works pixel by pixel and band by band, for all scenes.

        Raises
        ------
        Inapplicable
            Where the method cannot work under the light that all scenes share.
        NotTogether
            Where the method fails on any of the scenes, calls a pixel invalid, or says how sure
            it is or whether it converged, which is scored scene by scene.
        """
        withheld: dict[str, Any] = dict.fromkeys(INPUTS - method.needs)
        try:
            estimate = method.reconstruct(replace(self.observation, **withheld))
        except Inapplicable:  # a ValueError, but no failure
            raise
        except (ValueError, ArithmeticError) as error:
            raise NotTogether from error
        invalid = estimate.valid is not None and not estimate.valid.all()
        if invalid or estimate.deviation is not None or estimate.converged is not None:
            raise NotTogether
        return estimate


_Pair = tuple[Residuals, Residuals]
"""Of an estimate, and of its response to one draw of the noise."""


class FamilyJudge:
    """Scores methods on some scenes of a family; the same numbers as a `Judge` of each."""

    def __init__(self, pixels: FamilyPixels) -> None:
        """Compute what all methods share: peaks, and the errors of the trivial guess."""
        self.pixels = pixels
        count = len(pixels.scenes)
        image = pixels.observation.image
        self.bands = image.shape[2] // count
        brightest = image[0].max(axis=0).reshape(count, self.bands).max(axis=1)
        self.peaks = [float(value) if value > 0 else 1.0 for value in brightest]
        self.facing = np.square(np.square(cos_zenith(pixels.first)))
        self.draws = np.empty((count, 5, image.shape[1]))
        unpolarised = np.zeros_like(pixels.true)
        guess = image, unpolarised, unpolarised
        moments, totals = self._sums(guess)
        self.own_range = OwnRange(image, pixels.true, count)
        self.guess_moments = moments, totals, self.draws[:, :3].copy()
        self.mixed = MixedPixels.of(
            pixels.first, (image, pixels.true, pixels.draw), angle_form(), count
        )
        unmixed = None if self.mixed is None else self.mixed.without(moments, guess)
        self.guesses = self._residuals(moments)
        self.unmixed_guesses = self._unmixed(unmixed)
        # The guess lacks the whole field: its product with that is minus the field's energy.
        self.totals = np.stack([-totals[:, 0], totals[:, 2]], axis=1)
        self.draws[:, ENERGY], self.draws[:, TRIVIAL] = -self.draws[:, ALONG], self.draws[:, ERROR]

    @np.errstate(over="ignore", invalid="ignore")  # what is no number is told as none
    def scores(self, estimate: Components) -> list[Score]:
        """Score an estimate of all scenes, one score a scene."""
        moments, totals = self._sums_of(estimate)
        components = estimate.image, estimate.s1, estimate.s2
        unmixed = None if self.mixed is None else self.mixed.without(moments, components)
        violations, own_range = self._violations(estimate), self.own_range.errors(estimate)
        return [
            Score(
                *residuals,
                *self.guesses[scene],
                int(violations[scene]),
                0,
                self.pixels.scenes[scene].wavelengths_nm,
                self._agreement(totals[scene], scene),
                unmixed=self._unmixed_of(of_unmixed, scene),
                own_range=float(own_range[scene]),
            )
            for scene, (residuals, of_unmixed) in enumerate(
                zip(self._residuals(moments), self._unmixed(unmixed), strict=True)
            )
        ]

    def _agreement(self, totals: Float64Array, scene: int) -> Agreement:
        scale = self.peaks[scene] ** 2
        return Agreement(
            np.array([*totals, *self.totals[scene]]) / scale,
            products(self.draws[scene]) / scale**2,
            self.pixels.true.shape[1] * self.bands,
        )

    def _unmixed_of(self, method: _Pair | None, scene: int) -> Unmixed | None:
        """Residuals of one scene over the pixels of one normal; None where these are unknown."""
        guess = self.unmixed_guesses[scene]
        if self.mixed is None or method is None or guess is None:
            return None
        return Unmixed(len(self.mixed.indices), (*method, *guess))

    def _sums_of(self, estimate: Components) -> tuple[Float64Array, Float64Array]:
        """As `_sums`; those of the trivial guess are known."""
        is_guess = estimate.image is self.pixels.observation.image and not (
            estimate.s1.any() or estimate.s2.any()
        )
        if not is_guess:
            return self._sums((estimate.image, estimate.s1, estimate.s2))
        moments, totals, self.draws[:, :3] = self.guess_moments
        return moments, totals

    def _sums(self, estimate: ThreeImages) -> tuple[Float64Array, Float64Array]:
        """Moments and totals of an estimate, see `difference_sums`; `self.draws` is written."""
        truth = self.pixels.observation.image, self.pixels.true, self.pixels.draw
        image, s1, s2 = (np.ascontiguousarray(component) for component in estimate)
        return difference_sums((image, s1, s2), truth, self.facing, angle_form(), self.draws)

    def _residuals(self, moments: Float64Array, left_out: int = 0) -> list[_Pair]:
        """Error moments of every scene's estimate, and of its response to one noise draw."""
        count = self.pixels.true.shape[1] - left_out
        error, response = (Residuals.of_several(m, self.peaks, count) for m in moments)
        return list(zip(error, response, strict=True))

    def _unmixed(self, moments: Float64Array | None) -> Sequence[_Pair | None]:
        """The same over the pixels of one normal, from their moments; None where unknown."""
        if self.mixed is None or moments is None:
            return [None] * len(self.peaks)
        return self._residuals(moments, len(self.mixed.indices))

    def _violations(self, estimate: Components) -> Any:
        counts = np.empty(len(self.pixels.scenes), np.int64)
        components = estimate.image[0], estimate.s1[0], estimate.s2[0]
        picture = self.pixels.observation.image[0]
        count_violations(*components, picture, rounding_slack(components[0].dtype), counts)
        return counts
