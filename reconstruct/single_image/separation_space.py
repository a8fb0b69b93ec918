"""Split a picture along the light's colour and across it, and group pixels by body colour."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.observation import Image
from malus.scenes.core.arrays import BoolArray

Labels = NDArray[np.integer[Any]]

LIT = 0.02
"""Share of the brightest intensity below which a pixel's colour is mostly noise."""
_SAMPLE = 4096
"""Pixels from which colour clusters are learnt, or up to twice as many: enough for a handful of
directions."""
_SAME_HUE = 0.97
"""Cosine between specular-free directions of one body colour (14°)."""
_BLOCK = 1 << 14
"""Pixels that are compared with the cluster directions at once, so that they stay in cache."""
_SMALLEST = 0.02
"""Share of the sample below which a cluster is noise."""


class SourceSpace(NamedTuple):
    """Coordinates of every pixel along and across the light's colour.

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
    lit: BoolArray


def source_space(image: Image, mask: BoolArray, colour: Image) -> SourceSpace:
    """Split an image (height, width, bands) by the light's colour (bands,), mean 1.

    Its values are finite, and their squares floats of the image's precision: see `unit_scale`.

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
    """Mean of several planes (height, width)."""
    total = planes[0].copy()
    for plane in planes[1:]:
        total += plane
    return total / len(planes)


def colour_clusters(space: SourceSpace) -> Labels:
    """Label every pixel (height, width) with the body colour that it is nearest to.

    Specular light does not change the direction of the specular-free part u, so that pixels of one
    body colour share it. Directions are collected from a sample of the pixels, one after another.

    Examples
    --------
    >>> picture = np.ones((8, 8, 3)) * [3.0, 1.0, 1.0]
    >>> picture[:4] = [1.0, 1.0, 3.0]
    >>> space = source_space(picture, np.ones((8, 8), bool), np.ones(3))
    >>> len(np.unique(colour_clusters(space)))
    2
    """
    directions = _cluster_directions(space)
    shape = space.intensity.shape
    if len(directions) == 1:
        return np.zeros(shape, dtype=np.uint8)
    pixels = space.balanced.reshape(-1, space.balanced.shape[-1])
    labels = np.empty(len(pixels), dtype=np.uint8)
    for start in range(0, len(pixels), _BLOCK):
        block = slice(start, start + _BLOCK)
        labels[block] = _nearest(pixels[block], directions)
    return labels.reshape(shape)


def _nearest(pixels: Image, directions: Image) -> Labels:
    """Label (n,) of the cluster direction at the smallest angle to each pixel (n, bands).

    direction · u = direction · I, because a direction has mean zero; |u| is common to all. Written
    without BLAS, whose threads cost more here than they save.
    """
    planes = np.ascontiguousarray(pixels.T)
    labels = np.zeros(len(pixels), dtype=np.uint8)
    largest = np.full(len(pixels), -np.inf, dtype=pixels.dtype)
    for label, direction in enumerate(directions):
        projection = planes[0] * direction[0]
        for plane, weight in zip(planes[1:], direction[1:], strict=True):
            projection += plane * weight
        np.copyto(labels, np.uint8(label), where=projection > largest)
        np.maximum(largest, projection, out=largest)
    return labels


def _cluster_directions(space: SourceSpace) -> Image:
    """Mean directions (clusters, bands) of the body colours in a sample of the lit pixels.

    The most saturated pixel that belongs to no cluster yet starts the next one.
    """
    chosen = np.flatnonzero(space.lit)
    chosen = chosen[:: max(1, len(chosen) // _SAMPLE)]
    bands = space.balanced.shape[-1]
    pixels = space.balanced.reshape(-1, bands)[chosen]
    u = pixels - pixels.mean(axis=1, keepdims=True)
    length = np.linalg.norm(u, axis=1, keepdims=True)
    order = np.argsort(-length[:, 0], kind="stable")
    directions = (u / np.maximum(length, np.finfo(u.dtype).tiny))[order]
    unassigned = np.ones(len(directions), dtype=bool)
    means: list[Any] = []
    while unassigned.any() and len(means) < 32:
        first = directions[np.argmax(unassigned)]
        cluster = unassigned & (directions @ first > _SAME_HUE)
        cluster[np.argmax(unassigned)] = True
        if cluster.sum() >= _SMALLEST * len(directions) or not means:
            mean = directions[cluster].mean(axis=0)
            means.append(mean / max(float(np.linalg.norm(mean)), 1e-12))
        unassigned &= ~cluster
    return np.array(means, dtype=u.dtype)
