"""Where the Jacobian of a shape's residuals is not zero: the same at every step of a search.

Adding, multiplying and stacking sparse matrices takes longer than computing what they hold. Here
the places are found once, and a step only fills in values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from malus.reconstruct.single_image.outline import Outline

Floats = NDArray[np.float64]
Indices = NDArray[np.integer[Any]]

SURFACE = 3
"""Unknowns besides the normals: ln albedo, ln level, ln alpha."""
PULLS = 2
"""Of them, those that are pulled towards what is usual: ln level and ln alpha."""


@dataclass(frozen=True)
class Entries:
    """Entries (n,) of a constant sparse matrix on an outline's unknown pixels."""

    rows: Indices
    columns: Indices
    values: Floats

    @classmethod
    def of(cls, matrix: sparse.sparray) -> Entries:
        """Those of a matrix, in no particular order; some may be at the same place."""
        found = sparse.coo_array(matrix)
        rows, columns = found.coords
        return cls(rows, columns, found.data)


class Pattern:
    """Rows and columns of every entry, in the order in which `filled` takes them.

    Parameters
    ----------
    outline : Outline
    pictures : number of pictures that are to be explained

    Attributes
    ----------
    bending : Entries
        Of the Laplacian of one component of the normals.
    curl : Entries
        Of ∂_x, ∂_y and the identity, one below the other: what integrability is made of.
    """

    def __init__(self, outline: Outline, pictures: int) -> None:
        count = outline.count
        # The columns that follow are the ring's, whose normals are not unknown.
        laplacian, *slopes = (m[:, :count] for m in (outline.laplacian, outline.dx, outline.dy))
        self.bending = Entries.of(laplacian)
        self.curl = Entries.of(sparse.vstack([*slopes, sparse.eye_array(count)]))
        places = list(self._places(outline, pictures))
        rows, columns = (np.concatenate(of).astype(np.int32) for of in zip(*places, strict=True))
        height = pictures * count + 2 * outline.laplacian.shape[0] + count + PULLS
        self.shape = (height, 2 * count + SURFACE)
        self.order = np.lexsort((columns, rows))
        self.columns = columns[self.order]
        self.starts = np.searchsorted(rows[self.order], np.arange(height + 1)).astype(np.int32)

    def _places(self, outline: Outline, pictures: int) -> Iterator[tuple[Indices, Indices]]:
        """Rows and columns of a picture's slopes by f, g and the surface, of bending, of curl."""
        count, bent = outline.count, outline.laplacian.shape[0]
        pixel, first = np.arange(count), pictures * count
        for row in range(0, first, count):
            yield from ((row + pixel, pixel), (row + pixel, count + pixel))
            yield from ((row + pixel, np.full(count, 2 * count + i)) for i in range(SURFACE))
        for row in (first, first + bent):
            for column in (0, count):
                yield row + self.bending.rows, column + self.bending.columns
        last = first + 2 * bent
        for column in (0, count):
            yield last + self.curl.rows % count, column + self.curl.columns
        yield last + count + np.arange(PULLS), 2 * count + SURFACE - PULLS + np.arange(PULLS)

    def filled(self, values: Sequence[Floats]) -> sparse.csr_array:
        """The matrix with these values, listed as the residuals are, by f, by g, by the surface."""
        data = np.concatenate(values)[self.order]
        return sparse.csr_array((data, self.columns, self.starts), shape=self.shape)
