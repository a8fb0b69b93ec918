"""Degree of polarisation of one surface as a table over the zenith angle.

A table is built once, in milliseconds, and read with a few operations a pixel. It is a Chebyshev
series of a few dozen numbers in x = √cos θ, because ρ of `eq8` ends like cos θ ln cos θ at grazing
incidence; where one series is not enough (a smooth surface, total reflection), several on pieces of
[0, 1]. Pixels are read from straight lines between points on an even grid in x: one square root,
two look-ups and one multiplication, no trigonometry.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from malus.reconstruct.facets.chebyshev import (
    Function,
    Search,
    Series,
    coefficients,
    evaluate_pieces,
    lobatto,
    pieces_search,
    together,
)
from malus.reconstruct.facets.integrals import integrate_dolp
from malus.reconstruct.facets.ratio import Measure, checked_measure, checked_sigma
from malus.reconstruct.fresnel import checked_eta, excess, smooth_dolp, transmission_dolp
from malus.scenes.core.arrays import Float64Array, FloatArray, IndexArray

_PART_ERROR = 3e-7  # of the series, and as much of the straight lines: together below 1e-6
_ORDINARY = (1.25, 1.85)  # indices of liquids, glasses and plastics
_NODES = 16  # in η: the error of the interpolation falls as 3.4^-n and is 1e-8 here
_NARROWEST = 1e-5  # pieces of x that are not halved any more
_FEWEST_CELLS = 1 << 11  # of the even grid: six tables, of both lobes in RGB, take 100 kB
_MOST_CELLS = 1 << 17


class _Interpolant(NamedTuple):
    """A function of x = √cos θ, and its values on an even grid over [0, 1].

    Without a grid the function itself is evaluated. `coefficients` counts those of its series.
    """

    function: Function
    grid: Float64Array | None
    coefficients: int

    def evaluate(self, root: Float64Array) -> Float64Array:
        """Values at x = √cos θ, same shape, on straight lines between the grid's points."""
        if self.grid is None:
            return self.function(root)
        position = root * (self.grid.size - 1)
        cell = np.minimum(position.astype(np.intp), self.grid.size - 2)
        low = self.grid[cell]
        return low + (position - cell) * (self.grid[cell + 1] - low)


def _tabulated(function: Function, coefficients: int = 0) -> _Interpolant:
    """The function on a grid so fine that straight lines are off by `_PART_ERROR` at most."""
    cells = _FEWEST_CELLS
    while cells <= _MOST_CELLS:
        edges = function(np.linspace(0.0, 1.0, cells + 1))
        # A chord over two cells lies four times as far from the curve as one over a single cell.
        bulge = 0.25 * float(np.max(np.abs(edges[1:-1] - 0.5 * (edges[:-2] + edges[2:]))))
        if bulge <= _PART_ERROR:
            edges.flags.writeable = False  # shared by all callers
            return _Interpolant(function, edges, coefficients)
        cells *= 1 << max(1, int(np.ceil(0.5 * np.log2(bulge / _PART_ERROR))))
    return _Interpolant(function, None, coefficients)


@lru_cache(maxsize=1024)
def _specular(eta: complex, sigma: float, measure: Measure) -> _Interpolant:
    """Specular ρ of microfacets, cached: a surface is tabulated once a process."""
    index = eta if eta.imag else eta.real
    (table,) = _specular_together(np.array([index]), sigma, measure, _PART_ERROR)
    return table


def _specular_together(
    eta: NDArray[Any], sigma: float, measure: Measure, part_error: float
) -> list[_Interpolant]:
    """Specular ρ of microfacets of one roughness, a table for each of some indices."""

    def rho(x: Float64Array, number: IndexArray) -> Float64Array:
        zenith = np.where(x == 1.0, 0.0, np.arccos(np.square(x)))
        tolerance = 1e-6 * part_error / _PART_ERROR
        return integrate_dolp(zenith, eta[number], np.full(x.shape, sigma), measure, tolerance)

    searches = [_between_kinks(index, part_error) for index in eta]
    return [_of_pieces(pieces) for pieces in together(searches, rho)]


def _between_kinks(eta: Any, part_error: float) -> Search[list[Series]]:
    """Find the series of ρ of one index, on either side of the critical angle if there is one."""
    kink = max(0.0, -float(excess(np.asarray(eta)).real)) ** 0.25  # √cos θ at the critical angle
    ends = [0.0, kink, 1.0] if _NARROWEST < kink < 1.0 - _NARROWEST else [0.0, 1.0]
    pieces: list[Series] = []
    for low, high in pairwise(ends):
        pieces += yield from pieces_search(low, high, part_error, _NARROWEST)
    return pieces


def _of_pieces(pieces: list[Series]) -> _Interpolant:
    count = sum(piece.coefficients.size for piece in pieces)
    return _tabulated(lambda x: evaluate_pieces(pieces, x), count)


@lru_cache(maxsize=64)
def _specular_by_index(sigma: float, measure: Measure) -> Float64Array | None:
    """Chebyshev coefficients (`_NODES`, grid) in η over `_ORDINARY` of the tables of a roughness.

    None where a table has no grid.
    """
    low, high = _ORDINARY
    nodes = 0.5 * (low + high) + 0.5 * (high - low) * lobatto(_NODES)
    # Interpolation may triple an error of its nodes.
    tables = _specular_together(nodes, sigma, measure, _PART_ERROR / 3)
    grids = [table.grid for table in tables if table.grid is not None]
    if len(grids) < _NODES:
        return None
    finest = max(grid.size for grid in grids)
    root = np.linspace(0.0, 1.0, finest)
    values = [
        grid if grid.size == finest else table.function(root)
        for table, grid in zip(tables, grids, strict=True)
    ]
    return coefficients(np.stack(values), axis=0)


def specular_columns(eta: NDArray[Any], sigma: float, measure: Measure) -> Float64Array | None:
    """Tables of ρ of one roughness for many ordinary indices at once, interpolated in η from few.

    The bands of all materials of a family cost no more than the few indices at which ρ, a smooth
    function of η, is tabulated. Kept, because a family comes under several lights.

    Parameters
    ----------
    eta : (n,)
        Relative indices.
    sigma, measure
        As for `DolpTable`.

    Returns
    -------
    (grid, n) array or None
        Values on even steps of √cos θ from 0 to 1, within 1e-6; read only. None where a table of
        each index is better: for few indices, metals, or an index of no ordinary dielectric.

    Raises
    ------
    ValueError
        As for `DolpTable`.

    Examples
    --------
    >>> columns = specular_columns(np.linspace(1.4, 1.6, 40), 10.0, "eq8")
    >>> columns.shape[1], specular_columns(np.array([1.5]), 10.0, "eq8")
    (40, None)
    """
    exponent, known = float(checked_sigma(sigma)), checked_measure(measure)
    ordinary = np.isrealobj(eta) and _ORDINARY[0] <= eta.min() and eta.max() <= _ORDINARY[1]
    if not ordinary or np.unique(eta).size <= _NODES:
        return None
    return _columns(tuple(np.asarray(eta, np.float64).tolist()), exponent, known)


@lru_cache(maxsize=40)
def _columns(eta: tuple[float, ...], sigma: float, measure: Measure) -> Float64Array | None:
    series = _specular_by_index(sigma, measure)
    if series is None:
        return None
    unit = (2.0 * np.array(eta) - sum(_ORDINARY)) / (_ORDINARY[1] - _ORDINARY[0])
    columns = np.ascontiguousarray(
        series.T @ np.polynomial.chebyshev.chebvander(unit, _NODES - 1).T
    )
    columns.flags.writeable = False  # shared by all callers
    return columns


@lru_cache(maxsize=1024)
def _diffuse(eta: complex) -> _Interpolant:
    """Degree of polarisation ρ_d of diffuse light, cached."""
    return _tabulated(lambda x: transmission_dolp(np.square(x), eta))


@lru_cache(maxsize=1024)
def _smooth(eta: complex) -> _Interpolant:
    """Specular ρ of a smooth surface, cached."""
    return _tabulated(lambda x: smooth_dolp(np.square(x), eta))


class Table:
    """A degree of polarisation of one surface against the cosine of the zenith angle."""

    def __init__(self, interpolant: _Interpolant) -> None:
        """A table, from the cache where it was built before."""
        self._interpolant = interpolant

    @property
    def coefficients(self) -> int:
        """Number of coefficients in the series of this surface; 0 where there is a closed form."""
        return self._interpolant.coefficients

    @property
    def grid(self) -> Float64Array | None:
        """Values at even steps of √cos θ over [0, 1], to be joined by straight lines.

        None where no grid of up to 2^17 cells is fine enough.
        """
        return self._interpolant.grid

    def __call__(self, cos_zenith: ArrayLike) -> FloatArray:
        """Degree at cosines in [0, 1], same shape; float32 for float32, float64 for all else.

        A cosine outside [0, 1] is read as the nearer end, and NaN as 0: callers mark such pixels.
        """
        cosine = np.asarray(cos_zenith)
        root = np.sqrt(np.minimum(np.fmax(cosine.astype(np.float64).ravel(), 0.0), 1.0))
        dtype = np.float32 if cosine.dtype == np.float32 else np.float64
        return self._interpolant.evaluate(root).reshape(cosine.shape).astype(dtype)


class DolpTable(Table):
    """Specular degree of polarisation ρ of one surface against the cosine of the zenith angle.

    Parameters
    ----------
    eta : float or complex
        Relative index, > 0; metals n + ik.
    sigma : float, > 0
        Exponent of the slope distribution.
    measure : {"eq8", "visible", "shadowed", "shadowed_ggx"}

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
        """Build the table, or take it from the cache of this process."""
        index, exponent = complex(checked_eta(eta)), float(checked_sigma(sigma))
        super().__init__(_specular(index, exponent, checked_measure(measure)))


class DiffuseTable(Table):
    """Degree of polarisation ρ_d of diffuse light, `transmission_dolp`, within 1e-6.

    Examples
    --------
    >>> round(float(DiffuseTable(1.5)(0.5)), 5)
    0.09594
    """

    def __init__(self, eta: complex) -> None:
        """Build the table, or take it from the cache of this process."""
        super().__init__(_diffuse(complex(checked_eta(eta))))


class SmoothTable(Table):
    """Specular degree of polarisation ρ of a smooth surface, `smooth_dolp`, within 1e-6.

    Examples
    --------
    >>> round(float(SmoothTable(1.5)(1 / np.sqrt(1 + 1.5**2))), 5)
    1.0
    """

    def __init__(self, eta: complex) -> None:
        """Build the table, or take it from the cache of this process."""
        super().__init__(_smooth(complex(checked_eta(eta))))
