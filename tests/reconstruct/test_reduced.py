"""The small copy of a picture is what a coarser sensor would have measured, at any factor."""

from __future__ import annotations

import numpy as np
import pytest
from skimage.transform import downscale_local_mean

from malus.reconstruct.single_image.reduced import reduce


def disc(side: int, radius: float) -> np.ndarray:
    y, x = np.mgrid[:side, :side] + 0.5 - side / 2
    return np.hypot(x, y) < radius


@pytest.mark.parametrize(("side", "size", "over", "under"), [(64, 48, 5, 4), (90, 40, 9, 4)])
def test_means_are_over_squares_of_any_size(side: int, size: int, over: int, under: int) -> None:
    """A pixel repeated `under` times and averaged over `over` is over/under pixels wide."""
    mask = disc(side, size * over / under / 2)
    image = np.random.default_rng(0).random((side, side, 2))
    reduced = reduce(image, mask, None, size)
    assert reduced.factor == over / under
    # Beyond the object all is dark, so that only its own light is in the means.
    visible = np.where(mask, image.mean(axis=-1), 0.0)[reduced.box]
    fine = visible.repeat(under, axis=0).repeat(under, axis=1)
    whole = [n // over * over for n in fine.shape]
    expected = downscale_local_mean(fine[: whole[0], : whole[1]], (over, over))
    assert reduced.mask.sum() > 0.9 * np.pi * (size / 2) ** 2
    np.testing.assert_allclose(reduced.total, expected[reduced.mask], rtol=1e-12)


def test_an_object_is_searched_at_the_size_asked_for() -> None:
    for radius in (20, 24.5, 30, 40, 48.5):
        reduced = reduce(np.ones((100, 100, 1)), disc(100, radius), None, 48)
        widest = np.ptp(np.flatnonzero(reduced.mask.any(axis=0))) + 1
        # Pixels that the object does not cover entirely are left out, one at each side.
        assert min(2 * radius, 48) - 2 <= widest <= 48


@pytest.mark.parametrize("radius", [20, 31, 40])
def test_normals_come_back_to_their_pixels(radius: float) -> None:
    mask = disc(90, radius)
    reduced = reduce(np.ones((90, 90, 1)), mask, None, 48)
    rows, columns = np.nonzero(reduced.mask)
    low = np.array([s.start for s in reduced.box])
    positions = (np.stack([rows, columns], axis=1) + 0.5) * reduced.factor + low
    small = np.column_stack([(positions - 45) / 90, np.ones(len(positions))])
    small /= np.linalg.norm(small, axis=1, keepdims=True)
    back = reduced.enlarged(small, mask)
    inner = disc(90, radius - 3 * reduced.factor)
    slopes = back[inner][:, :2] / back[inner][:, 2:]
    expected = (np.argwhere(inner) + 0.5 - 45) / 90
    # Interpolated between unit vectors: their lengths differ by 1e-4 over a pixel.
    np.testing.assert_allclose(slopes, expected, atol=1e-3)
