"""Separation in SUV colour space by erosion on regions of one hue (Mallick et al. 2006)."""

from __future__ import annotations

import numpy as np

from malus.reconstruct.observation import Image
from malus.reconstruct.single_image.separation_space import SourceSpace
from malus.scenes.core.arrays import BoolArray

_TIME_STEP = 0.5
"""Largest step at which the upwind scheme of a unit-speed erosion is stable in two dimensions."""
_MAX_STEPS = 2000
_SETTLED = 1e-5
"""Largest change in one step, over the smallest value, at which the erosion has ended."""
_HUE_EDGE = 0.05
"""Squared hue difference of neighbours at which erosion has slowed to 1/e: about 13°."""
_NEIGHBOURS = ((0, 1), (0, -1), (1, 1), (1, -1))
"""Axis and shift of the pixels above, below, left and right."""


def suv_diffuse(space: SourceSpace, steps: int | None = None) -> Image:
    """Diffuse intensity m_d (height, width): the diffuse S/|UV|, found by erosion, times |UV|.

    S is the coordinate along the light's colour and U, V span the rest, which specular light does
    not change. τ = S/|UV| is constant on a body of one colour and raised by specular light, so the
    partial differential equation τ_t = −g |∇τ|, with g near 0 at edges of hue, lowers it to the
    diffuse value. A pixel without colour is taken for diffuse light alone.

    Source: Mallick, Zickler, Belhumeur and Kriegman, "Specularity removal in images and videos: a
    PDE approach", ECCV (2006), textureless case with hue-dependent stopping, Rouy and Tourin's
    upwind scheme. `steps` bounds the iterations; by default erosion may cross the object once.

    Examples
    --------
    >>> from malus.reconstruct.single_image.separation_space import source_space
    >>> picture = np.full((6, 6, 2), [3.0, 1.0])
    >>> picture[2, 2] += 1.0
    >>> space = source_space(picture, np.ones((6, 6), bool), np.ones(2))
    >>> round(suv_diffuse(space)[2, 2].item(), 3)
    2.0
    """
    limit = steps if steps is not None else min(2 * sum(space.lit.shape), _MAX_STEPS)
    box = _box(space.lit)
    result = space.intensity.copy()
    balanced, intensity, chroma, lit = space
    part = SourceSpace(balanced[box], intensity[box], chroma[box], lit[box])
    result[box] = _eroded(part, limit)
    return result


def _box(lit: BoolArray) -> tuple[slice, slice]:
    """The part of the picture that holds the object: erosion elsewhere would cost for nothing."""
    rows, columns = (np.flatnonzero(lit.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def _eroded(space: SourceSpace, limit: int) -> Image:
    """Diffuse intensity of a picture that the object fills, by at most `limit` steps."""
    floor = 1e-3 * float(np.quantile(space.chroma[space.lit], 0.98)) + np.finfo(np.float32).tiny
    coloured = space.lit & (space.chroma > floor)
    slope = np.where(coloured, space.intensity, 0) / np.maximum(space.chroma, floor)
    stops = _stopping_functions(space, coloured)
    smallest = float(slope[coloured].min())
    for _ in range(limit):
        decrease = _erosion(slope, stops)
        slope -= decrease
        if float(decrease.max()) < _SETTLED * smallest:
            break
    return np.where(coloured, slope * space.chroma, space.intensity)


def _erosion(slope: Image, stops: list[Image]) -> Image:
    """Decrease of τ in one step of τ_t = −g |∇τ|: lower neighbours pull a pixel down."""
    up, down, left, right = (
        stop * np.maximum(slope - _neighbour(slope, *shift), 0)
        for stop, shift in zip(stops, _NEIGHBOURS, strict=True)
    )
    return np.asarray(_TIME_STEP * np.hypot(np.maximum(up, down), np.maximum(left, right)))


def _neighbour(values: Image, axis: int, shift: int) -> Image:
    """The array shifted by one pixel along an axis; edge pixels keep their own values."""
    result = values.copy()
    target, source = [slice(None)] * values.ndim, [slice(None)] * values.ndim
    target[axis] = slice(1, None) if shift == 1 else slice(None, -1)
    source[axis] = slice(None, -1) if shift == 1 else slice(1, None)
    result[tuple(target)] = values[tuple(source)]
    return result


def _stopping_functions(space: SourceSpace, coloured: BoolArray) -> list[Image]:
    """g = exp(−|Δhue|² / edge²) towards the four neighbours, zero towards pixels without colour."""
    u = space.balanced - space.intensity[..., None]
    norm = np.linalg.norm(u, axis=-1, keepdims=True)
    hue = np.where(coloured[..., None], u / np.where(norm > 0, norm, 1), 0)
    stops = []
    for shift in _NEIGHBOURS:
        difference = np.sum((hue - _neighbour(hue, *shift)) ** 2, axis=-1)
        both = coloured & _neighbour(coloured.astype(np.uint8), *shift).astype(bool)
        stops.append(np.where(both, np.exp(-difference / _HUE_EDGE), 0).astype(hue.dtype))
    return stops
