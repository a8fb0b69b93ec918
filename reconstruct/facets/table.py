"""ρ of one surface as a small table: built once in milliseconds, read at a few operations a pixel.

A table is a Chebyshev series of a few dozen numbers in x = √cos θ, because ρ of `eq8` ends like
cos θ ln cos θ at grazing incidence; where one series is not enough (a smooth surface, total
reflection), several on pieces of [0, 1]. Pixels are read from straight lines between points on
an even grid in x: one square root, two look-ups and one multiplication, no trigonometry.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from malus.reconstruct.facets.chebyshev import Function, chebyshev_pieces, evaluate_pieces
from malus.reconstruct.facets.integrals import integrate_dolp
from malus.reconstruct.facets.ratio import Measure, checked_measure, checked_sigma
from malus.reconstruct.fresnel import checked_eta, excess, smooth_dolp, transmission_dolp

FloatArray = NDArray[np.float64]

_PART_ERROR = 3e-7  # of the series, and as much of the straight lines: together below 1e-6
_NARROWEST = 1e-5  # pieces of x that are not halved any more
_FEWEST_CELLS = 1 << 11  # of the even grid: six tables, of both lobes in RGB, take 100 kB
_MOST_CELLS = 1 << 17


class _Values(NamedTuple):
    """`function` of x = √cos θ; its values on an even grid over [0, 1] where lines do for it."""

    function: Function
    grid: FloatArray | None
    coefficients: int

    def at(self, root: FloatArray) -> FloatArray:
        if self.grid is None:
            return self.function(root)
        where = root * (self.grid.size - 1)
        cell = np.minimum(where.astype(np.intp), self.grid.size - 2)
        low = self.grid[cell]
        return low + (where - cell) * (self.grid[cell + 1] - low)


def _tabulated(function: Function, coefficients: int = 0) -> _Values:
    """Lines on as many cells as the bulge of the function over its chords asks for."""
    cells = _FEWEST_CELLS
    while cells <= _MOST_CELLS:
        edges = function(np.linspace(0.0, 1.0, cells + 1))
        # A chord over two cells lies four times as far from the curve as one over a single cell.
        bulge = 0.25 * float(np.max(np.abs(edges[1:-1] - 0.5 * (edges[:-2] + edges[2:]))))
        if bulge <= _PART_ERROR:
            edges.flags.writeable = False  # shared by all callers
            return _Values(function, edges, coefficients)
        cells *= 1 << max(1, int(np.ceil(0.5 * np.log2(bulge / _PART_ERROR))))
    return _Values(function, None, coefficients)


@lru_cache(maxsize=1024)
def _specular(eta: complex, sigma: float, measure: Measure) -> _Values:
    index = eta if eta.imag else eta.real

    def rho(x: FloatArray) -> FloatArray:
        zenith = np.where(x == 1.0, 0.0, np.arccos(np.square(x)))
        filled = np.full(x.shape, index)
        return integrate_dolp(zenith, filled, np.full(x.shape, sigma), measure, 1e-6)

    kink = max(0.0, -float(excess(np.asarray(index)).real)) ** 0.25  # √cos θ at the critical angle
    ends = [0.0, kink, 1.0] if _NARROWEST < kink < 1.0 - _NARROWEST else [0.0, 1.0]
    pieces = [
        piece
        for low, high in pairwise(ends)
        for piece in chebyshev_pieces(rho, low, high, _PART_ERROR, _NARROWEST)
    ]
    count = sum(piece.coefficients.size for piece in pieces)
    return _tabulated(lambda x: evaluate_pieces(pieces, x), count)


@lru_cache(maxsize=1024)
def _body(eta: complex) -> _Values:
    return _tabulated(lambda x: transmission_dolp(np.square(x), eta))


@lru_cache(maxsize=1024)
def _smooth(eta: complex) -> _Values:
    return _tabulated(lambda x: smooth_dolp(np.square(x), eta))


class Table:
    """A degree of polarisation of one surface against the cosine of the zenith angle."""

    def __init__(self, values: _Values) -> None:
        """Hold values that were found or made before."""
        self._values = values

    @property
    def coefficients(self) -> int:
        """How many numbers the series of this surface holds; 0 where there is a closed form."""
        return self._values.coefficients

    @property
    def grid(self) -> FloatArray | None:
        """Values at even steps of √cos θ over [0, 1], between which straight lines do.

        None where no grid of up to 2^17 cells is fine enough.
        """
        return self._values.grid

    def __call__(self, cos_zenith: ArrayLike) -> NDArray[np.floating]:
        """Degree at cosines in [0, 1], same shape; float32 for float32, float64 for all else.

        Rounding beyond [0, 1] reads as the end, and NaN as 0: telling valid pixels is not its job.
        """
        cosine = np.asarray(cos_zenith)
        root = np.sqrt(np.minimum(np.fmax(cosine.astype(np.float64).ravel(), 0.0), 1.0))
        dtype = np.float32 if cosine.dtype == np.float32 else np.float64
        return self._values.at(root).reshape(cosine.shape).astype(dtype)


class DolpTable(Table):
    """Specular degree of polarisation ρ of one surface against the cosine of the zenith angle.

    Parameters
    ----------
    eta : float or complex
        Relative index, > 0; metals n + ik.
    sigma : float, > 0
        Exponent of the slope distribution.
    measure : {"eq8", "visible", "shadowed"}

    Raises
    ------
    ValueError
        As `malus.reconstruct.facets.ratio.specular_dolp` does.

    Notes
    -----
    Within 1e-6 of `specular_dolp`. The table of a surface is built once a process.

    Examples
    --------
    >>> table = DolpTable(1.5, 10.0)
    >>> round(float(table(np.cos(np.radians(50)))), 5)
    0.8095
    >>> table(np.zeros((2, 3), np.float32)).dtype
    dtype('float32')
    """

    def __init__(self, eta: complex, sigma: float, measure: Measure = "eq8") -> None:
        """Build the table, or find it among those of this process."""
        index, exponent = complex(checked_eta(eta)), float(checked_sigma(sigma))
        super().__init__(_specular(index, exponent, checked_measure(measure)))


class BodyTable(Table):
    """Degree of polarisation ρ_d of body light, `transmission_dolp`, within 1e-6.

    Examples
    --------
    >>> round(float(BodyTable(1.5)(0.5)), 5)
    0.09594
    """

    def __init__(self, eta: complex) -> None:
        """Build the table, or find it among those of this process."""
        super().__init__(_body(complex(checked_eta(eta))))


class SmoothTable(Table):
    """Degree of polarisation ρ of light mirrored by a smooth surface, `smooth_dolp`, within 1e-6.

    Examples
    --------
    >>> round(float(SmoothTable(1.5)(1 / np.sqrt(1 + 1.5**2))), 5)
    1.0
    """

    def __init__(self, eta: complex) -> None:
        """Build the table, or find it among those of this process."""
        super().__init__(_smooth(complex(checked_eta(eta))))
