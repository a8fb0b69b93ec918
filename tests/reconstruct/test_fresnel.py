"""Fresnel: laws, limits and an independent computation with many digits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf
from reference import fresnel as literal

from malus.reconstruct.fresnel import reflectances, smooth_dolp, transmission_dolp

COSINES = st.floats(0.0, 1.0)
INDICES = st.one_of(
    st.floats(1e-3, 1e3),
    st.builds(complex, st.floats(1e-3, 10.0), st.floats(0.0, 10.0)),
)
STRESS = [1 + 1e-12, 1 - 1e-12, 1.0001, 0.6, 4.0, 0.2 + 3.4j, 1.5]
# A dozen operations of half a unit in the last place each.
ROUNDING = 3e-15


def test_the_shared_vectors(shared: Path) -> None:
    rows = np.genfromtxt(shared / "data" / "fresnel_test_vectors.csv", delimiter=",", names=True)
    cosine, eta = np.cos(np.radians(rows["incidence_angle_deg"])), rows["refractive_index"]
    perpendicular, parallel = reflectances(cosine, eta)
    np.testing.assert_allclose(perpendicular, rows["reflectance_perpendicular"], atol=ROUNDING)
    np.testing.assert_allclose(parallel, rows["reflectance_parallel"], atol=ROUNDING)
    dolp = rows["specular_degree_of_polarisation"]
    np.testing.assert_allclose(smooth_dolp(cosine, eta), dolp, atol=ROUNDING)


@pytest.mark.parametrize("eta", STRESS)
@pytest.mark.parametrize("cosine", [1.0, 1 - 1e-9, 0.7, 0.2, 1e-3, 1e-7])
def test_many_digits(eta: complex, cosine: float) -> None:
    angle = mp.acos(mpf(cosine))
    perpendicular, parallel = literal.reflectances(angle, eta)
    computed = reflectances(cosine, eta)
    # Relative, because at η = 1 ± 1e-12 both are 1e-25. Near the critical angle and near η = 1 at
    # grazing incidence one rounding of c² + δ is amplified to 1e-10 of q; elsewhere nothing is.
    assert computed[0] == pytest.approx(float(perpendicular), rel=1e-9)
    assert computed[1] == pytest.approx(float(parallel), rel=1e-9, abs=1e-30)
    dolp = (perpendicular - parallel) / (perpendicular + parallel)
    assert smooth_dolp(cosine, eta) == pytest.approx(float(dolp), rel=1e-9, abs=1e-15)
    if perpendicular + parallel < 2 and abs(eta - 1) > 1e-6:
        body = (perpendicular - parallel) / (2 - perpendicular - parallel)
        assert transmission_dolp(cosine, eta) == pytest.approx(float(body), rel=1e-9)


@settings(deadline=None, derandomize=True)
@given(COSINES, INDICES)
def test_reflectances_are_fractions(cosine: float, eta: complex) -> None:
    perpendicular, parallel = reflectances(cosine, eta)
    assert 0.0 <= parallel <= perpendicular + ROUNDING  # no facet polarises the other way
    assert perpendicular <= 1.0 + ROUNDING
    assert 0.0 <= smooth_dolp(cosine, eta) <= 1.0 + ROUNDING
    assert 0.0 <= transmission_dolp(cosine, eta) <= 1.0 + ROUNDING


@settings(deadline=None, derandomize=True)
@given(st.floats(1.001, 20.0))
def test_brewster_polarises_completely(eta: float) -> None:
    cosine = 1.0 / np.hypot(1.0, eta)
    assert reflectances(cosine, eta)[1] <= ROUNDING
    assert smooth_dolp(cosine, eta) == pytest.approx(1.0, abs=1e-12)


@settings(deadline=None, derandomize=True)
@given(st.floats(0.02, 1.0), st.floats(1.001, 5.0))
def test_reversed_light_is_reflected_alike(cosine: float, eta: float) -> None:
    """Stokes' principle: the interface reflects the same from inside, at the refracted angle."""
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / eta**2)
    back = reflectances(inside, 1.0 / eta)
    for there, again in zip(reflectances(cosine, eta), back, strict=True):
        # The inner cosine was rounded by 1e-16; c ≥ 0.02 keeps what that does below 1e-11.
        assert there == pytest.approx(float(again), abs=1e-11)


def test_total_reflection() -> None:
    perpendicular, parallel = reflectances([0.79, 0.3, 0.0], 0.6)  # critical cosine 0.8
    np.testing.assert_allclose(perpendicular, 1.0, atol=ROUNDING)
    np.testing.assert_allclose(parallel, 1.0, atol=ROUNDING)
    assert np.all(smooth_dolp([0.79, 0.3, 0.0], 0.6) == 0.0)


def test_index_one_is_a_limit() -> None:
    cosine = np.linspace(0.05, 1.0, 20)
    assert np.all(np.array(reflectances(cosine, 1.0)) == 0.0)
    for near in (1 + 1e-12, 1 - 1e-12):
        # the ratio's derivative with respect to η is of the order 1/cos² ≤ 400
        np.testing.assert_allclose(smooth_dolp(cosine, 1.0), smooth_dolp(cosine, near), atol=1e-9)
    assert np.all(transmission_dolp(cosine, 1.0) == 0.0)
    assert np.all(np.isfinite(reflectances(0.0, 1.0)))


def test_faint_absorption_changes_little() -> None:
    cosine = np.linspace(0.0, 1.0, 50)
    np.testing.assert_allclose(
        transmission_dolp(cosine, 1.5 + 1e-12j), transmission_dolp(cosine, 1.5), atol=1e-10
    )


@pytest.mark.parametrize("eta", [0.0, -1.5, np.inf, np.nan, 1.5 - 0.1j, 0.0 + 1j])
def test_bad_index_is_named(eta: complex) -> None:
    with pytest.raises(ValueError, match="eta must be > 0"):
        reflectances(0.5, eta)


@pytest.mark.parametrize("cosine", [-0.1, 1.1, np.nan])
def test_bad_cosine_is_named(cosine: float) -> None:
    with pytest.raises(ValueError, match=r"cos_incidence must lie in \[0, 1\], got"):
        transmission_dolp(cosine, 1.5)
