"""A small copy of one object's picture for the search of its shape; its normals enlarged again."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, sparse

from malus.reconstruct.observation import Image, Inapplicable
from malus.reconstruct.single_image.shape_solver import MaskedPicture
from malus.scenes.core.arrays import BoolArray, Float64Array

_COVERED = 0.999
"""Share of a reduced pixel that the object must cover: the outline then runs just outside."""


@dataclass(frozen=True)
class ReducedPicture:
    """One object's picture, and its lobes if they were separated, on a coarse grid of pixels.

    Attributes
    ----------
    mask : (rows, columns) bool
        Pixels that the object covers, with a margin of one pixel where the picture has one.
    total : (mask pixels,)
        Mean radiance over the bands.
    pictures : list of MaskedPicture
        The pictures that a shape has to explain: the whole one, or one of each lobe.
    box : two slices
        The part of the original picture that was reduced.
    factor : float
        Side of a coarse pixel in original ones; need not be whole.
    """

    mask: BoolArray
    total: Float64Array
    pictures: list[MaskedPicture]
    box: tuple[slice, slice]
    factor: float

    def enlarged(self, normals: Float64Array, original_mask: BoolArray) -> Float64Array:
        """Normals (mask pixels, 3) as an image (height, width, 3) on the original mask, else 0."""
        small = np.zeros((*self.mask.shape, 3))
        small[self.mask] = normals
        nearest = ndimage.distance_transform_edt(
            ~self.mask, return_distances=False, return_indices=True
        )
        small = small[tuple(nearest)]
        inside = original_mask[self.box]
        rows, columns = np.nonzero(inside)
        positions = (np.stack([rows, columns]) + 0.5) / self.factor - 0.5
        enlarged = np.stack(
            [
                ndimage.map_coordinates(small[..., axis], positions, order=1, mode="nearest")
                for axis in range(3)
            ],
            axis=-1,
        )
        enlarged /= np.linalg.norm(enlarged, axis=1, keepdims=True)
        result = np.zeros((*original_mask.shape, 3))
        result[self.box][inside] = enlarged
        return result


def reduce(image: Image, mask: BoolArray, specular: Image | None, size: int) -> ReducedPicture:
    """Shrink the object's picture so that its longer side has at most `size` pixels.

    Parameters
    ----------
    image : (height, width, bands) radiance
    mask : (height, width) bool
    specular : (height, width, bands) radiance, optional
        Specular light, where it was separated before.
    size : int

    Raises
    ------
    Inapplicable
        If the mask is empty.
    """
    if not mask.any():
        raise Inapplicable("the mask is empty: no object")
    factor, box = _box(mask, size)
    inside = mask[box]
    coverage = _shrunk(inside.astype(np.float64), factor)
    small = coverage > _COVERED
    grey = image.mean(axis=-1, dtype=np.float64)
    total = _shrunk(np.where(inside, grey[box], 0.0), factor)[small]
    if specular is None:
        return ReducedPicture(small, total, [MaskedPicture(total)], box, factor)
    grey_specular = specular.mean(axis=-1, dtype=np.float64)[box]
    reduced_specular = _shrunk(np.where(inside, grey_specular, 0.0), factor)[small]
    lobes = [
        MaskedPicture(total - reduced_specular, specular=False),
        MaskedPicture(reduced_specular, diffuse=False),
    ]
    return ReducedPicture(small, total, lobes, box, factor)


def _box(mask: BoolArray, size: int) -> tuple[float, tuple[slice, slice]]:
    """Side of a coarse pixel in original ones, and the object's bounding box.

    The box has a margin for the ring around the object, unless the picture's edge cuts it.
    """
    spans = [np.flatnonzero(mask.any(axis=1 - axis))[[0, -1]] for axis in (0, 1)]
    factor = max(1.0, max(last - first + 1 for first, last in spans) / size)
    margin = math.ceil(2 * factor)
    slices = [
        slice(max(first - margin, 0), min(last + 1 + margin, length))
        for (first, last), length in zip(spans, mask.shape, strict=True)
    ]
    return factor, (slices[0], slices[1])


def _shrunk(values: Float64Array, factor: float) -> Float64Array:
    """Means over squares of `factor` pixels, as a coarser sensor would measure.

    What fills no whole square at the far ends is left out.
    """
    down, right = (_shares(length, factor) for length in values.shape)
    return np.asarray((right @ (down @ values).T).T)


def _shares(length: int, factor: float) -> sparse.csr_array:
    """Share that each of `length` pixels (columns) has in each coarse one (rows)."""
    count = max(1, math.floor(length / factor + 1e-9))
    pixel = np.arange(length)
    first = np.floor(pixel / factor).astype(int)
    in_first = np.minimum((first + 1) * factor - pixel, 1.0)
    rows, columns = np.concatenate([first, first + 1]), np.tile(pixel, 2)
    shares = np.concatenate([in_first, 1.0 - in_first]) / factor
    kept = rows < count
    return sparse.csr_array((shares[kept], (rows[kept], columns[kept])), shape=(count, length))
