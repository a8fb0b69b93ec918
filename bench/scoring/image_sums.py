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


def image_sums(estimate: ThreeImages, truth: ThreeImages, scenes: int = 1) -> Float64Array:
    """Sums over the pixels and bands of every image through the paper's polarisers.

    Parameters
    ----------
    estimate, truth : three of (pixels, bands)
        s0, s1 and s2, of at most `MOST_BANDS` bands; several scenes may stand side by side.
    scenes : int
        Number of scenes, each of as many bands.

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
    columns = estimate[0].shape[1]
    rows = np.zeros((len(ANALYSERS), 9, _ROW))
    rows[:, [E_MIN, T_MIN]], rows[:, [E_MAX, T_MAX]] = np.inf, -np.inf
    e0, e1, e2 = (np.ascontiguousarray(plane) for plane in estimate)
    t0, t1, t2 = (np.ascontiguousarray(plane) for plane in truth)
    _add_images((e0, e1, e2), (t0, t1, t2), ANALYSERS, rows.reshape(len(ANALYSERS), -1))
    by_scene = rows[:, :, :columns].reshape(len(ANALYSERS), 9, scenes, -1)
    joined = by_scene.sum(axis=-1)
    for column, extreme in ((E_MIN, np.min), (T_MIN, np.min), (E_MAX, np.max), (T_MAX, np.max)):
        joined[:, column] = extreme(by_scene[:, column], axis=-1)
    return np.ascontiguousarray(joined.transpose(2, 0, 1))


_ROW = MOST_BANDS + 8  # as in `pixel_kernels`: rows at fixed offsets, not a power of two apart


@partial(compiled, any_order=True)
def _add_images(
    estimate: ThreeImages, truth: ThreeImages, analysers: Float64Array, rows: Float64Array
) -> None:
    """Add all pixels to rows (angles, 9 · _ROW): bands side by side, so that several go at once."""
    (e0, e1, e2), (t0, t1, t2) = estimate, truth
    for p in range(e0.shape[0]):
        for a in range(analysers.shape[0]):
            w0, w1, w2 = analysers[a, 0], analysers[a, 1], analysers[a, 2]
            own = rows[a]
            for b in range(e0.shape[1]):
                e = w0 * e0[p, b] + w1 * e1[p, b] + w2 * e2[p, b]
                t = w0 * t0[p, b] + w1 * t1[p, b] + w2 * t2[p, b]
                own[b] += e
                own[_ROW + b] += t
                own[2 * _ROW + b] += e * e
                own[3 * _ROW + b] += t * t
                own[4 * _ROW + b] += e * t
                own[5 * _ROW + b] = min(own[5 * _ROW + b], e)
                own[6 * _ROW + b] = max(own[6 * _ROW + b], e)
                own[7 * _ROW + b] = min(own[7 * _ROW + b], t)
                own[8 * _ROW + b] = max(own[8 * _ROW + b], t)
