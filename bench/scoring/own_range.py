"""The likeliest other meaning of the paper's error, of the pixels that are scored."""

from __future__ import annotations

import numpy as np

from malus.bench.scoring.image_sums import image_sums
from malus.bench.scoring.readings import LIKELIEST, READINGS, DatasetSums
from malus.reconstruct import Components
from malus.scenes.core.arrays import Float64Array, FloatArray


def own_range_errors(
    estimate: Components, image: FloatArray, true: FloatArray, scenes: int = 1
) -> Float64Array:
    """Error (scenes,) with each polariser image scaled to [0, 1] by its own least and largest.

    Parameters
    ----------
    estimate : Components
        (2, pixels, bands); the first row is that of the picture as rendered.
    image : (2, pixels, bands)
        The unpolarised picture, likewise.
    true : (2, pixels, bands)
        s1 and s2 of the truth.
    scenes : int
        Number of scenes whose bands stand side by side.
    """
    assert READINGS[LIKELIEST].scope == "image"  # else peaks and means would count
    of_estimate = estimate.image[0], estimate.s1[0], estimate.s2[0]
    sums = image_sums(of_estimate, (image[0], true[0], true[1]), scenes)
    unused = np.ones(scenes)
    counts = np.full(scenes, image[0].size / scenes)
    return DatasetSums(sums, counts, unused, unused).errors(LIKELIEST)
