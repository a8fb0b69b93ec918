"""Polarised lights: where their angles count from, the pattern of the sky, and turning them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rooms import needs_arrays
from scipy.spatial.transform import Rotation

from malus.renderers.mitsuba.lighting import polarised_by
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Area,
    Camera,
    Dielectric,
    Distant,
    Environment,
    InputError,
    Light,
    Scene,
    Sky,
    Sphere,
    Suite,
    Uniform,
    load_suite,
)
from malus.scenes.lights.lights import (
    Polariser,
    SkyPolarisation,
    rotated,
    transmission_axis,
    turned,
)
from malus.scenes.lights.polarised import Oscillation, is_polarised, oscillation
from malus.scenes.lights.sky import parts
from malus.scenes.polarisation import aolp, dolp, phase, polariser_angle_deg, viewing_frame

SURFACE = Dielectric(eta=1.5, alpha=0.3)
SINGLE = 3e-6
"""A few dozen roundings of numbers of order one in 32 bits."""
DIRECTIONS = [(azimuth, elevation) for azimuth in (0, 35, 160, -70) for elevation in (-40, 0, 65)]


def lamp_at(azimuth_deg: float, elevation_deg: float, angle_deg: float) -> Distant:
    """A lamp where a camera with these angles stands."""
    towards = Camera(azimuth_deg=azimuth_deg, elevation_deg=elevation_deg).axes[2]
    lamp = Distant.towards(towards)
    return lamp.model_copy(update={"polarised": Polariser(angle_deg=angle_deg)})


@pytest.mark.parametrize("angle", [0.0, 30.0, 45.0, 110.0])
@pytest.mark.parametrize(("azimuth", "elevation"), [*DIRECTIONS, (0, 90), (0, -90)])
def test_a_polariser_turns_as_one_before_a_camera_beside_the_lamp(
    azimuth: float, elevation: float, angle: float
) -> None:
    right, up, _ = Camera(azimuth_deg=azimuth, elevation_deg=elevation).axes
    turn = np.radians(angle)
    expected = np.cos(turn) * up - np.sin(turn) * right  # anticlockwise from the vertical
    assert transmission_axis(lamp_at(azimuth, elevation, angle)) == pytest.approx(
        expected, abs=1e-9
    )


def test_beside_the_camera_both_polarisers_count_alike() -> None:
    """What the lamp sends along its axis is what a polariser at the same angle ϑ lets pass."""
    axis = transmission_axis(Distant(incidence_deg=0, polarised=Polariser(angle_deg=30)))
    assert np.degrees(np.arctan2(-axis[0], axis[1])) == pytest.approx(30.0)


def test_an_axis_and_its_opposite_are_one_angle() -> None:
    """In (−90°, 90°], also where it is level."""
    direction, level = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    assert [polariser_angle_deg(direction, sign * level) for sign in (1, -1)] == [90.0, 90.0]


def ratios(how: Oscillation, toward: np.ndarray) -> np.ndarray:
    """s1/s0 and s2/s0 (..., 2) that are rendered of light from directions `toward` (..., 3).

    In the frame of one who looks there from the origin, upright.
    """
    mi = mitsuba(choose())
    flat = toward.reshape(-1, 3)
    there = mi.Vector3f(flat.T.astype(np.float32))
    s1, s2 = (np.array(part, dtype=float) for part in polarised_by(mi, how).stokes(there)[1:])
    across = viewing_frame(np.array(mi.mueller.stokes_basis(-there), dtype=float).T, -flat)
    turned_back = (s1 + 1j * s2) * np.exp(2j * np.arctan2(across[:, 1], across[:, 0]))
    parts_of_it = np.stack([turned_back.real, turned_back.imag], axis=-1)
    return parts_of_it.reshape(*toward.shape[:-1], 2)


def field(light: Light, toward: np.ndarray) -> np.ndarray:
    """Degree times the tensor of the oscillation's direction, in the world: no frame enters."""
    how = oscillation(light)
    assert how is not None
    s1, s2 = ratios(how, toward)
    v = -toward
    right = np.cross([0.0, 1.0, 0.0], v)
    right /= np.linalg.norm(right)
    up, degree, angle = np.cross(v, right), np.hypot(s1, s2), 0.5 * np.arctan2(s2, s1)
    along = np.cos(angle) * right + np.sin(angle) * up
    tensor: np.ndarray = degree * np.outer(along, along)
    return tensor


@needs_arrays
@pytest.mark.parametrize(
    "light",
    [
        Distant(incidence_deg=50, azimuth_deg=20, polarised=Polariser(angle_deg=30, degree=0.7)),
        Area(incidence_deg=110, azimuth_deg=-60, polarised=Polariser(angle_deg=100)),
        Sky(sun=False, polarised=SkyPolarisation()),
        Sky(sun=False, turn_deg=20, tilt_deg=-50, heading_deg=130, polarised=SkyPolarisation()),
    ],
    ids=lambda light: light.label,
)
def test_turning_a_light_turns_how_it_oscillates(light: Light) -> None:
    random = np.random.default_rng(3)
    for rotation in Rotation.random(20, rng=random).as_matrix():
        moved = rotated(light, rotation)
        toward = random.normal(size=3)
        if isinstance(light, Distant):
            toward = np.array(light.direction)
            assert moved.direction == pytest.approx(tuple(rotation @ toward), abs=1e-9)
        toward /= np.linalg.norm(toward)
        expected = rotation @ field(light, toward) @ rotation.T
        assert field(moved, rotation @ toward) == pytest.approx(expected, abs=SINGLE)


@pytest.mark.parametrize("angle", [20.0, -75.0])
def test_a_turn_about_the_viewing_axis_is_that_rotation(angle: float) -> None:
    rotation = Rotation.from_euler("z", angle, degrees=True).as_matrix()
    for light in (
        lamp_at(35, 40, 30),
        Area(incidence_deg=60, polarised=Polariser(angle_deg=10)),
        Distant(incidence_deg=60),
        Sky(polarised=SkyPolarisation(), tilt_deg=30),
        Environment(heading_deg=50),
    ):
        one, other = turned(light, angle), rotated(light, rotation)
        assert one.model_dump(exclude={"polarised"}) == pytest.approx(
            other.model_dump(exclude={"polarised"})
        )
        if isinstance(light, Distant | Area) and light.polarised:
            assert transmission_axis(one) == pytest.approx(transmission_axis(other))  # type: ignore[arg-type]
            assert transmission_axis(one) == pytest.approx(rotation @ transmission_axis(light))


def test_any_rotation_of_a_map_has_three_angles() -> None:
    """About y, x and z, also where two of them are about the same axis."""
    straight = [
        Rotation.from_euler("yxz", [10, tilt, 30], degrees=True).as_matrix() for tilt in (90, -90)
    ]
    rotations = [*Rotation.random(50, rng=np.random.default_rng(1)).as_matrix(), *straight]
    for rotation in rotations:
        light = rotated(Environment(), rotation)
        assert isinstance(light, Environment)
        # The tilt's sine is 1 at 90°, where float64 tells angles to 1e-8.
        assert light.rotation == pytest.approx(rotation, abs=1e-7)


def spherical(zenith: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Unit vectors, y up; azimuths about y from z over x."""
    level = np.sin(zenith)
    parts = [level * np.sin(azimuth), np.cos(zenith), level * np.cos(azimuth)]
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


@needs_arrays
def test_the_sky_is_rayleighs_by_the_published_formulas() -> None:
    """Degree and angle in spherical coordinates, as the literature on skylight compasses has them:
    "Image-registration-based solar meridian detection for accurate and robust polarization
    navigation", the degree also Wilkie et al. (2004).

    δ = δ_max sin²γ / (1 + cos²γ), cos γ = cos θ cos θ_s + sin θ sin θ_s cos(φ − φ_s), and
    tan α = (sin θ cos θ_s − cos θ sin θ_s cos(φ − φ_s)) / (sin(φ − φ_s) sin θ_s), α from the
    meridian.
    """
    random = np.random.default_rng(2)
    for _ in range(30):
        sun_elevation, sun_azimuth = random.uniform(1, 89), random.uniform(-180, 180)
        sky = Sky(
            sun_elevation_deg=sun_elevation,
            sun_azimuth_deg=sun_azimuth,
            sun=False,
            polarised=SkyPolarisation(degree=0.75),
        )
        zenith, azimuth = random.uniform(0.05, 1.5, 40), random.uniform(-np.pi, np.pi, 40)
        theta_s, away = np.radians(90 - sun_elevation), azimuth - np.radians(sun_azimuth)
        cosine = np.cos(zenith) * np.cos(theta_s) + np.sin(zenith) * np.sin(theta_s) * np.cos(away)
        alpha = np.arctan2(
            np.sin(zenith) * np.cos(theta_s) - np.cos(zenith) * np.sin(theta_s) * np.cos(away),
            np.sin(away) * np.sin(theta_s),
        )
        how = oscillation(sky)
        assert how is not None
        polarised = ratios(how, spherical(zenith, azimuth))
        stokes = np.concatenate([np.ones((40, 1)), polarised], axis=-1)
        gamma = np.arccos(np.clip(cosine, -1, 1))
        degree = 0.75 * np.sin(gamma) ** 2 / (1 + np.cos(gamma) ** 2)
        assert dolp(stokes) == pytest.approx(degree, abs=SINGLE)
        # ψ counts from the meridian, the vertical of one who looks there, and so does α.
        seen = degree > 0.01
        assert np.sin(phase(stokes) - alpha)[seen] == pytest.approx(0.0, abs=SINGLE / 0.01)


@needs_arrays
def test_the_sky_is_light_of_dipoles() -> None:
    """Rayleigh (1871): air oscillates as sunlight does, across its direction, and sends that.

    Two dipoles along any two directions across sunlight, equally strong and not in phase; seen from
    the side, each sends what of it is across the line of sight.
    """
    sun = np.array(Sky(sun_elevation_deg=25, sun_azimuth_deg=70).to_sun)
    first = np.cross(sun, [0.3, 0.5, -0.8])
    first /= np.linalg.norm(first)
    for toward in np.random.default_rng(5).normal(size=(20, 3)):
        toward /= np.linalg.norm(toward)
        right = np.cross([0.0, 1.0, 0.0], -toward)
        right /= np.linalg.norm(right)
        up = np.cross(-toward, right)
        waves = [(dipole @ right, dipole @ up) for dipole in (first, np.cross(sun, first))]
        s0 = sum(x**2 + y**2 for x, y in waves)
        expected = [sum(x**2 - y**2 for x, y in waves) / s0, sum(2 * x * y for x, y in waves) / s0]
        how = Oscillation(tuple(sun), 1.0, scattered=True)
        assert ratios(how, toward) == pytest.approx(expected, abs=SINGLE)


@needs_arrays
def test_values_of_rayleighs_law() -> None:
    """Wholly polarised 90° from the sun, 3/5 at 60°, 1/3 at 45°, not at all towards it."""
    how = Oscillation((0.0, 0.0, -1.0), 1.0, scattered=True)
    for gamma, degree in ((90, 1.0), (60, 0.6), (120, 0.6), (45, 1 / 3), (0, 0.0)):
        turn = np.radians(gamma)
        toward = np.array([np.sin(turn), 0.0, -np.cos(turn)])
        stokes = np.array([1.0, *ratios(how, toward)])
        assert float(dolp(stokes)) == pytest.approx(degree, abs=SINGLE)
        if degree:  # beside the sun, at its height: vertical
            assert float(aolp(stokes)) == pytest.approx(np.pi / 2, abs=SINGLE)


def test_the_light_of_the_sun_itself_is_unpolarised() -> None:
    sky, sun = parts(Sky(polarised=SkyPolarisation()))
    assert is_polarised(sky)
    assert not is_polarised(sun)


def test_new_keys_at_their_defaults_are_no_new_content() -> None:
    """Ids of scenes from before lights were polarised and cameras moved."""
    expected = {
        Distant(incidence_deg=60): "d27568340916ff91",
        Area(incidence_deg=50): "6730a41af8cf4cbc",
        Environment(turn_deg=20): "547d55bd62e77326",
        Sky(): "ceb3c310c8aeb280",
    }
    for light, known in expected.items():
        assert Scene(shape=Sphere(), surface=SURFACE, light=light).id == known
    for key in ("polarised", "tilt_deg", "heading_deg"):
        assert not any(key in light.model_dump() for light in expected)
    assert "views" not in load_suite("quick").model_dump()


@pytest.mark.parametrize(
    "light",
    [
        lamp_at(30, 20, 15),
        Area(incidence_deg=20, polarised=Polariser(degree=0.5)),
        Sky(polarised=SkyPolarisation(), heading_deg=20, tilt_deg=-10),
    ],
)
def test_polarised_lights_come_back_from_json(light: Light) -> None:
    camera = Camera(azimuth_deg=30, elevation_deg=-20, roll_deg=10)
    scene = Scene(shape=Sphere(), surface=SURFACE, light=light, camera=camera)
    again = Scene.parse(json.loads(scene.model_dump_json()), "scene.json")
    assert again == scene
    assert again.id == scene.id
    unpolarised = light.model_copy(update={"polarised": None})
    assert scene.id != scene.model_copy(update={"light": unpolarised}).id


@pytest.mark.parametrize(
    ("light", "expected"),
    [
        ({"kind": "uniform", "polarised": {}}, "polarised"),
        ({"kind": "distant", "incidence_deg": 0, "polarised": {"degree": 0}}, "greater than 0"),
        ({"kind": "distant", "incidence_deg": 0, "polarised": {"angle": 3}}, "angle_deg"),
        ({"kind": "sky", "polarised": {"angle_deg": 3}}, "angle_deg"),
        ({"kind": "area", "incidence_deg": 0, "polarised": {"degree": 1.2}}, "less than or equal"),
    ],
)
def test_what_cannot_be_polarised_so_is_refused(light: dict[str, object], expected: str) -> None:
    scene = {
        "shape": {"kind": "sphere"},
        "surface": {"kind": "dielectric", "eta": 1.5, "alpha": 0.3},
    }
    with pytest.raises(InputError, match=expected):
        Scene.parse(scene | {"light": light}, "scene.json")


def suite(**more: object) -> Suite:
    return Suite.parse(
        {
            "name": "views",
            "shapes": [{"kind": "sphere"}],
            "materials": ["pmma", "water"],
            "surfaces": [{"alpha": 0.3}],
            "lights": [{"kind": "uniform"}, {"kind": "sky"}],
            "wavelengths_nm": [550],
            "methods": ["eq8"],
        }
        | more,
        "suite.toml",
    )


def test_views_are_an_axis_of_a_suite() -> None:
    scenes = list(suite(views={"count": 4, "elevation_deg": 20, "azimuth_deg": 30}).scenes())
    assert len(scenes) == 4 * 2 * 2
    cameras = {scene.camera for scene in scenes}
    assert {camera.azimuth_deg for camera in cameras} == {30.0, 120.0, -150.0, -60.0}
    assert {camera.elevation_deg for camera in cameras} == {20.0}
    # Materials, which one render serves, still stand one after the other.
    assert [scene.camera for scene in scenes[::2]] == [scene.camera for scene in scenes[1::2]]
    # A single view from the front is the suite without views.
    assert list(suite(views={"count": 1}).scenes()) == list(suite().scenes())


def test_views_and_a_moved_camera_are_refused() -> None:
    with pytest.raises(InputError, match="beside views"):
        suite(views={"count": 4}, camera={"azimuth_deg": 10})


def test_a_light_in_the_image_is_seen_from_the_camera() -> None:
    camera = Camera(azimuth_deg=25, elevation_deg=-35, roll_deg=70)
    lamp = lamp_at(80, 20, 30)
    scene = Scene(shape=Sphere(), surface=SURFACE, light=lamp, camera=camera)
    light = scene.light_in_image
    assert isinstance(light, Distant)
    assert light.direction == pytest.approx(tuple(camera.axes @ lamp.direction))
    axis = camera.axes @ transmission_axis(lamp)
    assert light.polarised is not None
    angle = polariser_angle_deg(np.array(light.direction), axis)
    assert light.polarised.angle_deg == pytest.approx(angle)
    still = scene.model_copy(update={"light": Uniform()})
    assert still.light_in_image == Uniform()


@needs_arrays
@pytest.mark.parametrize("degree", [0.25, 1.0])
def test_light_behind_a_poor_polariser_is_polarised_to_its_degree(degree: float) -> None:
    """From every direction of a wide lamp, whatever the angle at which light crosses the sheet."""
    lamp = Area(incidence_deg=50, polarised=Polariser(angle_deg=30, degree=degree))
    how = oscillation(lamp)
    assert how is not None
    toward = np.array(lamp.direction) + np.random.default_rng(2).normal(size=(20, 3)) / 5
    polarised = ratios(how, toward / np.linalg.norm(toward, axis=1, keepdims=True))
    np.testing.assert_allclose(np.hypot(*polarised.T), degree, rtol=SINGLE)
