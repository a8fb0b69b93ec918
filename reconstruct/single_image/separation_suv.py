"""Separation in SUV colour space by erosion along surfaces of one body colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.observation import Image
from malus.reconstruct.single_image.separation_space import SourceSpace

Mask = NDArray[np.bool_]

_TIME_STEP = 0.5
"""Largest step at which the upwind scheme of a unit-speed erosion is stable in two dimensions."""
_MAX_STEPS = 2000
_SETTLED = 1e-5
_HUE_EDGE = 0.05
"""Squared hue difference of neighbours at which erosion has slowed to 1/e: about 13°."""
_NEIGHBOURS = ((0, 1), (0, -1), (1, 1), (1, -1))
"""Axis and shift of the pixels above, below, left and right."""


def suv_diffuse(space: SourceSpace, steps: int | None = None) -> Image:
    """m_d (height, width): the body's tan ϑ = S/|UV| found by erosion, times |UV|.

    S is the coordinate along the light's colour and U, V span the rest, which mirrored light does
    not touch. S/|UV| is constant on a body of one colour and only ever raised by mirrored light, so
    the partial differential equation τ_t = −g |∇τ|, with g stopping at edges of hue, sinks it to
    the body's value. Where a pixel has no colour, all of it is taken for body light.

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
    floor = 1e-3 * float(np.quantile(space.chroma[space.lit], 0.98)) + np.finfo(np.float32).tiny
    steady = space.lit & (space.chroma > floor)
    slope = np.where(steady, space.intensity, 0) / np.maximum(space.chroma, floor)
    gates = _gates(space, steady)
    limit = steps if steps is not None else min(2 * sum(slope.shape), _MAX_STEPS)
    smallest = float(slope[steady].min())
    for _ in range(limit):
        change = _erosion(slope, gates)
        slope -= change
        if float(change.max()) < _SETTLED * smallest:
            break
    return np.where(steady, slope * space.chroma, space.intensity)


def _erosion(slope: Image, gates: list[Image]) -> Image:
    """What one step of τ_t = −g |∇τ| takes away: neighbours that are lower pull a pixel down."""
    up, down, left, right = (
        gate * np.maximum(slope - _neighbour(slope, *where), 0)
        for gate, where in zip(gates, _NEIGHBOURS, strict=True)
    )
    return np.asarray(_TIME_STEP * np.hypot(np.maximum(up, down), np.maximum(left, right)))


def _neighbour(values: Image, axis: int, shift: int) -> Image:
    """The array shifted by one pixel, its own values where there is no neighbour."""
    result = values.copy()
    to, source = [slice(None)] * values.ndim, [slice(None)] * values.ndim
    to[axis] = slice(1, None) if shift == 1 else slice(None, -1)
    source[axis] = slice(None, -1) if shift == 1 else slice(1, None)
    result[tuple(to)] = values[tuple(source)]
    return result


def _gates(space: SourceSpace, steady: Mask) -> list[Image]:
    """exp(−|Δhue|² / edge²) towards the four neighbours, zero towards pixels without colour."""
    u = space.balanced - space.intensity[..., None]
    norm = np.linalg.norm(u, axis=-1, keepdims=True)
    hue = np.where(steady[..., None], u / np.where(norm > 0, norm, 1), 0)
    found = []
    for where in _NEIGHBOURS:
        difference = np.sum((hue - _neighbour(hue, *where)) ** 2, axis=-1)
        both = steady & _neighbour(steady.astype(np.uint8), *where).astype(bool)
        found.append(np.where(both, np.exp(-difference / _HUE_EDGE), 0).astype(hue.dtype))
    return found
