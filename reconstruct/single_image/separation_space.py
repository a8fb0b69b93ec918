"""The picture split along the light's colour and across it, and clusters of body colours."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.observation import Image

Mask = NDArray[np.bool_]
Labels = NDArray[np.integer[Any]]

LIT = 0.02
"""Share of the bright end below which a pixel's colour is mostly noise."""
_SAMPLE = 4096
"""Pixels from which colour clusters are learnt: enough for a handful of directions."""
_SAME_HUE = 0.97
"""Cosine between specular-free directions of one body colour (14°)."""
_BLOCK = 1 << 14
"""Pixels whose likeness to every leader is in cache at once."""
_SMALLEST = 0.02
"""Share of the sample below which a cluster is noise."""


class SourceSpace(NamedTuple):
    """Coordinates along and across the light's colour.

    Attributes
    ----------
    balanced : (height, width, bands)
        The image under white light.
    intensity : (height, width)
        s, mean over the bands.
    chroma : (height, width)
        |u|, length of the specular-free part, as a root mean square over the bands.
    lit : (height, width) bool
        Pixels of the mask that are bright enough to have a colour.
    """

    balanced: Image
    intensity: Image
    chroma: Image
    lit: Mask


def source_space(image: Image, mask: Mask, colour: Image) -> SourceSpace:
    """Split an image (height, width, bands) by the light's colour (bands,), mean 1.

    Examples
    --------
    >>> space = source_space(np.array([[[3.0, 1.0]]]), np.ones((1, 1), bool), np.ones(2))
    >>> space.intensity.item(), space.chroma.item()
    (2.0, 1.0)
    """
    balanced = np.maximum(image / colour, 0)
    planes = [balanced[..., band] for band in range(image.shape[-1])]
    count = len(planes)
    # Bands are few and last in memory: sums of planes are ten times faster than reductions there.
    intensity = _mean(planes)
    square = planes[0] * planes[0]
    for plane in planes[1:]:
        square += plane * plane
    chroma = np.sqrt(np.maximum(square / count - intensity * intensity, 0))
    values = intensity[mask]
    bright = (
        float(np.quantile(values[:: max(1, values.size // _SAMPLE)], 0.98)) if values.size else 0
    )
    return SourceSpace(balanced, intensity, chroma, mask & (intensity > max(LIT * bright, 0.0)))


def _mean(planes: list[Image]) -> Image:
    total = planes[0].copy()
    for plane in planes[1:]:
        total += plane
    return total / len(planes)


def colour_clusters(space: SourceSpace) -> Labels:
    """Label every pixel (height, width) with the body colour that it is nearest to.

    Mirrored light does not change the direction of the specular-free part u, so that pixels of one
    body colour share it. Directions are collected from a sample, one leader after another.

    Examples
    --------
    >>> picture = np.ones((8, 8, 3)) * [3.0, 1.0, 1.0]
    >>> picture[:4] = [1.0, 1.0, 3.0]
    >>> space = source_space(picture, np.ones((8, 8), bool), np.ones(3))
    >>> len(np.unique(colour_clusters(space)))
    2
    """
    leaders = _leaders(space)
    shape = space.intensity.shape
    if len(leaders) == 1:
        return np.zeros(shape, dtype=np.uint8)
    pixels = space.balanced.reshape(-1, space.balanced.shape[-1])
    labels = np.empty(len(pixels), dtype=np.uint8)
    for start in range(0, len(pixels), _BLOCK):
        block = slice(start, start + _BLOCK)
        labels[block] = _nearest(pixels[block], leaders)
    return labels.reshape(shape)


def _nearest(pixels: Image, leaders: Image) -> Labels:
    """The likeliest leader of every pixel (n, bands), without BLAS, whose threads cost more here.

    leader · u = leader · I, because a leader has mean zero; |u| is common to all leaders.
    """
    planes = np.ascontiguousarray(pixels.T)
    labels = np.zeros(len(pixels), dtype=np.uint8)
    best = np.full(len(pixels), -np.inf, dtype=pixels.dtype)
    for label, leader in enumerate(leaders):
        likeness = planes[0] * leader[0]
        for plane, weight in zip(planes[1:], leader[1:], strict=True):
            likeness += plane * weight
        np.copyto(labels, np.uint8(label), where=likeness > best)
        np.maximum(best, likeness, out=best)
    return labels


def _leaders(space: SourceSpace) -> Image:
    """Mean directions (clusters, bands) of the body colours in a sample of the lit pixels."""
    chosen = np.flatnonzero(space.lit)
    chosen = chosen[:: max(1, len(chosen) // _SAMPLE)]
    bands = space.balanced.shape[-1]
    pixels = space.balanced.reshape(-1, bands)[chosen]
    u = pixels - pixels.mean(axis=1, keepdims=True)
    length = np.linalg.norm(u, axis=1, keepdims=True)
    order = np.argsort(-length[:, 0], kind="stable")
    directions = (u / np.maximum(length, np.finfo(u.dtype).tiny))[order]
    free = np.ones(len(directions), dtype=bool)
    leaders: list[Any] = []
    while free.any() and len(leaders) < 32:
        first = directions[np.argmax(free)]
        near = free & (directions @ first > _SAME_HUE)
        near[np.argmax(free)] = True
        if near.sum() >= _SMALLEST * len(directions) or not leaders:
            mean = directions[near].mean(axis=0)
            leaders.append(mean / max(float(np.linalg.norm(mean)), 1e-12))
        free &= ~near
    return np.array(leaders, dtype=u.dtype)
