"""A small copy of one object's picture for the search of its shape, and the way back."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse

from malus.reconstruct.observation import Image, Inapplicable
from malus.reconstruct.single_image.shape_solver import Picture

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_COVERED = 0.999
"""Share of a reduced pixel that the object must cover: the outline then runs just outside."""


@dataclass(frozen=True)
class Reduction:
    """Pictures on the pixels of a small mask.

    Attributes
    ----------
    mask : (rows, columns) bool, with a margin of one pixel where the picture has one
    total : (mask pixels,) mean radiance over the bands
    pictures : what the solver has to explain
    box : slices of the whole picture
    factor : pixels of the picture along one of the small ones; need not be whole
    """

    mask: Mask
    total: Floats
    pictures: list[Picture]
    box: tuple[slice, slice]
    factor: float

    def enlarged(self, normals: Floats, whole: Mask) -> Floats:
        """Normals (mask pixels, 3) as an image (height, width, 3) on the whole mask, else zero."""
        small = np.zeros((*self.mask.shape, 3))
        small[self.mask] = normals
        nearest = ndimage.distance_transform_edt(
            ~self.mask, return_distances=False, return_indices=True
        )
        small = small[tuple(nearest)]
        inside = whole[self.box]
        rows, columns = np.nonzero(inside)
        at = (np.stack([rows, columns]) + 0.5) / self.factor - 0.5
        found = np.stack(
            [ndimage.map_coordinates(small[..., i], at, order=1, mode="nearest") for i in range(3)],
            axis=-1,
        )
        found /= np.linalg.norm(found, axis=1, keepdims=True)
        result = np.zeros((*whole.shape, 3))
        result[self.box][inside] = found
        return result


def reduce(image: Image, mask: Mask, specular: Image | None, size: int) -> Reduction:
    """A copy whose longer side has at most `size` pixels.

    Parameters
    ----------
    image, specular : (height, width, bands), the latter optional
    mask : (height, width) bool

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
        return Reduction(small, total, [Picture(total)], box, factor)
    mirrored = specular.mean(axis=-1, dtype=np.float64)[box]
    mirrored = _shrunk(np.where(inside, mirrored, 0.0), factor)[small]
    lobes = [Picture(total - mirrored, mirrored=False), Picture(mirrored, body=False)]
    return Reduction(small, total, lobes, box, factor)


def _box(mask: Mask, size: int) -> tuple[float, tuple[slice, slice]]:
    """How many pixels become one, and the object's bounding box.

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


def _shrunk(values: Floats, factor: float) -> Floats:
    """Means over squares of `factor` pixels, as a coarser sensor would measure.

    A rest at the far ends that fills no square is left out.
    """
    down, right = (_shares(length, factor) for length in values.shape)
    return np.asarray((right @ (down @ values).T).T)


def _shares(length: int, factor: float) -> sparse.csr_array:
    """Share that each of `length` pixels (columns) has in each coarser one (rows)."""
    count = max(1, math.floor(length / factor + 1e-9))
    pixel = np.arange(length)
    first = np.floor(pixel / factor).astype(int)
    in_first = np.minimum((first + 1) * factor - pixel, 1.0)
    rows, columns = np.concatenate([first, first + 1]), np.tile(pixel, 2)
    shares = np.concatenate([in_first, 1.0 - in_first]) / factor
    kept = rows < count
    return sparse.csr_array((shares[kept], (rows[kept], columns[kept])), shape=(count, length))
