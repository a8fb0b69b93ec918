"""Cameras: where they look from, and what turning or moving them away must and must not change."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from malus.bench import score
from malus.renderers import Truth
from malus.renderers.families.family import render_family
from malus.renderers.mitsuba import wavefront
from malus.renderers.variant import choose
from malus.scenes import (
    Area,
    Blob,
    Camera,
    Dielectric,
    Distant,
    Environment,
    InputError,
    Sampling,
    Scene,
    Sky,
    Sphere,
    Torus,
    Uniform,
)
from malus.scenes.lights.environment import directions
from malus.scenes.lights.lights import Light, turned
from malus.scenes.polarisation import dolp
from malus.scenes.shapes.shapes import Shape

SURFACE = Dielectric(eta=1.5, alpha=0.3)
WIDE = {"projection": "perspective", "fov_deg": 60.0, "distance": 2.2}


def truth_of(
    camera: Camera,
    light: Light,
    shape: Shape | None = None,
    samples: int = 32,
    surface: Dielectric = SURFACE,
) -> Truth:
    scene = Scene(shape=shape or Sphere(), surface=surface, light=light, camera=camera)
    return render_family([scene], Sampling(samples=samples, seed=4)).truth(scene)


def wide(resolution: int = 24, **more: float) -> Camera:
    return Camera.model_validate({"resolution": resolution} | WIDE | more)


@pytest.mark.parametrize("camera", [Camera(resolution=24), wide()], ids=lambda c: c.projection)
@pytest.mark.parametrize(
    "light",
    [Distant(incidence_deg=60), Area(incidence_deg=50), Environment(), Sky()],
    ids=lambda light: light.kind,
)
def test_rolling_the_camera_is_turning_the_light_the_other_way(
    camera: Camera, light: Light
) -> None:
    """On a sphere only the light tells up from down, and a method is told of the turned one."""
    rolled = camera.model_copy(update={"roll_deg": 35.0})
    ours = truth_of(rolled, light)
    theirs = truth_of(camera, turned(light, -35.0))
    assert ours.scene.light_in_image == theirs.scene.light_in_image
    assert (ours.mask == theirs.mask).all()
    both = ours.mask
    # float32 rays and normals, with a sphere's distance lost: a few 1e-6
    assert ours.normals[both] == pytest.approx(theirs.normals[both], abs=1e-5)
    error = np.hypot(ours.standard_error, theirs.standard_error)[both]
    residual = (ours.stokes - theirs.stokes)[both] / np.maximum(error, 1e-6)
    # Directions to a distant light are the same; others are drawn in another frame.
    limit = 0.01 if isinstance(light, Distant) else 1.5
    assert np.mean(residual**2) < limit


def test_a_quarter_turn_turns_the_image() -> None:
    """At 90° pixels fall on pixels: the image turns, s1 and s2 change sign, DoLP stays."""
    light = Distant(incidence_deg=60)
    upright = truth_of(Camera(resolution=24), light, Blob(), samples=256)
    rolled = truth_of(Camera(resolution=24, roll_deg=90.0), light, Blob(), samples=256)
    # The camera turns anticlockwise, its image of the world clockwise.
    expected = np.rot90(upright.stokes, -1) * np.array([1, -1, -1])
    both = rolled.mask & np.rot90(upright.mask, -1)
    assert both.sum() > 100
    error = np.hypot(rolled.standard_error, np.rot90(upright.standard_error, -1))[both]
    error = np.maximum(error, 1e-6)
    residual = (rolled.stokes[both] - expected[both]) / error
    assert np.mean(residual**2) < 1.5  # 150 pixels of independent noise: 1 ± 0.1
    unturned = np.rot90(upright.stokes, -1)[both]
    assert np.mean(((rolled.stokes[both] - unturned) / error) ** 2) > 10


@pytest.mark.parametrize("roll", [30.0, -45.0])
def test_a_roll_turns_stokes_by_twice_the_angle(roll: float) -> None:
    """Away from rims and shadows, sampled between pixels: s1 + i s2 turns by 2θ, DoLP stays."""
    light, side, mirror = Distant(incidence_deg=70), 64, Dielectric(eta=1.5, alpha=0.3, albedo=0)
    upright = truth_of(Camera(resolution=side), light, Blob(), surface=mirror)
    rolled = truth_of(Camera(resolution=side, roll_deg=roll), light, Blob(), surface=mirror)
    middle, angle = (side - 1) / 2, np.radians(roll)
    row, column = np.mgrid[:side, :side] - middle
    # What stands at (x, y) in the rolled image stands at R(roll) (x, y) in the world.
    x, y = (
        column * np.cos(angle) + row * np.sin(angle),
        column * np.sin(angle) - row * np.cos(angle),
    )
    at = [middle - y, middle + x]

    def moved(values: np.ndarray) -> np.ndarray:
        result: np.ndarray = ndimage.map_coordinates(values, at, order=1)
        return result

    inner = (np.hypot(row, column) < 0.55 * middle) & (moved(upright.mask.astype(float)) > 0.99)
    inner &= moved(upright.image[..., 0]) > 0.1 * upright.image.max()
    s0, s1, s2 = (moved(upright.stokes[:, :, 0, k]) for k in range(3))
    turned_by = (s1 + 1j * s2) * np.exp(-2j * angle)
    found = rolled.stokes[:, :, 0]
    unit = s0[inner].mean()
    # Interpolation between pixels and the noise of 32 samples: two percent of the brightness.
    difference = (found[..., 1] + 1j * found[..., 2] - turned_by)[inner] / unit
    assert np.sqrt(np.mean(np.abs(difference) ** 2)) < 0.02
    assert np.sqrt(np.mean(np.abs(turned_by[inner]) ** 2)) / unit > 0.05
    degree = np.hypot(s1, s2)[inner] / s0[inner]
    assert np.median(np.abs(dolp(found)[inner] - degree)) < 0.02
    wrong = (found[..., 1] + 1j * found[..., 2] - turned_by * np.exp(2j * angle))[inner] / unit
    assert np.sqrt(np.mean(np.abs(wrong) ** 2)) > 0.05


def test_far_away_a_perspective_camera_is_orthographic() -> None:
    """Rays at a pixel differ from parallel ones by at most r/d, and so do facets and frames.

    The deviation of a smooth image is therefore of first order in 1/d: ten times farther, ten
    times less, until the noise of 64 samples remains.
    """
    light = Distant(incidence_deg=60)
    flat = truth_of(Camera(resolution=32), light, samples=64)
    core = flat.mask & (flat.normals[..., 2] > 0.5) & (flat.image[..., 0] > 0.01)
    deviation = []
    for distance in (20.0, 200.0, 2000.0):
        fov = float(2 * np.degrees(np.arctan(1.05 / distance)))
        camera = Camera(resolution=32, projection="perspective", fov_deg=fov, distance=distance)
        truth = truth_of(camera, light, samples=64)
        degree = [t.stokes[core][:, 0, 1:] / t.image[core] for t in (truth, flat)]
        deviation.append(float(np.abs(degree[0] - degree[1]).max()))
        # Half a radian of incidence changes DoLP by less than 1; frames turn by less than 1/d.
        assert deviation[-1] < 2.0 / distance
        assert truth.view_direction is not None
        assert 1 - truth.view_direction[..., 2].min() < (1.05 / distance) ** 2 * 1.01
    assert deviation[0] > 5 * deviation[1] > 25 * deviation[2]


@pytest.mark.parametrize("kept", [True, False], ids=["hits kept", "hits found again"])
@pytest.mark.parametrize("distance", [2000.0, 9999.0, 1e4])
def test_from_the_farthest_camera_a_ball_covers_the_pixels_that_its_equation_says(
    distance: float, kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All corners of a pixel lie on lines that pass the origin at less than the radius."""
    if not kept:
        monkeypatch.setattr(wavefront, "MOST_KEPT_HITS", 0)
    wavefront.cached_stage.cache_clear()
    side, edge = 24, 1.1 / distance
    fov = float(2 * np.degrees(np.arctan(edge)))
    camera = Camera(resolution=side, projection="perspective", fov_deg=fov, distance=distance)
    truth = truth_of(camera, Uniform(), samples=16)
    across = edge * np.hypot(*np.meshgrid(*[np.linspace(-1, 1, side + 1)] * 2))
    passes = distance * across / np.sqrt(1 + across**2)

    def of_corners(corner: np.ndarray) -> np.ndarray:
        return np.stack([corner[:-1, :-1], corner[1:, :-1], corner[:-1, 1:], corner[1:, 1:]])

    # Directions in float32 are wrong by 1e-7 or less, and points at 1e4 therefore by 1e-3.
    clear = (np.abs(of_corners(passes) - 1) > 2e-3).all(axis=0)
    assert clear.mean() > 0.95
    assert np.array_equal(truth.mask[clear], (of_corners(passes) < 1).all(axis=0)[clear])


@pytest.mark.parametrize("shape", [Sphere(), Torus(tilt_deg=50)], ids=lambda s: s.kind)
def test_the_farthest_camera_sees_what_an_orthographic_one_sees(shape: Shape) -> None:
    distance, light = 1e4, Uniform()
    fov = float(2 * np.degrees(np.arctan(1.1 / distance)))
    camera = Camera(resolution=24, projection="perspective", fov_deg=fov, distance=distance)
    far = truth_of(camera, light, shape)
    flat = truth_of(Camera(resolution=24, half_width=1.1), light, shape)
    # Points on the object are wrong by 1e-3, a hundredth of a pixel: of all outlines' pixels, one.
    assert (far.mask != flat.mask).sum() <= 1
    # Of 32 random rays of a pixel one at an outline may hit or miss, in a few pixels.
    difference = np.abs(far.image - flat.image)[..., 0]
    assert np.median(difference[flat.mask]) < 2e-3 * flat.image.max()
    assert (difference > 0.05 * flat.image.max()).sum() <= 3


@pytest.mark.parametrize("distance", [1.02, 1.005, 1.00001])
def test_a_camera_that_all_but_touches_a_ball_sees_its_front(distance: float) -> None:
    """Mitsuba's rays would begin 0.01 before the pinhole, in the ball, and see its dark back."""
    camera = wide(8, distance=distance)
    truth = truth_of(camera, Uniform())
    assert truth.mask.all()
    view = camera.view_directions()
    assert view is not None
    along = distance * view[..., 2]
    reach = along - np.sqrt(along**2 - distance**2 + 1.0)  # where x² = 1 on the ray
    expected = np.array([0.0, 0.0, distance]) - reach[..., None] * view
    # A pixel's mean normal is that at its middle but for the square of its size.
    np.testing.assert_allclose(truth.normals, expected, atol=2e-3)
    assert truth.image.min() > 0


@pytest.mark.parametrize(
    ("light", "method", "blindfolded"),
    [
        (Uniform(), "shadowed+body", 0.5),
        (Distant(incidence_deg=60), "half_vector+body", 0.9),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_the_right_physics_reaches_full_skill_from_a_rolled_camera_nearby(
    light: Light, method: str, blindfolded: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Truth and method share nothing but the conventions of view, normals, light and frame."""
    truth = truth_of(wide(40, roll_deg=30.0), light, samples=64)
    assert score(truth, method).skill == pytest.approx(1.0, abs=0.01)
    monkeypatch.setattr(Truth, "view_direction", None)  # as if all rays were parallel
    assert score(truth, method).skill < blindfolded


def test_directions_of_a_map_turn_with_it() -> None:
    plain, turn = directions(8, 16), directions(8, 16, Environment(turn_deg=90.0).rotation)
    assert turn[..., 0] == pytest.approx(-plain[..., 1], abs=1e-12)
    assert turn[..., 1] == pytest.approx(plain[..., 0], abs=1e-12)


@pytest.mark.parametrize(
    ("camera", "expected"),
    [
        ({"projection": "perspective", "fov_deg": 40}, "fov_deg and distance"),
        ({"fov_deg": 40, "distance": 3}, "projection"),
        (WIDE | {"half_width": 2}, "half_width"),
        (WIDE | {"distance": 0.5}, "greater than 1"),
        ({"projection": "fisheye"}, "orthographic"),
    ],
)
def test_a_camera_that_makes_no_sense_is_refused(camera: dict[str, object], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        Camera.parse(camera, "suite.toml")


def test_scenes_from_before_there_were_projections_keep_their_id() -> None:
    """Datasets and baselines are known by it; new keys at their default are no new content."""
    scene = Scene(shape=Sphere(), surface=SURFACE, light=Uniform())
    assert scene.id == "0d96aa40d8f03c95"
    assert set(Camera().model_dump()) == {"resolution", "half_width"}
    other = wide(roll_deg=10.0)
    assert Camera.parse(other.model_dump(mode="json"), "scene.json") == other


@pytest.mark.parametrize("backend", ["auto", "scalar"])
@pytest.mark.parametrize(
    "light", [Uniform(), Distant(incidence_deg=20), Environment()], ids=lambda o: o.kind
)
def test_what_no_ray_meets_is_refused_and_ends_no_process(light: Light, backend: str) -> None:
    """The camera looks through the hole of a ring."""
    camera = Camera(resolution=8, projection="perspective", fov_deg=5, distance=10)
    ring = Scene(
        shape=Torus(minor=0.09, tilt_deg=0),
        surface=Dielectric(eta=1.5, alpha=0.3),
        light=light,
        camera=camera,
    )
    with pytest.raises(InputError, match="expected an object that covers a pixel, found none"):
        render_family([ring], Sampling(samples=4), choose(backend))
