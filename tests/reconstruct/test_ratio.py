"""R and ρ of rough surfaces: reference values, laws, limits, stress."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from malus.bench.studies.reference import reference_dolp
from malus.reconstruct.facets.ratio import polarisation_ratio, specular_dolp
from malus.reconstruct.fresnel import smooth_dolp

MEASURES = ("eq8", "visible", "shadowed")
# What is promised, by default settings, everywhere.
PROMISED = 1e-8
ZENITHS = st.one_of(st.floats(0.0, np.pi / 2), st.floats(-8, 0).map(lambda e: np.pi / 2 - 10.0**e))
SIGMAS = st.floats(-6.0, 10.0).map(lambda exponent: 10.0**exponent)
INDICES = st.one_of(
    st.floats(1.2, 4.0),
    st.floats(0.3, 1.0),
    st.floats(-12, -1).map(lambda e: 1.0 + 10.0**e),
    st.builds(complex, st.floats(0.1, 4.0), st.floats(0.01, 5.0)),
)


def test_the_shared_values(shared: Path) -> None:
    path = shared / "data" / "polarisation_ratio_reference.json"
    for row in json.loads(path.read_text("utf-8"))["rows"]:
        zenith = np.radians(row["zenith_deg"])
        computed = polarisation_ratio(zenith, row["eta"], row["sigma"], row["measure"])
        # dR = 2 dρ/(1 + ρ)², and ρ > 0 in these rows
        assert computed == pytest.approx(row["R"], abs=2 * PROMISED)


def stress_values() -> list[dict[str, object]]:
    path = Path(__file__).parents[1] / "reference" / "stress_values.json"
    return json.loads(path.read_text("utf-8"))["rows"]  # type: ignore[no-any-return]


@pytest.mark.parametrize("measure", MEASURES)
def test_stress_against_stored_reference(measure: str) -> None:
    """Zenith 0 … 90°, σ 1e-6 … 1e10, η 1, 1 ± 1e-12, 1.0001, 0.6, 4, complex, and random ones."""
    rows = [row for row in stress_values() if row["measure"] == measure][::2]
    assert len(rows) > 80
    zenith = np.array([row["zenith"] for row in rows])
    eta = np.array([complex(*row["eta"]) for row in rows])  # type: ignore[misc]
    sigma = np.array([row["sigma"] for row in rows])
    computed = specular_dolp(zenith, eta, sigma, measure)  # type: ignore[arg-type]
    error = np.abs(computed - np.array([row["rho"] for row in rows]))
    worst = int(np.argmax(error))
    assert error[worst] <= PROMISED, rows[worst]


@pytest.mark.parametrize(
    ("measure", "zenith", "eta", "sigma"),
    [
        ("eq8", 1.0, 1.5, 12.0),
        ("visible", 1.5, 0.6, 7.0),
        ("shadowed", 0.8, 1 + 1e-12, 3e3),
        ("shadowed", np.pi / 2, 0.2 + 3.4j, 1.0),
    ],
)
def test_against_reference_computed_now(
    measure: str, zenith: float, eta: complex, sigma: float
) -> None:
    reference = reference_dolp(zenith, eta, sigma, measure).value
    computed = specular_dolp(zenith, eta, sigma, measure)  # type: ignore[arg-type]
    assert computed == pytest.approx(reference, abs=PROMISED)


@settings(deadline=None, derandomize=True, max_examples=40)
@given(ZENITHS, INDICES, SIGMAS, st.sampled_from(MEASURES))
def test_two_accuracies_agree(zenith: float, eta: complex, sigma: float, measure: str) -> None:
    """What a thousandth of the tolerance changes is the error that the estimate let through."""
    computed = specular_dolp(zenith, eta, sigma, measure)  # type: ignore[arg-type]
    finer = specular_dolp(zenith, eta, sigma, measure, tolerance=1e-11)  # type: ignore[arg-type]
    assert -1.0 <= computed <= 1.0
    assert computed == pytest.approx(float(finer), abs=PROMISED)


@settings(deadline=None, derandomize=True, max_examples=20)
@given(ZENITHS, st.floats(1.2, 4.0), st.floats(-3.0, 6.0), st.sampled_from(MEASURES))
def test_continuous_in_every_argument(
    zenith: float, eta: float, exponent: float, measure: str
) -> None:
    """ρ changes by at most of the order of its arguments' change, relative ones for η and σ.

    Its steepest slope is in zenith, about √σ η² at grazing incidence: σ is at most 1e6 here.
    """
    step, sigma = 1e-11, 10.0**exponent
    inside = min(zenith, np.pi / 2 - step)
    here = float(specular_dolp(inside, eta, sigma, measure))  # type: ignore[arg-type]
    for moved in (
        specular_dolp(inside + step, eta, sigma, measure),  # type: ignore[arg-type]
        specular_dolp(inside, eta * (1 + step), sigma, measure),  # type: ignore[arg-type]
        specular_dolp(inside, eta, sigma * (1 + step), measure),  # type: ignore[arg-type]
    ):
        assert here == pytest.approx(float(moved), abs=2 * PROMISED + 2e4 * step)


@pytest.mark.parametrize("measure", MEASURES)
def test_index_one_is_continuous(measure: str) -> None:
    for zenith, sigma in ((0.7, 1e4), (1.2, 30.0), (np.pi / 2, 1.0), (1e-6, 5.0), (0.3, 1e-6)):
        below, at, above = specular_dolp(zenith, [1 - 1e-15, 1.0, 1 + 1e-15], sigma, measure)  # type: ignore[arg-type]
        assert below == pytest.approx(at, abs=PROMISED)
        assert above == pytest.approx(at, abs=PROMISED)


@pytest.mark.parametrize("measure", MEASURES)
def test_nothing_is_polarised_along_the_normal(measure: str) -> None:
    rho = specular_dolp(0.0, [1.0, 1.5, 0.6, 0.2 + 3.4j], 10.0, measure)  # type: ignore[arg-type]
    assert np.all(rho == 0.0)
    # ρ ~ θ² near 0: 1e-12 at 1e-6, times whatever the index makes of it
    assert abs(float(specular_dolp(1e-6, 1.5, 10.0, measure))) < 1e-11  # type: ignore[arg-type]


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("eta", [1.5, 4.0, 0.2 + 3.4j, 1.0])
def test_smooth_limit(measure: str, eta: complex) -> None:
    zenith = np.radians([10.0, 40.0, 56.0, 70.0, 85.0])
    rho = specular_dolp(zenith, eta, 1e10, measure)  # type: ignore[arg-type]
    # The spread of γ is 1/√σ = 1e-5 and acts in the second order, times a curvature up to 100.
    np.testing.assert_allclose(rho, smooth_dolp(np.cos(zenith), eta), atol=1e-8)


def test_smooth_total_reflection_does_not_polarise() -> None:
    assert specular_dolp(np.radians(60.0), 0.6, 1e10, "visible") == pytest.approx(0.0, abs=1e-12)


def test_very_rough_surfaces_polarise_the_other_way() -> None:
    """Physics.md: R > 1 at σ < 0.1."""
    assert polarisation_ratio(np.radians(80.0), 1.5, 1e-3) > 1.0


def test_ratio_and_dolp_say_the_same() -> None:
    rho = specular_dolp(1.0, 1.5, [0.01, 1.0, 100.0])
    ratio = polarisation_ratio(1.0, 1.5, [0.01, 1.0, 100.0])
    np.testing.assert_allclose((1 - ratio) / (1 + ratio), rho, atol=1e-15)


@pytest.mark.parametrize("shape", [(), (1,), (2, 3), (1, 2, 3), (2, 1, 2, 2), (0,), (3, 0)])
def test_shapes(shape: tuple[int, ...]) -> None:
    rho = specular_dolp(np.full(shape, 0.9), 1.5, 20.0)
    assert rho.shape == shape
    assert rho.dtype == np.float64
    np.testing.assert_array_equal(rho, np.full(shape, float(specular_dolp(0.9, 1.5, 20.0))))


def test_float32_is_computed_in_float64() -> None:
    zenith = np.array([0.3, 1.1, np.pi / 2], np.float32)  # the last one exceeds the real π/2
    exact = specular_dolp(np.minimum(zenith.astype(float), np.pi / 2), 1.5, 20.0)
    np.testing.assert_array_equal(specular_dolp(zenith, np.float32(1.5), np.float32(20)), exact)


@pytest.mark.parametrize("measure", MEASURES)
def test_many_points_are_interpolated_to_the_tolerance(measure: str) -> None:
    rng = np.random.default_rng(1)
    count = 30_000
    zenith = rng.uniform(0.0, np.pi / 2, count)
    eta, sigma = rng.uniform(1.4, 1.6, count), np.exp(rng.uniform(np.log(20), np.log(200), count))
    computed = specular_dolp(zenith, eta, sigma, measure, tolerance=1e-6)  # type: ignore[arg-type]
    some = slice(None, 400)
    exact = specular_dolp(zenith[some], eta[some], sigma[some], measure)  # type: ignore[arg-type]
    np.testing.assert_allclose(computed[some], exact, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"zenith": -0.1}, r"zenith must be in \[0, pi/2\] radians, got -0.1"),
        ({"zenith": 1.6}, r"zenith must be in \[0, pi/2\] radians, got 1.6"),
        ({"zenith": np.nan}, "zenith must be .* got nan"),
        ({"eta": 0.0}, "eta must be > 0 .* got 0.0"),
        ({"eta": np.inf}, "eta must be > 0 .* got inf"),
        ({"eta": 1.5 - 1j}, "eta must be > 0 .* got .*-1j"),
        ({"sigma": 0.0}, "sigma must be finite and > 0, got 0.0"),
        ({"sigma": [1.0, -2.0]}, "sigma must be finite and > 0, got -2.0"),
        ({"sigma": np.inf}, "sigma must be finite and > 0, got inf"),
        (
            {"measure": "eq9"},
            "measure must be one of eq8, .*, shadowed_ggx, got 'eq9'",
        ),
        ({"tolerance": 0.0}, "tolerance must be > 0, got 0.0"),
    ],
)
def test_bad_input_is_named(change: dict[str, object], message: str) -> None:
    arguments = {"zenith": 0.5, "eta": 1.5, "sigma": 10.0} | change
    with pytest.raises(ValueError, match=message):
        specular_dolp(**arguments)  # type: ignore[arg-type]
