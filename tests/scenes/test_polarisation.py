"""Laws of the conventions, without a renderer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from malus.scenes import polarisation

ANGLES = st.floats(-720, 720)
EPS = 1e-12  # a few hundred roundings of numbers of order one

stokes_vectors = st.tuples(st.floats(0.1, 10), st.floats(0, 1), st.floats(0, np.pi)).map(
    lambda t: np.array([t[0], t[0] * t[1] * np.cos(2 * t[2]), t[0] * t[1] * np.sin(2 * t[2])])
)


@given(ANGLES, ANGLES)
def test_malus_law(axis: float, angle: float) -> None:
    """Light polarised along one axis passes another polariser as the squared cosine between."""
    transmitted_axis = np.radians(axis + 90.0)  # ϑ counts from the vertical, Stokes from +x
    light = np.array([1.0, np.cos(2 * transmitted_axis), np.sin(2 * transmitted_axis)])
    expected = np.cos(np.radians(angle - axis)) ** 2
    assert polarisation.polarised(light, angle) == pytest.approx(expected, abs=1e-11)


@given(stokes_vectors, ANGLES)
def test_crossed_polarisers_share_the_light(stokes: np.ndarray, angle: float) -> None:
    both = polarisation.polarised(stokes, angle) + polarisation.polarised(stokes, angle + 90.0)
    assert both == pytest.approx(stokes[0], rel=1e-9)


@given(stokes_vectors)
def test_extremes_are_reached_at_the_phase(stokes: np.ndarray) -> None:
    i_max, i_min = polarisation.extremes(stokes)
    at = float(np.degrees(polarisation.phase(stokes)))
    assert polarisation.polarised(stokes, at) == pytest.approx(i_max, abs=1e-9)
    assert polarisation.polarised(stokes, at + 90.0) == pytest.approx(i_min, abs=1e-9)


@given(stokes_vectors)
def test_extremes_and_phase_hold_everything(stokes: np.ndarray) -> None:
    i_max, i_min = polarisation.extremes(stokes)
    again = polarisation.stokes_from_extremes(i_max, i_min, polarisation.phase(stokes))
    assert again == pytest.approx(stokes, abs=1e-9)


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.uint16, int, bool])
def test_extremes_of_whole_numbers_do_not_wrap(dtype: type) -> None:
    i_max, i_min = np.array([[1, 200], [0, 1]]).astype(dtype), np.array([[0, 100], [1, 1]], dtype)
    whole = polarisation.stokes_from_extremes(i_max, i_min, np.zeros((2, 2)))
    real = polarisation.stokes_from_extremes(
        i_max.astype(float), i_min.astype(float), np.zeros((2, 2))
    )
    np.testing.assert_array_equal(whole, real)


def test_extremes_and_phase_may_be_lists() -> None:
    """Twice a list is a longer list: a phase of one number stood for 0."""
    stokes = polarisation.stokes_from_extremes([[3.0]], [[1.0]], [[0.5]])  # type: ignore[arg-type]
    expected = polarisation.stokes_from_extremes(*np.array([3.0, 1.0, 0.5])[:, None, None])
    np.testing.assert_array_equal(stokes, expected)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("tiny", [0.0, -0.0, 1e-30, -1e-30])
def test_angles_stay_below_half_a_turn(dtype: type[np.floating], tiny: float) -> None:
    """Light polarised along the axis, up to rounding: 0 and not π, which the docstrings exclude."""
    assert polarisation.aolp(np.array([1.0, 1.0, tiny], dtype)) == pytest.approx(0.0, abs=1e-20)
    assert polarisation.phase(np.array([1.0, -1.0, tiny], dtype)) == pytest.approx(0.0, abs=1e-20)


@given(stokes_vectors)
def test_aolp_is_the_phase_seen_from_the_horizontal(stokes: np.ndarray) -> None:
    if polarisation.dolp(stokes) < 1e-3:
        return  # unpolarised light has no angle
    turn = polarisation.phase(stokes) + np.pi / 2 - polarisation.aolp(stokes)
    assert np.sin(turn) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("angle", "vertical", "diagonal"),
    [(0.0, 1.0, 0.5), (45.0, 0.5, 0.0), (90.0, 0.0, 0.5), (135.0, 0.5, 1.0), (30.0, 0.75, None)],
)
def test_angles_count_anticlockwise_from_the_vertical(
    angle: float, vertical: float, diagonal: float | None
) -> None:
    """A vertical wave passes at 0°; one at +45° from +x lies 45° *clockwise* from the vertical."""
    assert polarisation.polarised(np.array([1.0, -1.0, 0.0]), angle) == pytest.approx(vertical)
    if diagonal is not None:
        wave = np.array([1.0, 0.0, 1.0])
        assert polarisation.polarised(wave, angle) == pytest.approx(diagonal, abs=EPS)


def test_angle_weights_equal_a_loop_over_angles() -> None:
    rng = np.random.default_rng(3)
    difference = rng.normal(size=(50, 3))
    angles = (0.0, 30.0, 45.0, 60.0, 90.0)
    images = np.stack([polarisation.polarised(difference, a) for a in angles])
    form = np.einsum("pi,ij,pj->p", difference, polarisation.angle_weights(angles), difference)
    assert form == pytest.approx((images**2).mean(axis=0), rel=1e-12)


def test_angle_must_be_finite() -> None:
    with pytest.raises(ValueError, match="angle_deg"):
        polarisation.polarised(np.zeros(3), float("nan"))


def test_dark_light_has_no_polarisation() -> None:
    assert polarisation.dolp(np.zeros((2, 3))).tolist() == [0.0, 0.0]


def test_viewing_frame_is_the_camera_basis_of_the_ray() -> None:
    """h = normalise(d × up), as renderers rotate their Stokes vectors to, and right-handed."""
    random = np.random.default_rng(0)
    view = random.normal(size=(50, 3))
    view /= np.linalg.norm(view, axis=-1, keepdims=True)
    horizontal = np.cross(-view, [0.0, 1.0, 0.0])
    horizontal /= np.linalg.norm(horizontal, axis=-1, keepdims=True)
    basis = np.stack([horizontal, np.cross(view, horizontal), view], axis=-2)
    vectors = random.normal(size=(50, 3))
    expected = np.einsum("nij,nj->ni", basis, vectors)
    np.testing.assert_allclose(polarisation.viewing_frame(vectors, view), expected, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(basis), 1.0, atol=1e-14)


def test_an_orthographic_view_is_the_image_frame() -> None:
    vectors = np.random.default_rng(1).normal(size=(20, 3))
    np.testing.assert_array_equal(
        polarisation.viewing_frame(vectors, np.array([0.0, 0.0, 1.0])), vectors
    )


def test_no_horizontal_under_a_view_straight_down() -> None:
    assert np.isnan(polarisation.viewing_frame(np.ones(3), np.array([0.0, 1.0, 0.0]))[:2]).all()


def test_what_is_not_a_number_has_no_degree_and_no_angle() -> None:
    """A score of it would be that of unpolarised light."""
    assert np.isnan(polarisation.dolp(np.array([[0, np.nan, 0], [-1, 0, np.nan]]))).all()
    for k in range(3):
        stokes = np.array([1.0, 0.3, 0.2])
        stokes[k] = np.nan
        assert np.isnan(polarisation.dolp(stokes))
        assert np.isnan(polarisation.aolp(stokes)) == (k > 0)
        assert np.isnan(polarisation.phase(stokes)) == (k > 0)
