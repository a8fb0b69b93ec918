"""Tables of one surface: as good as promised, small, and built once."""

from __future__ import annotations

import numpy as np
import pytest

from malus.reconstruct.facets import table
from malus.reconstruct.facets.chebyshev import (
    chebyshev_series,
    evaluate_pieces,
    needed,
    pieces_search,
    together,
)
from malus.reconstruct.facets.ratio import Measure, specular_dolp
from malus.reconstruct.facets.table import DiffuseTable, DolpTable, SmoothTable
from malus.reconstruct.fresnel import smooth_dolp, transmission_dolp
from malus.scenes.core.arrays import Float64Array, IndexArray

MEASURES = ("eq8", "visible", "shadowed", "shadowed_ggx")
PROMISED = 1e-6  # of a table against the integral
SURFACES = [(1.5, 11.1), (1.33, 400.0), (2.4, 1e10), (0.2 + 3.4j, 44.4), (1.0001, 100.0)]
COSINES = np.concatenate(
    [np.random.default_rng(3).random(120), 10.0 ** np.linspace(-9, 0, 60), [0.0, 1.0]]
)


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize(("eta", "sigma"), SURFACES)
def test_table_is_the_integral(measure: str, eta: complex, sigma: float) -> None:
    exact = specular_dolp(np.arccos(COSINES), eta, sigma, measure)  # type: ignore[arg-type]
    read = DolpTable(eta, sigma, measure)(COSINES)  # type: ignore[arg-type]
    np.testing.assert_allclose(read, exact, atol=PROMISED)


def test_kink_of_total_reflection() -> None:
    exact = specular_dolp(np.arccos(COSINES), 0.6, 1e5, "visible")
    np.testing.assert_allclose(DolpTable(0.6, 1e5, "visible")(COSINES), exact, atol=PROMISED)


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize(("eta", "sigma"), [*SURFACES, (0.6, 1e5)])
def test_float32_pixels(measure: str, eta: complex, sigma: float) -> None:
    """Against the integral at the rounded cosine: only the result is rounded, to 6e-8."""
    pixels = COSINES.astype(np.float32)
    read = DolpTable(eta, sigma, measure)(pixels)  # type: ignore[arg-type]
    assert read.dtype == np.float32
    zenith = np.arccos(pixels.astype(np.float64))
    exact = specular_dolp(zenith, eta, sigma, measure)  # type: ignore[arg-type]
    np.testing.assert_allclose(read, exact, atol=PROMISED + 6e-8)


@pytest.mark.parametrize("shape", [(), (1,), (3, 4), (2, 3, 4), (2, 1, 2, 2), (0,)])
def test_shapes(shape: tuple[int, ...]) -> None:
    read = DolpTable(1.5, 44.4)
    assert read(np.full(shape, 0.5)).shape == shape
    assert read(np.full(shape, 0.5, np.float32)).dtype == np.float32


def test_the_normal_is_exactly_unpolarised_to_rounding() -> None:
    assert abs(float(DolpTable(1.5, 44.4)(1.0))) <= PROMISED


def test_rounded_and_missing_cosines_stay_finite() -> None:
    pixels = np.array([-1e-7, 1 + 1e-7, np.nan], np.float32)
    assert np.all(np.isfinite(DolpTable(1.5, 44.4)(pixels)))


def test_a_table_is_small_and_built_once(monkeypatch: pytest.MonkeyPatch) -> None:
    first = DolpTable(1.5, 321.0)
    assert 10 <= first.coefficients <= 100

    def fail(*_: object) -> None:
        raise AssertionError("integrated again")

    monkeypatch.setattr(table, "integrate_dolp", fail)
    assert float(DolpTable(1.5, 321.0)(0.5)) == float(first(0.5))


def test_body_table() -> None:
    for eta in (1.33, 1.5, 4.0, 0.6):
        exact = transmission_dolp(COSINES, eta)
        np.testing.assert_allclose(DiffuseTable(eta)(COSINES), exact, atol=PROMISED)


def test_smooth_table() -> None:
    for eta in (1.33, 1.0001, 4.0, 0.6, 0.2 + 3.4j):
        exact = smooth_dolp(COSINES, eta)
        np.testing.assert_allclose(SmoothTable(eta)(COSINES), exact, atol=PROMISED)


def test_the_body_table_of_a_metal_is_finite() -> None:
    """Nothing is multiplied by it, as a metal has no body light."""
    assert np.all(np.abs(DiffuseTable(0.2 + 3.4j)(COSINES)) <= 1.0)


@pytest.mark.parametrize("arguments", [(-1.0, 1.0), (1.5, 0.0), (1.5, 1.0, "other")])
def test_bad_surface_is_refused(arguments: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match=r"eta|sigma|measure"):
        DolpTable(*arguments)


def test_series_length_follows_from_the_function() -> None:
    smooth = chebyshev_series(np.exp, 0.0, 1.0, 1e-9)
    # e^x on [0, 1] has coefficients 2 e^½ I_k(½): 1.3e-9 at k = 8, 3.5e-11 at k = 9
    assert smooth.settled
    assert smooth.coefficients.size == 9
    assert not chebyshev_series(lambda x: np.abs(x - 0.4), 0.0, 1.0, 1e-9).settled


def test_searches_together_find_what_each_finds_alone() -> None:
    """They end at different times, and halve their intervals at different places."""
    functions = (np.exp, lambda x: np.abs(x - 0.4), np.cos, lambda x: np.sqrt(x + 1e-3))

    def values(x: Float64Array, number: IndexArray) -> Float64Array:
        return np.choose(number, [function(x) for function in functions])

    found = together([pieces_search(0.0, 1.0, 1e-9, 1e-4) for _ in functions], values)
    for function, pieces in zip(functions, found, strict=True):
        (alone,) = together([pieces_search(0.0, 1.0, 1e-9, 1e-4)], lambda x, _, f=function: f(x))
        assert [(one.low, one.high) for one in pieces] == [(one.low, one.high) for one in alone]
        for one, other in zip(pieces, alone, strict=True):
            np.testing.assert_array_equal(one.coefficients, other.coefficients)
        x = np.linspace(0.0, 1.0, 1001)
        # Pieces around the kink of |x − 0.4| stay wider than 1e-4: there the error is of that size.
        near = np.abs(x - 0.4) > 1e-3
        np.testing.assert_allclose(evaluate_pieces(pieces, x)[near], function(x)[near], atol=1e-8)
    assert len({len(pieces) for pieces in found}) > 1


def test_needed_keeps_what_matters() -> None:
    series = np.array([1.0, 0.5, 1e-3, 1e-9, -1e-9])
    assert needed(series, 1e-8) == 3
    assert needed(series, 1e-2) == 2
    assert needed(np.zeros(4), 1e-8) == 1


@pytest.mark.parametrize("measure", ["eq8", "visible", "shadowed"])
@pytest.mark.parametrize("alpha", [0.02, 0.1, 0.35, 0.8])
def test_tables_of_many_indices_are_those_of_each(measure: Measure, alpha: float) -> None:
    """Interpolated in η from a few, they keep the tolerance of a table, 1e-6, at every angle."""
    eta = np.concatenate([[1.25, 1.85], np.random.default_rng(3).uniform(1.25, 1.85, 30)])
    cosine = np.concatenate([np.geomspace(1e-9, 1e-2, 20), np.linspace(0.0, 1.0, 40)])
    columns = table.specular_columns(eta, alpha**-2.0, measure)
    assert columns is not None
    steps = np.linspace(0.0, 1.0, len(columns))
    read = np.stack([np.interp(np.sqrt(cosine), steps, column) for column in columns.T], axis=1)
    indices, zeniths = np.meshgrid(eta, np.arccos(cosine))
    exact = specular_dolp(zeniths, indices, alpha**-2.0, measure, tolerance=1e-9)
    assert np.abs(read - exact).max() < PROMISED


def test_few_indices_and_metals_have_tables_of_their_own() -> None:
    for eta in (np.linspace(1.3, 1.4, 16), np.linspace(1.3, 2.4, 40), np.full(20, 0.2 + 3j)):
        assert table.specular_columns(eta, 10.0, "eq8") is None
