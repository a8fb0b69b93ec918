"""Bands of a picture as the channels of a network, and its values back at the bands.

A network knows red, green and blue. How light is polarised changes slowly with the wavelength, by
the index and by the share of light from the body, so that neighbouring bands may share a channel.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from malus.reconstruct.observation import Inapplicable
from malus.scenes.core.arrays import Float32Array, Float64Array, FloatArray


def channel_weights(bands: int, wavelengths_nm: Sequence[float] | None) -> Float64Array:
    """Weights (3, bands) whose product with the bands is red, green and blue.

    Three or more bands are sorted by falling wavelength and averaged in three groups of equal
    number, as near as can be. Of two, green is the mean; one is grey. Without wavelengths three
    bands are red, green and blue, as in picture files.

    Raises
    ------
    Inapplicable
        Several bands of unknown wavelengths that are not three.

    Examples
    --------
    >>> channel_weights(3, (450, 550, 650)).tolist()
    [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]
    >>> channel_weights(2, (450, 650)).tolist()
    [[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]]
    """
    if wavelengths_nm is None and bands not in (1, 3):
        raise Inapplicable(f"the wavelengths of the {bands} bands are not known")
    falling = np.arange(bands) if wavelengths_nm is None else np.argsort(wavelengths_nm)[::-1]
    groups = {
        1: [falling, falling, falling],
        2: [falling[:1], falling, falling[1:]],
    }.get(bands) or np.array_split(falling, 3)
    weights = np.zeros((3, bands))
    for channel, group in enumerate(groups):
        weights[channel, group] = 1.0 / len(group)
    return weights


def at_bands(values: FloatArray, weights: Float64Array) -> Float32Array:
    """Values (height, width, bands) of the channels (height, width, 3) that each band went into.

    A band that went into several channels takes their mean, by its weight in each.

    Examples
    --------
    >>> values = np.array([[[1.0, 2.0, 6.0]]])
    >>> at_bands(values, channel_weights(1, None)).tolist()
    [[[3.0]]]
    >>> [round(v, 2) for v in at_bands(values, channel_weights(2, (450, 650))).ravel().tolist()]
    [4.67, 1.33]
    """
    shares = (weights / weights.sum(axis=0)).astype(np.float32)
    return np.asarray(values @ shares, dtype=np.float32)
