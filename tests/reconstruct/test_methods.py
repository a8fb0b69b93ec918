"""The methods over whole images: laws of physics, symmetries and limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up import random_observation

from malus.reconstruct import Components, Inapplicable, Observation, get_method
from malus.reconstruct import image as image_module
from malus.reconstruct.quadrature import _sphere
from malus.scenes import Distant, Uniform
from malus.scenes.lights.environment import directions, light_shares

ABOUT_NORMALS = ("eq8", "visible", "shadowed", "smooth")
# A table is within 1e-6 of the integral; DoLP is that error times I_s/I ≤ 1.
TABLE = 1e-6
SEEDS = st.integers(0, 2**32 - 1)
ALL = [f"{name}{body}" for name in (*ABOUT_NORMALS, "half_vector") for body in ("", "+body")]
EVERY = st.sampled_from(ALL)
# alpha repeats: every new surface costs a table.
ALPHAS = st.sampled_from([0.1, 0.3, 0.5])


def reconstruct(observation: Observation, method: str) -> Components:
    return get_method(method).reconstruct(observation)


def turned(vectors: np.ndarray, angle: float) -> np.ndarray:
    """Vectors (..., 3) turned anticlockwise about the viewer's axis."""
    c, s = np.cos(angle), np.sin(angle)
    return vectors @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T


def assert_turned(
    components: Components, before: Components, angle: float, method: str = "eq8"
) -> None:
    """s1 + i s2 turns by twice the angle of the frame."""
    stokes = (before.s1 + 1j * before.s2) * np.exp(2j * angle)
    # Rounding of sums of a few numbers below 2; the weights of `lights` are float32.
    bound = 1e-6 if method.startswith("lights") else 1e-12
    np.testing.assert_allclose(components.s1, stokes.real, atol=bound)
    np.testing.assert_allclose(components.s2, stokes.imag, atol=bound)


@settings(deadline=None, derandomize=True, max_examples=25)
@given(SEEDS, EVERY, ALPHAS, st.floats(-720.0, 720.0))
def test_malus_law(seed: int, method: str, alpha: float, angle_deg: float) -> None:
    components = reconstruct(random_observation(seed, alpha), method)
    turn = np.radians(angle_deg)
    mean, amplitude = (
        0.5 * (components.i_max + components.i_min),
        0.5 * (components.i_max - components.i_min),
    )
    law = mean + amplitude * np.cos(2.0 * turn - 2.0 * components.phase)  # Equation 1
    np.testing.assert_allclose(components.polarised(angle_deg), law, atol=1e-12)


@settings(deadline=None, derandomize=True, max_examples=25)
@given(SEEDS, EVERY, ALPHAS)
def test_extremes_share_the_light(seed: int, method: str, alpha: float) -> None:
    observation = random_observation(seed, alpha)
    components = reconstruct(observation, method)
    np.testing.assert_allclose(components.i_max + components.i_min, observation.image, rtol=1e-15)
    assert np.all(components.i_min >= 0.0)
    crossed = components.polarised(17.0) + components.polarised(107.0)
    np.testing.assert_allclose(crossed, observation.image, rtol=1e-14)


@settings(deadline=None, derandomize=True, max_examples=20)
@given(SEEDS, EVERY, st.integers(1, 3))
def test_quarter_turns_of_the_image(seed: int, method: str, quarters: int) -> None:
    """Pixels move, normals and the light turn with them, and so does the polarisation."""
    observation = random_observation(seed)
    angle = quarters * np.pi / 2.0
    names = ("image", "mask", "specular", "diffuse", "normals")
    moved = {name: np.rot90(getattr(observation, name), quarters) for name in names}
    moved["normals"] = turned(moved["normals"], angle)
    light = Distant(incidence_deg=70, azimuth_deg=20 + 90.0 * quarters)
    components = reconstruct(replace(observation, **moved, light=light), method)
    before = reconstruct(observation, method)
    still = Components(
        np.rot90(before.image, quarters),
        np.rot90(before.s1, quarters),
        np.rot90(before.s2, quarters),
    )
    np.testing.assert_array_equal(components.image, still.image)
    assert_turned(components, still, angle)


@settings(deadline=None, derandomize=True, max_examples=20)
@given(SEEDS, EVERY, st.floats(-180.0, 180.0))
def test_any_turn_of_normals_and_light(seed: int, method: str, angle_deg: float) -> None:
    observation = random_observation(seed)
    angle = np.radians(angle_deg)
    light = Distant(incidence_deg=70, azimuth_deg=20 + angle_deg)
    changed = replace(observation, normals=turned(observation.normals, angle), light=light)
    assert_turned(reconstruct(changed, method), reconstruct(observation, method), angle)


def test_a_turn_of_the_lights_method_turns_the_stokes_vectors() -> None:
    """As above, in the float32 of its weights."""
    observation = random_observation(5)
    changed = replace(
        observation,
        normals=turned(observation.normals, 0.6),
        light=Distant(incidence_deg=70, azimuth_deg=20 + np.degrees(0.6)),
    )
    components, before = reconstruct(changed, "lights"), reconstruct(observation, "lights")
    assert_turned(components, before, 0.6, "lights")


@pytest.mark.parametrize("method", [f"{n}{b}" for n in ABOUT_NORMALS for b in ("", "+body")])
def test_the_centre_is_unpolarised(method: str) -> None:
    observation = random_observation(1)
    normals = observation.normals.copy()
    normals[2, 3] = 0.0, 0.0, 1.0
    normals[3, 3] = 1e-4, 0.0, 1.0  # ρ ~ θ²
    components = reconstruct(replace(observation, normals=normals), method)
    assert not components.s1[2, 3].any()
    assert not components.s2[2, 3].any()
    assert np.max(np.abs(components.s1[3, 3])) <= TABLE
    assert np.max(np.abs(components.s1)) > 0.01  # elsewhere it is polarised


@pytest.mark.parametrize("name", ["eq8", "visible", "shadowed"])
@pytest.mark.parametrize("body", ["", "+body"])
def test_very_smooth_facets_are_a_smooth_surface(name: str, body: str) -> None:
    """The spread of γ is alpha and acts in the second order, times a curvature of up to 100."""
    observation = random_observation(2, alpha=1e-5)
    components, limit = (reconstruct(observation, n + body) for n in (name, "smooth"))
    bound = TABLE * observation.image + 1e-8
    assert np.all(np.abs(components.s1 - limit.s1) <= bound)
    assert np.all(np.abs(components.s2 - limit.s2) <= bound)
    assert np.max(np.abs(components.s1)) > 0.1


@settings(deadline=None, derandomize=True, max_examples=10)
@given(SEEDS, st.floats(1.0, 100.0), st.floats(0.0, 360.0))
def test_lights_of_a_distant_light_are_the_half_vector(
    seed: int, incidence: float, azimuth: float
) -> None:
    light = Distant(incidence_deg=incidence, azimuth_deg=azimuth)
    observation = replace(random_observation(seed), light=light)
    components, expected = (reconstruct(observation, n) for n in ("lights", "half_vector"))
    lit = np.all(
        components.s1 != 0.0, axis=-1
    )  # where no facet mirrors the light, nothing is polarised
    # One direction: its Stokes vector over its intensity, rounded to float32 a few times.
    np.testing.assert_allclose(components.s1[lit], expected.s1[lit], atol=1e-6)
    np.testing.assert_allclose(components.s2[lit], expected.s2[lit], atol=1e-6)


def test_lights_of_a_uniform_light_are_the_shadowed_facets() -> None:
    """Half vectors of a sphere of directions against slopes: two quadratures of one integral.

    The quadrature of the light has the error that `NODES_A_LOBE` tells, times I_s/I ≤ 1.
    """
    observation = replace(random_observation(3, steepest=0.2), light=Uniform())
    components, expected = (reconstruct(observation, n) for n in ("lights", "shadowed"))
    np.testing.assert_allclose(components.s1, expected.s1, atol=2e-3)
    np.testing.assert_allclose(components.s2, expected.s2, atol=2e-3)
    assert np.max(np.abs(expected.s1)) > 0.1


def test_lobes_between_the_directions_of_a_light_are_refused() -> None:
    """They met none, or one of many: light was unpolarised there, or polarised at random."""
    observation = replace(random_observation(3, steepest=0.2), light=Uniform())
    for alpha in (np.pi / 2 / 512 * 0.999, 1e-5):
        with pytest.raises(Inapplicable, match="lobes pass between the 512 rows"):
            reconstruct(replace(observation, alpha=alpha), "lights")
    reconstruct(replace(observation, alpha=np.pi / 2 / 512 * 1.001), "lights")
    # One direction is met by every lobe that is wide enough, and lamps have as many as these need.
    reconstruct(replace(observation, alpha=1e-5, light=Distant(incidence_deg=30)), "lights")


def test_lights_are_as_exact_as_they_say_up_to_the_rim() -> None:
    """The figures that `NODES_A_LOBE` tells; a smoother surface than that of the test above."""
    observation = replace(
        random_observation(3, alpha=0.15, height=40, width=40, steepest=0.02), light=Uniform()
    )
    none = np.zeros_like(observation.specular)
    observation = replace(observation, image=none + 1, specular=none + 1, diffuse=none)
    components, expected = (reconstruct(observation, n) for n in ("lights", "shadowed"))
    error = np.hypot(components.s1 - expected.s1, components.s2 - expected.s2).max(axis=-1)
    zenith = np.degrees(np.arccos(observation.normals[..., 2]))
    for low, high, told in ((0, 30, 2e-4), (30, 60, 2e-3), (60, 75, 7e-3), (75, 89, 9e-2)):
        # To one digit, of 1600 random normals.
        assert error[(zenith >= low) & (zenith < high)].max() < 1.25 * told


@pytest.mark.parametrize("alpha", [0.3, 0.14, 0.1])
@pytest.mark.parametrize("shape", [(128, 256), (101, 199), (37, 64), (8, 1000)])
def test_directions_of_a_map_keep_a_sun_where_it_is(shape: tuple[int, int], alpha: float) -> None:
    """Blocks of pixels need not divide the map: the last pixel lights from its place, too."""
    toward, shares = directions(*shape), light_shares(*shape)
    for row, column in ((0, 0), (shape[0] // 3, shape[1] // 2), (shape[0] - 1, shape[1] - 1)):
        values = np.zeros(shape)
        values[row, column] = 5.0
        lamp = _sphere(values, alpha)
        # One product and one division in double precision.
        np.testing.assert_allclose(lamp.toward, [toward[row, column]], atol=1e-12)
        np.testing.assert_allclose(lamp.power, 5.0 * shares[row], rtol=1e-12)


@settings(deadline=None, derandomize=True, max_examples=15)
@given(SEEDS, EVERY)
def test_a_small_change_changes_little(seed: int, method: str) -> None:
    """Slopes dρ/dθ stay below √σ η² < 10 away from the limb; cos 2φ turns faster by 1/sin θ."""
    observation = random_observation(seed)
    steps = 1e-7 * np.random.default_rng(seed).normal(size=observation.normals.shape)
    normals = observation.normals + steps
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    moved = replace(
        observation,
        normals=normals,
        specular=observation.specular * (1 + 1e-7),
        diffuse=observation.diffuse * (1 + 1e-7),
    )
    before, after = reconstruct(observation, method), reconstruct(moved, method)
    for name in ("image", "s1", "s2"):
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), atol=2e-5)


@pytest.mark.parametrize("method", ["eq8+body", "half_vector", "lights+body", "smooth"])
def test_blocks_do_not_show(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    observation = random_observation(7, height=9)
    observation.specular[4, 2] = np.nan
    whole = reconstruct(observation, method)
    monkeypatch.setattr(image_module, "BLOCK_PIXELS", 20)  # two rows, so that one is left over
    parts = reconstruct(observation, method)
    assert len(list(image_module._blocks((9, 8)))) == 5
    for name in ("image", "s1", "s2", "valid"):
        # Products of matrices of other sizes are summed in another order, in float32.
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), atol=1e-6)


@settings(deadline=None, derandomize=True, max_examples=25)
@given(
    SEEDS,
    EVERY,
    st.sampled_from(["specular", "diffuse", "normals"]),
    st.sampled_from([np.nan, np.inf, -np.inf, -3.0]),
    st.integers(0, 5),
    st.integers(0, 7),
    st.sampled_from([np.float32, np.float64]),
)
def test_invalid_pixels_are_flagged_and_others_are_not_touched(
    seed: int, method: str, name: str, value: float, y: int, x: int, dtype: type[np.floating]
) -> None:
    names = ("image", "specular", "diffuse", "normals")
    good = random_observation(seed)
    good = replace(good, **{n: getattr(good, n).astype(dtype) for n in names})
    spoilt = getattr(good, name).copy()
    spoilt[y, x, 1] = value
    components = reconstruct(replace(good, **{name: spoilt}), method)
    expected = np.ones((6, 8), dtype=bool)
    expected[y, x] = False
    np.testing.assert_array_equal(components.valid, expected)
    assert not components.stokes[y, x].any()
    before = reconstruct(good, method)
    np.testing.assert_array_equal(components.stokes[expected], before.stokes[expected])


@pytest.mark.parametrize("method", ["eq8", "lights"])
def test_roughness_is_checked(method: str) -> None:
    observation = random_observation(0)
    with pytest.raises(ValueError, match=r"alpha must be > 0 .* got -0.3"):
        reconstruct(replace(observation, alpha=-0.3), method)


def basis(view: np.ndarray) -> np.ndarray:
    """Rows h = normalise(d × up), v × h and v of the frames of rays d = −v, written by hand."""
    across = np.cross(-view, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return np.stack([across, np.cross(view, across), view], axis=-2)


LIT = [*ALL, "lights", "lights+body"]


@pytest.mark.parametrize("method", LIT)
def test_a_rotated_view_of_rotated_normals_and_light_is_the_same_picture(method: str) -> None:
    """What counts is where normal and light stand in the pixel's own frame."""
    plain = random_observation(11)
    frame = basis(np.array([0.36, -0.48, 0.8]))
    light = np.array(plain.light.direction) @ frame  # type: ignore[union-attr]
    rotated = replace(
        plain,
        normals=plain.normals @ frame,
        view_direction=np.broadcast_to(frame[2], plain.normals.shape),
        light=Distant(
            incidence_deg=np.degrees(np.arccos(light[2])),
            azimuth_deg=np.degrees(np.arctan2(light[1], light[0])),
        ),
    )
    assert_turned(reconstruct(rotated, method), reconstruct(plain, method), 0.0, method)


@pytest.mark.parametrize("method", LIT)
def test_every_pixel_has_a_view_of_its_own(method: str) -> None:
    """One picture under a perspective camera against its pixels one at a time, each turned."""
    picture = random_observation(12, height=3, width=3)
    x, y = np.meshgrid([-0.5, 0.0, 0.4], [0.6, 0.1, -0.3])
    view = np.stack([-x, -y, np.ones_like(x)], axis=-1)
    view /= np.linalg.norm(view, axis=-1, keepdims=True)
    frames = basis(view)
    picture = replace(picture, normals=np.einsum("...ji,...j->...i", frames, picture.normals))
    components = reconstruct(replace(picture, view_direction=view), method)
    for place in np.ndindex(3, 3):
        one = {
            name: getattr(picture, name)[place][None, None]
            for name in ("image", "mask", "specular", "diffuse", "normals")
        }
        light = frames[place] @ np.array(picture.light.direction)  # type: ignore[union-attr]
        one["normals"] = one["normals"] @ frames[place].T
        distant = Distant(
            incidence_deg=np.degrees(np.arccos(light[2])),
            azimuth_deg=np.degrees(np.arctan2(light[1], light[0])),
        )
        alone = reconstruct(replace(picture, **one, light=distant), method)
        mine = Components(
            *(part[place][None, None] for part in (components.image, components.s1, components.s2))
        )
        assert_turned(mine, alone, 0.0, method)


@pytest.mark.parametrize("method", LIT)
def test_the_view_of_an_orthographic_camera_changes_nothing(method: str) -> None:
    picture = random_observation(13)
    towards = np.broadcast_to([0.0, 0.0, 1.0], picture.normals.shape)
    components = reconstruct(replace(picture, view_direction=towards), method)
    assert_turned(components, reconstruct(picture, method), 0.0, method)


@pytest.mark.parametrize("view", [(0.0, 1.0, 0.0), (0.0, 0.0, 2.0), (np.nan, 0.0, 1.0)])
@pytest.mark.parametrize("method", ["eq8", "half_vector"])
def test_a_view_that_is_none_is_flagged(method: str, view: tuple[float, float, float]) -> None:
    picture = random_observation(14)
    towards = np.tile([0.0, 0.0, 1.0], (6, 8, 1))
    towards[4, 2] = view
    components = reconstruct(replace(picture, view_direction=towards), method)
    expected = np.ones((6, 8), dtype=bool)
    expected[4, 2] = False
    np.testing.assert_array_equal(components.valid, expected)
    assert not components.stokes[4, 2].any()
