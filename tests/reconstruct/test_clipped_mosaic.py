"""Highlights in frames of polarisation cameras: what is kept does not come from clipped pixels."""

from __future__ import annotations

import numpy as np
import pytest

from malus.reconstruct.photos.mosaic import demosaic, spread_over_neighbours

WHITE = 0.45


def sensor(light: np.ndarray, bayer: str | None) -> np.ndarray:
    """A frame by Malus's law: polarisers at 90, 45, 135, 0° from +x, red, green, blue 1, 0.8, 0.6.

    The light is polarised to 30 % at 23° from +x.
    """
    y, x = np.indices(light.shape)
    axes = np.radians(np.array([90, 45, 135, 0]))[2 * (y % 2) + x % 2]
    filters = 1.0
    if bayer is not None:
        letters = np.array(list(bayer))[2 * (y // 2 % 2) + x // 2 % 2]
        filters = np.select([letters == "r", letters == "g"], [1.0, 0.8], 0.6)
    passed = 0.5 * light * (1 + 0.3 * np.cos(2 * (axes - np.radians(23))))
    return (filters * passed).astype(np.float32)


@pytest.mark.parametrize("bayer", [None, "rggb", "gbrg"])
@pytest.mark.parametrize(("width", "height"), [(2.0, 1.2), (5.0, 2.0)])
def test_what_is_kept_hardly_depends_on_clipped_pixels(
    bayer: str | None, width: float, height: float
) -> None:
    """Around a highlight values that were kept were off by 6 to 16 % of their light."""
    y, x = np.indices((48, 48))
    light = 0.3 + height * np.exp(-((x - 24) ** 2 + (y - 23) ** 2) / (2 * width**2))
    frame = sensor(light, bayer)
    left_out = spread_over_neighbours(frame >= WHITE, bayer)
    whole, cut = demosaic(frame, bayer), demosaic(np.minimum(frame, WHITE), bayer)
    error = np.abs(whole - cut).max(axis=(0, 3)) / light
    # Through the fits in windows, which a clipped pixel shares with fifteen others.
    assert error[~left_out].max() < 0.04
    assert 0 < left_out.mean() < 0.4
