"""Scores without the pixels that see more than one normal.

At the sharp edge of a part a pixel sees two faces. A method is told one normal there, the mean of
both, which belongs to neither; on a block, 2 % of the pixels make nearly all of an otherwise exact
method's error. Scores over the other pixels stand beside those over all.

On a sphere the spread of a pixel at the rim is 4.6° in a picture of 32 pixels, 3.3° at 64, 2.3° at
128 and 1.6° at 256; blobs are alike. A pixel of which a 64th is the other side of a right angle has
10°. The limit is between the two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from malus.bench.scoring.metrics import Residuals
from malus.bench.scoring.pixel_kernels import QuadraticForm, ThreeImages, difference_sums
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import BoolArray, Float64Array

MOST_SPREAD_DEG = 5.0
"""Largest `normal_spread` of a pixel that counts as one of one normal."""


@dataclass(frozen=True)
class Unmixed:
    """Residuals over the pixels of one normal, and the number of the others.

    The residuals are those of the estimate and of its noise, then of the trivial guess and of its.
    """

    mixed: int
    residuals: tuple[Residuals, Residuals, Residuals, Residuals]


def mixed_pixels(truth: Truth) -> BoolArray | None:
    """Pixels (height, width) of the mask that see more than one normal; None where unknown.

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=8))
    >>> bool(mixed_pixels(render(scene, renderer="torrance-sparrow")).any())
    False
    """
    if truth.normal_spread is None:
        return None
    return truth.mask & (truth.normal_spread > MOST_SPREAD_DEG)


@dataclass(frozen=True)
class MixedPixels:
    """The mixed pixels of a truth, of which the sums over all pixels are relieved.

    Attributes
    ----------
    indices : (mixed,)
        Which of the mask's pixels.
    truth : three of (2, mixed, bands)
        As for `difference_sums`.
    form : 6 floats
        Likewise.
    scenes : int
        Number of scenes whose bands stand side by side.
    """

    indices: NDArray[np.intp]
    truth: ThreeImages
    form: QuadraticForm
    scenes: int

    @classmethod
    def of(
        cls, truth: Truth, pixels: ThreeImages, form: QuadraticForm, scenes: int = 1
    ) -> MixedPixels | None:
        """The mixed pixels of `pixels`, three of (2, pixels, bands); None where unknown."""
        mixed = mixed_pixels(truth)
        if mixed is None:
            return None
        indices = np.flatnonzero(mixed[truth.mask])
        return cls(indices, _at(indices, pixels), form, scenes)

    def without(self, moments: Float64Array, estimate: ThreeImages) -> Float64Array:
        """Moments (2, 6, bands) of an estimate over all pixels, less those of the mixed ones."""
        if not self.indices.size:
            return moments
        facing = np.zeros(self.indices.size)
        draws = np.empty((self.scenes, 3, self.indices.size))
        mixed, _ = difference_sums(
            _at(self.indices, estimate), self.truth, facing, self.form, draws
        )
        return moments - mixed


def _at(indices: NDArray[np.intp], images: ThreeImages) -> ThreeImages:
    """Some pixels of three images (2, pixels, bands)."""
    first, second, third = (np.ascontiguousarray(image[:, indices]) for image in images)
    return first, second, third
