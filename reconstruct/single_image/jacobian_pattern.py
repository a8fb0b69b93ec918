"""Rows and columns of the entries in the sparse Jacobian of a shape's residuals.

They are the same at every step of a search. Adding, multiplying and stacking sparse matrices takes
longer than computing their values, so the entries are listed once, and a step fills in values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from malus.reconstruct.single_image.outline import Outline
from malus.scenes.core.arrays import Float64Array

Indices = NDArray[np.integer[Any]]

SURFACE = 3
"""Unknowns besides the normals: ln albedo, ln level, ln alpha."""
USUAL = 2
"""Of them, those with a residual of their own, the distance to a usual value: level and alpha."""


@dataclass(frozen=True)
class MatrixEntries:
    """Entries (n,) of a constant sparse matrix whose columns are the object's pixels."""

    rows: Indices
    columns: Indices
    values: Float64Array

    @classmethod
    def of(cls, matrix: sparse.sparray) -> MatrixEntries:
        """The entries of a matrix in any order; several may share a row and column and add up."""
        entries = sparse.coo_array(matrix)
        rows, columns = entries.coords
        return cls(rows, columns, entries.data)


class JacobianPattern:
    """Rows and columns of every entry, in the order in which `filled` takes the values.

    Parameters
    ----------
    outline : Outline
    pictures : int
        Number of pictures that are to be explained.

    Attributes
    ----------
    bending : MatrixEntries
        Of the Laplacian of one component of the normals.
    curl : MatrixEntries
        Of ∂_x, ∂_y and the identity, one below the other, from which integrability is computed.
    """

    def __init__(self, outline: Outline, pictures: int) -> None:
        count = outline.count
        # Columns beyond belong to the ring, whose normals are known.
        laplacian, *slopes = (m[:, :count] for m in (outline.laplacian, outline.dx, outline.dy))
        self.bending = MatrixEntries.of(laplacian)
        self.curl = MatrixEntries.of(sparse.vstack([*slopes, sparse.eye_array(count)]))
        entries = list(self._rows_and_columns(outline, pictures))
        rows, columns = (
            np.concatenate(part).astype(np.int32) for part in zip(*entries, strict=True)
        )
        height = pictures * count + 2 * outline.laplacian.shape[0] + count + USUAL
        self.shape = (height, 2 * count + SURFACE)
        self.order = np.lexsort((columns, rows))
        self.columns = columns[self.order]
        self.starts = np.searchsorted(rows[self.order], np.arange(height + 1)).astype(np.int32)

    def _rows_and_columns(
        self, outline: Outline, pictures: int
    ) -> Iterator[tuple[Indices, Indices]]:
        """Rows and columns of the derivatives by f, g and the surface.

        First those of each picture, then of smoothness, of integrability, of usual values.
        """
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
        yield last + count + np.arange(USUAL), 2 * count + SURFACE - USUAL + np.arange(USUAL)

    def filled(self, values: Sequence[Float64Array]) -> sparse.csr_array:
        """The Jacobian with these values, in the order of the residuals; by f, g and surface."""
        data = np.concatenate(values)[self.order]
        return sparse.csr_array((data, self.columns, self.starts), shape=self.shape)
