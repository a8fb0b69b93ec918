"""The likeliest other meaning of the paper's error, of the pixels that are scored."""

from __future__ import annotations

import numpy as np

from malus.bench.scoring.image_sums import image_sums
from malus.bench.scoring.pixel_kernels import ThreeImages
from malus.bench.scoring.readings import LIKELIEST, READINGS, DatasetSums
from malus.reconstruct import Components
from malus.scenes.core.arrays import Float64Array, FloatArray


class OwnRange:
    """Errors of estimates of one truth, each polariser image scaled to [0, 1] by its own ends.

    Parameters
    ----------
    image : (2, pixels, bands)
        The unpolarised picture; the first row is as rendered.
    true : (2, pixels, bands)
        s1 and s2 of the truth.
    scenes : int
        Number of scenes whose bands stand side by side.
    """

    def __init__(self, image: FloatArray, true: FloatArray, scenes: int = 1) -> None:
        assert READINGS[LIKELIEST].scope == "image"  # else peaks and means would count
        self._truth: ThreeImages = (image[0], true[0], true[1])
        self._scenes = scenes
        self._of_truth = image_sums(self._truth, self._truth, scenes)

    def errors(self, estimate: Components) -> Float64Array:
        """Error (scenes,) of an estimate (2, pixels, bands), whose first row is scored."""
        of_estimate = estimate.image[0], estimate.s1[0], estimate.s2[0]
        sums = image_sums(of_estimate, self._truth, self._scenes, self._of_truth)
        unused = np.ones(self._scenes)
        counts = np.full(self._scenes, self._truth[0].size / self._scenes)
        return DatasetSums(sums, counts, unused, unused).errors(LIKELIEST)
