"""Separation by the ratio of intensity and specular-free range, one number a body colour."""

from __future__ import annotations

import numpy as np

from malus.reconstruct.observation import Image
from malus.reconstruct.single_image.separation_space import SourceSpace, colour_clusters

_PUREST = 0.99
"""Quantile of the saturation that stands for the pure body: 1 % of the pixels are left to noise."""
_SAMPLE = 1 << 15


def ratio_diffuse(space: SourceSpace) -> Image:
    """m_d (height, width): body light as κ⁻¹ |u| with one κ for every cluster of colours.

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
    step = max(1, space.lit.size // (1 << 20))
    for label in range(len(kappa)):
        members = space.lit[::step] & (labels[::step] == label)
        if members.any():
            kappa[label] = _purest(space.chroma[::step][members], space.intensity[::step][members])
    return space.chroma / (kappa[labels] if len(kappa) > 1 else kappa[0])


def _purest(chroma: Image, intensity: Image) -> float:
    """κ of one body colour: a high quantile of the saturation, bright pixels counting more."""
    every = max(1, chroma.size // _SAMPLE)
    chroma, intensity = chroma[::every], intensity[::every]
    saturation = chroma / intensity
    order = np.argsort(saturation, kind="stable")
    weight = np.cumsum(intensity[order], dtype=np.float64)
    at = int(np.searchsorted(weight, _PUREST * weight[-1]))
    return max(float(saturation[order[min(at, len(order) - 1)]]), 1e-6)
