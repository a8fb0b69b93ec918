"""Separation in the maximum chromaticity-intensity space (Tan, Nishino and Ikeuchi 2004)."""

from __future__ import annotations

import numpy as np

from malus.reconstruct.observation import Image
from malus.reconstruct.single_image.separation_space import SourceSpace, colour_clusters

_BINS = 200
"""Bins of maximum chromaticity between 1/bands and 1."""
_POPULATED = 0.01
"""Share of a cluster's lit pixels that must have at least the diffuse chromaticity."""
_BRIGHT = 0.1
"""Share of a body colour's brightest intensity below which noise raises the chromaticity."""


def chromaticity_diffuse(space: SourceSpace) -> Image:
    """Diffuse intensity m_d (height, width) from the maximum chromaticity Λ of every body colour.

    With Ĩ = max over bands, σ = Ĩ / ΣI and B bands, the diffuse share of ΣI is

        ΣI_d = Ĩ (B σ − 1) / (σ (B Λ − 1)).

    Source: Tan, Nishino and Ikeuchi, "Separating reflection components based on chromaticity and
    noise analysis", IEEE PAMI 26 (2004), generalised from 3 to B bands. Specular light lowers σ
    along a curve, so Λ is the highest chromaticity of the cluster that enough bright pixels show;
    this threshold on intensity and count stands for their analysis of a camera's noise.

    Examples
    --------
    >>> from malus.reconstruct.single_image.separation_space import source_space
    >>> picture = np.full((4, 4, 2), [3.0, 1.0])
    >>> space = source_space(picture, np.ones((4, 4), bool), np.ones(2))
    >>> round(chromaticity_diffuse(space)[0, 0].item(), 1)
    2.0
    """
    bands = space.balanced.shape[-1]
    largest = space.balanced.max(axis=-1)
    total = bands * space.intensity
    chromaticity = largest / np.where(total > 0, total, 1)
    labels = colour_clusters(space)
    result = np.zeros_like(space.intensity)
    for label in range(int(labels.max()) + 1):
        members = labels == label
        lit = members & space.lit
        bright = lit & (space.intensity > _BRIGHT * _peak(space.intensity[lit]))
        diffuse_chromaticity = _diffuse_chromaticity(chromaticity[bright], bands)
        diffuse = np.maximum(bands * largest - total, 0) / (bands * diffuse_chromaticity - 1)
        result = np.where(members, diffuse / bands, result)
    return result


def _diffuse_chromaticity(chromaticity: Image, bands: int) -> float:
    """Λ: the highest bin of the histogram that enough pixels reach."""
    if chromaticity.size == 0:
        return 1.0
    # Of one primary alone, or of grey, rounding would leave the range of the bins.
    chromaticity = np.clip(chromaticity, 1.0 / bands, 1.0)
    counts, edges = np.histogram(chromaticity, bins=_BINS, range=(1.0 / bands, 1.0))
    reached = np.cumsum(counts[::-1])[::-1] >= max(1.0, _POPULATED * chromaticity.size)
    last = int(np.flatnonzero(reached)[-1])
    inside = chromaticity[(chromaticity >= edges[last]) & (chromaticity <= edges[last + 1])]
    return max(float(inside.mean()) if inside.size else float(edges[last]), edges[1])


def _peak(intensity: Image) -> float:
    """Intensity (pixels,) of the brightest pixels but for 2 %."""
    return float(np.quantile(intensity, 0.98)) if intensity.size else 0.0
