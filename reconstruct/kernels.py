"""Loops over pixels, compiled by numba: what costs as much as the memory it reads and writes.

Importing this takes as long as importing numba, so that only those do who have an image at hand.
Machine code is kept in the cache folder of Python or of the user, where one can be written.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numba
import numpy as np

Loop = TypeVar("Loop", bound=Callable[..., Any])


def compiled(loop: Loop, any_order: bool = False) -> Loop:
    """Machine code that runs without the interpreter's lock, for each dtype when first called.

    In `any_order`, sums may be added up in several parts at once.
    """
    freedom = {"contract", "reassoc"} if any_order else {"contract"}
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": freedom}
    try:
        return numba.njit(cache=True, **options)(loop)
    except RuntimeError:  # no folder can be written: every process compiles again
        return numba.njit(**options)(loop)


@compiled
def accept(specular: Any, diffuse: Any, normals: Any, most: Any, valid: Any) -> None:
    """Mark the pixels whose intensities are in [0, most] and whose normals face the viewer.

    specular, diffuse (pixels, bands); normals (pixels, 3), or (0, 3) where none are known; valid
    (pixels,) is written. Normals must have length one to 5e-4: float32 normals that were averaged
    and normalised again have it to 1e-6.
    """
    pixels, bands = specular.shape
    valid[:] = True
    bad = 0  # counted over flat arrays first, which takes a quarter of the time of pixels
    for lobe in (specular.reshape(-1), diffuse.reshape(-1)):
        for k in range(lobe.size):
            bad += not (lobe[k] >= 0 and lobe[k] <= most)  # NaN compares False
    if bad:
        for i in range(pixels):
            for b in range(bands):
                s, d = specular[i, b], diffuse[i, b]
                valid[i] &= s >= 0 and s <= most and d >= 0 and d <= most
    for i in range(normals.shape[0]):
        x, y, z = normals[i, 0], normals[i, 1], normals[i, 2]
        valid[i] &= (abs(x * x + y * y + z * z - 1) < 1e-3) & (z >= 0)


@compiled
def about_normals(
    light: Any, other: Any, normals: Any, table: Any, longest: float, s1: Any, s2: Any
) -> None:
    """Write s1 and s2 of one or two lobes that are polarised in the frame of the normals.

    light, other, s1, s2 (pixels, bands); normals (pixels, 3) with z ≥ 0. The rows of `table` hold
    s1/s0 at azimuth 0 on even steps of √cos θ from 0 to 1, the last one twice, and its columns
    every band of `light`, and of `other` where there are as many more. `longest` is the length of
    (cos 2φ, sin 2φ).
    """
    pixels, bands = light.shape
    cells = table.shape[0] - 2
    both = table.shape[1] > bands
    for i in range(pixels):
        x, y, z = np.float64(normals[i, 0]), np.float64(normals[i, 1]), np.float64(normals[i, 2])
        where = math.sqrt(min(z, 1.0)) * cells
        cell = int(where)
        part = where - cell
        low, high = table[cell], table[cell + 1]
        # Where the squares underflow, both numerators are zero as well.
        inverse = longest / (x * x + y * y + 1e-300)
        cos2, sin2 = (x * x - y * y) * inverse, 2.0 * x * y * inverse
        for b in range(bands):
            polarised = light[i, b] * (low[b] + part * (high[b] - low[b]))
            if both:
                c = bands + b
                polarised += other[i, b] * (low[c] + part * (high[c] - low[c]))
            s1[i, b] = polarised * cos2
            s2[i, b] = polarised * sin2


@compiled
def add_ratio(light: Any, ratio: Any, s1: Any, s2: Any) -> None:
    """Add light (pixels, bands) times its s1/s0 and s2/s0, ratio (pixels or 1, bands, 2)."""
    pixels, bands = light.shape
    step = 1 if ratio.shape[0] > 1 else 0
    for i in range(pixels):
        for b in range(bands):
            s1[i, b] += light[i, b] * ratio[i * step, b, 0]
            s2[i, b] += light[i, b] * ratio[i * step, b, 1]
