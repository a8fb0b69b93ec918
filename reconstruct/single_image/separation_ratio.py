"""Separation by the ratio of intensity and specular-free range (after Shen and Zheng 2013)."""

from __future__ import annotations

import numpy as np

from malus.reconstruct.observation import Image
from malus.reconstruct.single_image.separation_space import SourceSpace, colour_clusters

_PUREST = 0.99
"""Quantile of the saturation taken for that of diffuse light alone: above it is noise."""
_SAMPLE = 1 << 15
"""Pixels of one body colour from which the quantile is taken; up to twice as many."""


def ratio_diffuse(space: SourceSpace) -> Image:
    """Diffuse intensity m_d = |u| / κ (height, width) with one κ for every cluster of colours.

    Source: Shen and Zheng, "Real-time highlight removal using intensity ratio", Applied Optics 52
    (2013): pixels are clustered by their specular-free colour, and in every cluster the ratio of
    intensity to range is that of its purest pixels. Here the range is the root mean square over
    any number of bands instead of max − min of three, which has less noise.

    Examples
    --------
    >>> from malus.reconstruct.single_image.separation_space import source_space
    >>> picture = np.full((4, 4, 2), [3.0, 1.0])
    >>> ratio_diffuse(source_space(picture, np.ones((4, 4), bool), np.ones(2)))[0, 0].item()
    2.0
    """
    labels = colour_clusters(space)
    kappa = np.ones(int(labels.max()) + 1, dtype=space.intensity.dtype)
    chroma, intensity = space.chroma.ravel(), space.intensity.ravel()
    for label in range(len(kappa)):
        members = np.flatnonzero(space.lit & (labels == label))
        members = members[:: max(1, len(members) // _SAMPLE)]
        if len(members):
            kappa[label] = _purest(chroma[members], intensity[members])
    return space.chroma / (kappa[labels] if len(kappa) > 1 else kappa[0])


def _purest(chroma: Image, intensity: Image) -> float:
    """Saturation κ of one body colour: a high quantile, pixels weighted by their intensity."""
    saturation = chroma / intensity
    order = np.argsort(saturation, kind="stable")
    weight = np.cumsum(intensity[order], dtype=np.float64)
    rank = int(np.searchsorted(weight, _PUREST * weight[-1]))
    return max(float(saturation[order[min(rank, len(order) - 1)]]), 1e-6)
