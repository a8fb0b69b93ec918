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

from malus.reconstruct.chebyshev import Function, chebyshev_pieces, evaluate_pieces
from malus.reconstruct.facets import integrate_dolp
from malus.reconstruct.fresnel import checked_eta, excess, transmission_dolp
from malus.reconstruct.ratio import Measure, checked_measure, checked_sigma

FloatArray = NDArray[np.float64]

_PART_ERROR = 3e-7  # of the series, and as much of the straight lines: together below 1e-6
_NARROWEST = 1e-5  # pieces of x that are not halved any more
_FEWEST_CELLS = 1 << 11  # of the even grid: two columns of float32 fill half a first-level cache
_MOST_CELLS = 1 << 17
_BLOCK = 1 << 14  # pixels at once: temporaries of 64 kB, which stay in cache


class Lines(NamedTuple):
    """y = intercept + slope · x on every cell of an even grid in x = √cos θ.

    Both stand in one complex array, intercept + i slope: one look-up a pixel instead of two.
    """

    pairs: NDArray[np.complexfloating]

    @classmethod
    def through(cls, values: FloatArray, dtype: type[np.complexfloating]) -> Lines:
        """Lines between values at the edges of the cells; one cell more, for x = 1 itself."""
        cells = values.size - 1
        slope = np.append(np.diff(values), 0.0) * cells
        intercept = values - slope * (np.arange(values.size) / cells)
        return cls((intercept + 1j * slope).astype(dtype))

    def __call__(self, root: NDArray[np.floating], out: NDArray[np.floating]) -> None:
        """Write y at x ≥ 0 of any shape into `out`, both of the precision of the lines."""
        cell = (root * out.dtype.type(self.pairs.size - 1)).astype(np.int32)
        line = np.take(self.pairs, cell, mode="clip")
        np.multiply(line.imag, root, out=out)
        out += line.real


class _Table(NamedTuple):
    """`function` of x = √cos θ, and lines for float32 and float64 pixels where they do for it."""

    function: Function
    lines: tuple[Lines, Lines] | None
    coefficients: int

    def read(self, cos_zenith: ArrayLike) -> NDArray[np.floating]:
        cosine = np.asarray(cos_zenith)
        if cosine.dtype not in (np.float32, np.float64):
            cosine = cosine.astype(np.float64)
        flat = cosine.ravel()
        out = np.empty(flat.shape, flat.dtype)
        for start in range(0, flat.size, _BLOCK):
            block = slice(start, start + _BLOCK)
            root = np.sqrt(np.minimum(np.fmax(flat[block], 0.0), 1.0))
            out[block] = self.at_root(root)
        return out.reshape(cosine.shape)

    def at_root(self, root: NDArray[np.floating]) -> NDArray[np.floating]:
        if self.lines is None:
            exact = self.function(np.minimum(root.ravel(), 1.0).astype(np.float64))
            return exact.reshape(root.shape).astype(root.dtype)
        out = np.empty_like(root)
        self.lines[int(root.dtype == np.float64)](root, out)
        return out


def _tabulated(function: Function, coefficients: int = 0) -> _Table:
    """Lines on as many cells as the bulge of the function over its chords asks for."""
    cells = _FEWEST_CELLS
    while cells <= _MOST_CELLS:
        edges = function(np.linspace(0.0, 1.0, cells + 1))
        # A chord over two cells lies four times as far from the curve as one over a single cell.
        bulge = 0.25 * float(np.max(np.abs(edges[1:-1] - 0.5 * (edges[:-2] + edges[2:]))))
        if bulge <= _PART_ERROR:
            lines = Lines.through(edges, np.complex64), Lines.through(edges, np.complex128)
            return _Table(function, lines, coefficients)
        cells *= 1 << max(1, int(np.ceil(0.5 * np.log2(bulge / _PART_ERROR))))
    return _Table(function, None, coefficients)


@lru_cache(maxsize=1024)
def _specular(eta: complex, sigma: float, measure: Measure) -> _Table:
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
def _body(eta: float) -> _Table:
    return _tabulated(lambda x: transmission_dolp(np.square(x), eta))


class DolpTable:
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
        As `malus.reconstruct.ratio.specular_dolp` does.

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
        self.eta = complex(checked_eta(eta))
        self.sigma = float(checked_sigma(sigma))
        self.measure: Measure = checked_measure(measure)
        self._table = _specular(self.eta, self.sigma, self.measure)

    @property
    def coefficients(self) -> int:
        """How many numbers the series of this surface holds."""
        return self._table.coefficients

    def __call__(self, cos_zenith: ArrayLike) -> NDArray[np.floating]:
        """ρ at cosines in [0, 1], same shape; float32 for float32, float64 for all else.

        Rounding beyond [0, 1] reads as the end, and NaN as 0: telling valid pixels is not its job.
        """
        return self._table.read(cos_zenith)

    def at_root(self, root_cosine: NDArray[np.floating]) -> NDArray[np.floating]:
        """ρ at √cos θ, float32 or float64, not negative and not NaN, 1 or a little more at most.

        For images: what many tables are read at is computed and checked once.
        """
        return self._table.at_root(root_cosine)


class BodyTable:
    """Degree of polarisation ρ_d of body light against the cosine of the zenith angle.

    `transmission_dolp` of one real index, read as a `DolpTable` is, within 1e-6.

    Examples
    --------
    >>> round(float(BodyTable(1.5)(0.5)), 5)
    0.09594
    """

    def __init__(self, eta: float) -> None:
        """Build the table, or find it among those of this process."""
        index = checked_eta(eta)
        if np.iscomplexobj(index):
            raise ValueError(f"eta must be real: a metal has no body light, got {complex(index)}")
        self.eta = float(index)
        self._table = _body(self.eta)

    def __call__(self, cos_zenith: ArrayLike) -> NDArray[np.floating]:
        """ρ_d at cosines in [0, 1], same shape and floating type."""
        return self._table.read(cos_zenith)

    def at_root(self, root_cosine: NDArray[np.floating]) -> NDArray[np.floating]:
        """ρ_d at √cos θ, float32 or float64, not negative and not NaN, 1 or a little more at most.

        For images: what many tables are read at is computed and checked once.
        """
        return self._table.at_root(root_cosine)
