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
    e0, e1, e2 = (np.ascontiguousarray(plane) for plane in estimate)
    t0, t1, t2 = (np.ascontiguousarray(plane) for plane in truth)
    rows = _added_images((e0, e1, e2), (t0, t1, t2)).reshape(len(ANALYSERS), 5, _ROW)
    by_scene = rows[:, :, :columns].reshape(len(ANALYSERS), 5, scenes, -1)
    joined = by_scene.sum(axis=-1)
    joined[:, 3], joined[:, 4] = by_scene[:, 3].min(axis=-1), by_scene[:, 4].max(axis=-1)
    return np.ascontiguousarray(joined.transpose(2, 0, 1))


_ROW = MOST_BANDS + 8  # as in `pixel_kernels`: rows at fixed offsets, not a power of two apart


@partial(compiled, any_order=True)
def _added_images(estimate: ThreeImages, truth: ThreeImages) -> Float64Array:
    """Sums over all pixels as rows (angles · 5 · _ROW,): bands side by side, several at once.

    Every number is read once for all angles, whose weights are known when this is compiled; with a
    loop over the bands for each angle it took twice as long. The rows are made here, because numba
    begins them where several numbers are written at once.
    """
    (e0, e1, e2), (t0, t1, t2) = estimate, truth
    angles = ANALYSERS.shape[0]
    rows = np.zeros(angles * 5 * _ROW)
    for a in range(angles):
        rows[(5 * a + 3) * _ROW : (5 * a + 4) * _ROW] = np.inf
        rows[(5 * a + 4) * _ROW : (5 * a + 5) * _ROW] = -np.inf
    for p in range(e0.shape[0]):
        for b in range(e0.shape[1]):
            x0, x1, x2 = np.float64(e0[p, b]), np.float64(e1[p, b]), np.float64(e2[p, b])
            y0, y1, y2 = np.float64(t0[p, b]), np.float64(t1[p, b]), np.float64(t2[p, b])
            for a in range(angles):
                w0, w1, w2 = ANALYSERS[a, 0], ANALYSERS[a, 1], ANALYSERS[a, 2]
                e, t = w0 * x0 + w1 * x1 + w2 * x2, w0 * y0 + w1 * y1 + w2 * y2
                k = 5 * a * _ROW + b
                rows[k] += e
                rows[_ROW + k] += e * e
                rows[2 * _ROW + k] += e * t
                rows[3 * _ROW + k] = min(rows[3 * _ROW + k], e)
                rows[4 * _ROW + k] = max(rows[4 * _ROW + k], e)
    return rows
