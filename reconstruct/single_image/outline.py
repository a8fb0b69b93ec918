"""Normals along an object's outline, and differences of neighbouring pixels.

At the occluding boundary the normal is known: it lies in the image plane, across the outline. A
mask holds the pixels that the object covers entirely, so the outline runs through the ring of
pixels just outside; there the normals are fixed, one unit vector a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.linalg import spsolve

from malus.reconstruct.observation import Inapplicable
from malus.scenes.core.arrays import BoolArray, Float64Array, IntArray
from malus.scenes.core.errors import counted

_CROSS = ndimage.generate_binary_structure(2, 1)
_SMOOTHING = 0.03
"""Width of the Gaussian that gives the outline a direction, in square roots of its area."""


@dataclass(frozen=True)
class Outline:
    """The pixels of an object, the ring of pixels around it, and derivatives over both.

    Attributes
    ----------
    mask, ring : (height, width) bool
        The object's pixels, whose normals are unknown; the ring's are known.
    across : (ring pixels, 2)
        Outward unit normals of the outline, y up.
    dx, dy : sparse (mask pixels, mask + ring pixels)
        Central differences times `size`, y up; one-sided or zero at the picture's edge.
    laplacian : sparse (pixels with all four neighbours, mask + ring pixels)
        Times `size` squared.
    size : float
        Radius in pixels of the disc of equal area: makes derivatives dimensionless.
    at_ring, whole : (mask pixels,) bool
        Pixels that touch the ring; pixels with all four neighbours, the rows of `laplacian`.
    """

    mask: BoolArray
    ring: BoolArray
    across: Float64Array
    dx: sparse.csr_array
    dy: sparse.csr_array
    laplacian: sparse.csr_array
    size: float
    at_ring: BoolArray
    whole: BoolArray

    @property
    def count(self) -> int:
        """Number of pixels of the object."""
        return int(self.mask.sum())

    def inflated(self) -> Float64Array:
        """Components x, y (mask pixels, 2) of the normals of a shape blown up from its outline.

        They are harmonic functions with the values of the outline. Those of a sphere are linear in
        position, so that a disc becomes an exact sphere.

        Examples
        --------
        >>> y, x = np.mgrid[20:-21:-1, -20:21]
        >>> disc = np.hypot(x, y) < 18
        >>> n = outline_of(disc).inflated()
        >>> bool(np.abs(n[:, 0] - x[disc] / 18.5).max() < 0.1)
        True
        """
        inner, outer = self.laplacian[:, : self.count], self.laplacian[:, self.count :]
        right = -(outer @ self.across)
        # Pixels at the picture's edge have no equation; a small diagonal keeps them finite.
        normal = inner.T @ inner + 1e-8 * sparse.eye_array(self.count)
        components = spsolve(sparse.csc_array(normal), inner.T @ right)
        length = np.linalg.norm(components, axis=1, keepdims=True)
        return np.asarray(components / np.maximum(length, 1.0))


def outline_of(mask: BoolArray) -> Outline:
    """The outline of a mask (height, width) bool.

    Raises
    ------
    Inapplicable
        If the object has fewer than 16 pixels, or no outline within the picture.
    """
    area = int(mask.sum())
    if area < 16:
        raise Inapplicable(f"the object has {counted(area, 'pixel')}: too few for a shape")
    ring = ndimage.binary_dilation(mask, _CROSS) & ~mask
    if not ring.any():
        raise Inapplicable("the object fills the picture: no outline to start a shape from")
    index = np.full(mask.shape, -1, dtype=np.int64)
    index[mask] = np.arange(area)
    index[ring] = area + np.arange(int(ring.sum()))
    size = float(np.sqrt(area / np.pi))
    neighbours = [_shifted(index, *step)[mask] for step in ((0, 1), (0, -1), (-1, 0), (1, 0))]
    right, left, up, down = neighbours
    columns = int(index.max()) + 1
    here = index[mask]
    whole = np.all([n >= 0 for n in neighbours], axis=0)
    return Outline(
        mask,
        ring,
        _across(mask, ring),
        _difference(right, left, here, columns, size),
        _difference(up, down, here, columns, size),
        _laplacian(neighbours, here, whole, columns, size),
        size,
        np.any([n >= area for n in neighbours], axis=0),
        whole,
    )


def _shifted(index: IntArray, down: int, right: int) -> IntArray:
    """Index of the neighbour `down` rows below and `right` columns to the right; −1 if none."""
    padded = np.pad(index, 1, constant_values=-1)
    height, width = index.shape
    return padded[1 + down : 1 + down + height, 1 + right : 1 + right + width]


def _difference(
    ahead: IntArray,
    behind: IntArray,
    here: IntArray,
    columns: int,
    size: float,
) -> sparse.csr_array:
    """Central differences (mask pixels, columns), one-sided where one neighbour is missing."""
    first, second = np.where(ahead >= 0, ahead, here), np.where(behind >= 0, behind, here)
    step = (ahead >= 0).astype(float) + (behind >= 0)
    scale = size / np.maximum(step, 1.0)
    rows = np.arange(len(here))
    return sparse.csr_array(
        (np.concatenate([scale, -scale]), (np.tile(rows, 2), np.concatenate([first, second]))),
        shape=(len(here), columns),
    )


def _laplacian(
    neighbours: list[IntArray],
    here: IntArray,
    whole: BoolArray,
    columns: int,
    size: float,
) -> sparse.csr_array:
    """Five-point Laplacian (whole pixels, columns)."""
    count = int(whole.sum())
    rows = np.tile(np.arange(count), 5)
    indices = np.concatenate([*(n[whole] for n in neighbours), here[whole]])
    values = np.concatenate([np.ones(4 * count), np.full(count, -4.0)]) * size**2
    return sparse.csr_array((values, (rows, indices)), shape=(count, columns))


def _across(mask: BoolArray, ring: BoolArray) -> Float64Array:
    """Outward unit vectors (ring pixels, 2), y up, from the blurred mask's gradient."""
    width = max(1.0, _SMOOTHING * float(np.sqrt(mask.sum())))
    down = ndimage.gaussian_filter1d(mask.astype(float), width, axis=0, order=1)
    down = ndimage.gaussian_filter1d(down, width, axis=1)
    right = ndimage.gaussian_filter1d(mask.astype(float), width, axis=1, order=1)
    right = ndimage.gaussian_filter1d(right, width, axis=0)
    outward = np.stack([-right[ring], down[ring]], axis=-1)
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    return np.asarray(outward / np.maximum(length, 1e-12))
