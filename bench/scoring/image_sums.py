"""Sums over the polariser images of an estimate and of its truth, as images.

The NMSE of malus divides by one number for all images of an object and so needs Stokes moments
alone (`malus.bench.scoring.metrics`). Other meanings of "normalised" take every image's own range,
and need these sums; `malus.bench.scoring.readings` makes errors of them.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from malus.bench.scoring.pixel_kernels import MOST_BANDS, ThreeImages
from malus.reconstruct.kernels import compiled
from malus.scenes.core.arrays import Float64Array
from malus.scenes.polarisation import PAPER_ANGLES_DEG, polarised

E, T, EE, TT, ET, E_MIN, E_MAX, T_MIN, T_MAX = range(9)
"""Columns: Σe, Σt, Σe², Σt², Σet of estimate e and truth t, and the least and largest of each."""

ANALYSERS: Float64Array = np.stack(
    [np.asarray(polarised(np.eye(3), angle), dtype=np.float64) for angle in PAPER_ANGLES_DEG]
)
"""Weights (angles, 3) of s0, s1 and s2 in the images through the paper's polarisers."""


def image_sums(
    estimate: ThreeImages,
    truth: ThreeImages,
    scenes: int = 1,
    of_truth: Float64Array | None = None,
) -> Float64Array:
    """Sums over the pixels and bands of every image through the paper's polarisers.

    Parameters
    ----------
    estimate, truth : three of (pixels, bands)
        s0, s1 and s2, of at most `MOST_BANDS` bands; several scenes may stand side by side.
    scenes : int
        Number of scenes, each of as many bands.
    of_truth : (scenes, angles, 9) array, optional
        Sums of any estimate and this truth: those of the truth alone are taken from them.

    Returns
    -------
    (scenes, angles, 9) array
        In the order of the columns `E` … `T_MAX`.

    Examples
    --------
    >>> light = tuple(np.array([[value, 3 * value]]) for value in (2.0, 0.0, 0.0))
    >>> image_sums(light, light)[0, 0].tolist()
    [4.0, 4.0, 10.0, 10.0, 10.0, 1.0, 3.0, 1.0, 3.0]
    """
    own = _sums(estimate, truth, scenes)
    sums = np.empty((scenes, len(ANALYSERS), 9))
    sums[..., [E, EE, ET, E_MIN, E_MAX]] = own
    if of_truth is None:
        same = own if estimate is truth else _sums(truth, truth, scenes)
        sums[..., [T, TT, T_MIN, T_MAX]] = same[..., [0, 1, 3, 4]]
    else:
        sums[..., [T, TT, T_MIN, T_MAX]] = of_truth[..., [T, TT, T_MIN, T_MAX]]
    return sums


def _sums(estimate: ThreeImages, truth: ThreeImages, scenes: int) -> Float64Array:
    """Σe, Σe², Σet, least and largest e of every scene and angle, (scenes, angles, 5)."""
    columns = estimate[0].shape[1]
    rows = np.zeros((len(ANALYSERS), 5, _ROW))
    rows[:, 3], rows[:, 4] = np.inf, -np.inf
    e0, e1, e2 = (np.ascontiguousarray(plane) for plane in estimate)
    t0, t1, t2 = (np.ascontiguousarray(plane) for plane in truth)
    _add_images((e0, e1, e2), (t0, t1, t2), ANALYSERS, rows.reshape(len(ANALYSERS), -1))
    by_scene = rows[:, :, :columns].reshape(len(ANALYSERS), 5, scenes, -1)
    joined = by_scene.sum(axis=-1)
    joined[:, 3], joined[:, 4] = by_scene[:, 3].min(axis=-1), by_scene[:, 4].max(axis=-1)
    return np.ascontiguousarray(joined.transpose(2, 0, 1))


_ROW = MOST_BANDS + 8  # as in `pixel_kernels`: rows at fixed offsets, not a power of two apart


@partial(compiled, any_order=True)
def _add_images(
    estimate: ThreeImages, truth: ThreeImages, analysers: Float64Array, rows: Float64Array
) -> None:
    """Add all pixels to rows (angles, 5 · _ROW): bands side by side, so that several go at once."""
    (e0, e1, e2), (t0, t1, t2) = estimate, truth
    for p in range(e0.shape[0]):
        for a in range(analysers.shape[0]):
            w0, w1, w2 = analysers[a, 0], analysers[a, 1], analysers[a, 2]
            own = rows[a]
            for b in range(e0.shape[1]):
                e = w0 * e0[p, b] + w1 * e1[p, b] + w2 * e2[p, b]
                t = w0 * t0[p, b] + w1 * t1[p, b] + w2 * t2[p, b]
                own[b] += e
                own[_ROW + b] += e * e
                own[2 * _ROW + b] += e * t
                own[3 * _ROW + b] = min(own[3 * _ROW + b], e)
                own[4 * _ROW + b] = max(own[4 * _ROW + b], e)
