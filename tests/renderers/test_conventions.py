"""The conventions held against Mitsuba itself: a real polariser plate before the camera.

physics.md: a `polarizer` plate whose front faces the object turns its angle anticlockwise as the
camera sees it, from the horizontal. Axis-aligned pixels at 0 and 90 degrees cannot see a sign or
an order that is wrong; the pixels used here lie off every axis. The plate stands in the world: it
does not roll with the camera. Rays of a perspective camera cross it obliquely; an ideal polariser
then absorbs what oscillates along its absorbing axis and passes what oscillates perpendicular to
that axis and to the ray (Korger et al., "The polarization properties of a tilted polarizer",
Optics Express 21, 2013), which is what Mitsuba's plate does too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from malus.renderers import Truth
from malus.renderers.families.family import render_family
from malus.renderers.mitsuba import wavefront
from malus.renderers.mitsuba.translate import (
    ORTHOGRAPHIC_DISTANCE,
    emitter,
    sensor,
    shape_object,
    specular_bsdf,
)
from malus.renderers.variant import Variant, choose, mitsuba
from malus.scenes import Camera, Dielectric, Distant, Sampling, Scene, Sphere, Uniform
from malus.scenes.materials.surface import Facets

CAMERA = Camera(resolution=32)
WIDE = {"resolution": 32, "projection": "perspective", "fov_deg": 62.0, "distance": 2.0}
CAMERAS = {
    "orthographic": CAMERA,
    "rolled": Camera(resolution=32, roll_deg=25.0),
    "perspective": Camera.model_validate(WIDE),
    "perspective rolled": Camera.model_validate(WIDE | {"roll_deg": -40.0}),
}
# So oblique that no light reaches the sphere through the plate.
LIGHT = Distant(incidence_deg=75.0, azimuth_deg=35.0)
SURFACE = Dielectric(eta=1.5, alpha=0.3, albedo=0.0)
SAMPLES = {True: 256, False: 64}  # vectorised, scalar: ten times slower


def variants() -> list[Variant]:
    best = choose()
    return [best, choose("scalar")] if best.vectorised else [best]


@pytest.fixture(scope="module", params=variants(), ids=lambda v: v.name)
def variant(request: pytest.FixtureRequest) -> Variant:
    chosen: Variant = request.param
    return chosen


@pytest.fixture(scope="module", params=CAMERAS.values(), ids=CAMERAS.keys())
def camera(request: pytest.FixtureRequest) -> Camera:
    chosen: Camera = request.param
    return chosen


def truth_of(
    variant: Variant, light: Distant | Uniform, samples: int = 64, camera: Camera = CAMERA
) -> Truth:
    scene = Scene(shape=Sphere(), surface=SURFACE, light=light, camera=camera)
    return render_family([scene], Sampling(samples=samples, seed=5), variant).truth(scene)


@pytest.fixture(scope="module")
def truth(variant: Variant, camera: Camera) -> Truth:
    return truth_of(variant, LIGHT, SAMPLES[variant.vectorised], camera)


def seen_through_a_plate(
    variant: Variant, camera: Camera, angle_deg: float, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    """What Mitsuba's camera records behind its own polariser plate, and without it."""
    mi = mitsuba(variant)
    near = ORTHOGRAPHIC_DISTANCE - 1.0 if camera.distance is None else camera.distance - 0.2
    turned = mi.ScalarTransform4f().translate([0, 0, near])
    turned = (
        turned @ mi.ScalarTransform4f().rotate([0, 1, 0], 180) @ mi.ScalarTransform4f().scale(1.5)
    )
    plate = {
        "type": "rectangle",
        "to_world": turned,
        # ϑ counts from the vertical, the plate's theta from its own x axis, the horizontal.
        "bsdf": {"type": "polarizer", "theta": {"type": "uniform", "value": angle_deg + 90.0}},
    }
    window = {"type": "uniform", "wavelength_min": 554.5, "wavelength_max": 555.5, "value": 1.0}
    scene = {
        "type": "scene",
        "sensor": sensor(mi, camera) | ({} if variant.vectorised else {"srf": window}),
        "sphere": shape_object(mi, Sphere(), mi.load_dict(specular_bsdf(1.5, Facets((0.3, 0.3))))),
        "light": emitter(mi, LIGHT),
        "integrator": {"type": "path", "max_depth": 3, "hide_emitters": True},
    }
    loaded = mi.load_dict(scene | {"plate": plate})
    image = np.asarray(mi.render(loaded, spp=samples, seed=9))
    plain = np.asarray(mi.render(mi.load_dict(scene), spp=samples, seed=9))
    channel = 1 if image.shape[-1] >= 3 else 0  # green of RGB, or the only one
    return image[..., channel], plain[..., channel]


def passed_angles(camera: Camera, angle_deg: float) -> np.ndarray:
    """ϑ (height, width) in a pixel's frame of what a plate at `angle_deg` in the world passes."""
    rays = world_rays(camera)
    angle = np.radians(angle_deg)
    absorbing = np.array([np.cos(angle), np.sin(angle), 0.0])  # 90° from the transmission axis
    roll = np.radians(camera.roll_deg)
    up = np.array([-np.sin(roll), np.cos(roll), 0.0])
    across = np.cross(rays, up)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    upward = np.cross(across, rays)
    passed = np.cross(absorbing, rays)
    # from the vertical, anticlockwise: towards the left of the image
    left, top = -(passed * across).sum(axis=-1), (passed * upward).sum(axis=-1)
    return np.degrees(np.arctan2(left, top))


def world_rays(camera: Camera) -> np.ndarray:
    """Directions (height, width, 3) of the rays through pixels' centres, in the world."""
    side = camera.resolution
    edge = 0.0 if camera.fov_deg is None else np.tan(np.radians(camera.fov_deg / 2))
    x, y = np.meshgrid(
        np.linspace(-1, 1, 2 * side + 1)[1::2], np.linspace(1, -1, 2 * side + 1)[1::2]
    )
    roll = np.radians(camera.roll_deg)
    right, up = np.array([[np.cos(roll), np.sin(roll), 0], [-np.sin(roll), np.cos(roll), 0]])
    rays = edge * (x[..., None] * right + y[..., None] * up) - np.array([0.0, 0.0, 1.0])
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def through(truth: Truth, angles_deg: np.ndarray) -> np.ndarray:
    """I(ϑ) with another angle in every pixel, from the definition in physics.md."""
    s0, s1, s2 = np.moveaxis(truth.stokes[:, :, 0], -1, 0)
    twice = 2 * np.radians(angles_deg)
    return 0.5 * (s0 - s1 * np.cos(twice) - s2 * np.sin(twice))


def off_axis_and_lit(truth: Truth) -> np.ndarray:
    """Where sign and order mistakes show."""
    side = truth.scene.camera.resolution
    y, x = np.mgrid[:side, :side] - (side - 1) / 2
    off_axis = (np.abs(x) > 2) & (np.abs(y) > 2) & (np.abs(np.abs(x) - np.abs(y)) > 2)
    pixels: np.ndarray = truth.mask & off_axis & (truth.image[..., 0] > 0.05 * truth.image.max())
    assert pixels.sum() > 50
    return pixels


def allowed_error(truth: Truth, pixels: np.ndarray) -> np.ndarray:
    """Five deviations of the difference of two independent renders: once in 10 000 runs.

    The error of I(ϑ) is at most half the sum of the errors of s0, s1 and s2. A pixel of a
    perspective camera sees rays that cross the plate at other angles than its centre's does:
    0.1° at most, 4e-3 of the polarised part.
    """
    one = 0.5 * truth.standard_error[:, :, 0].sum(axis=-1)[pixels]
    across = 0.0 if truth.view_direction is None else 4e-3
    return 5 * np.sqrt(2) * one + 1e-6 + across * truth.image[..., 0][pixels]


@pytest.mark.parametrize("angle", [0.0, 30.0, 135.0])
def test_polarised_equals_a_plate_before_the_camera(
    variant: Variant, camera: Camera, truth: Truth, angle: float
) -> None:
    image, plain = seen_through_a_plate(variant, camera, angle, SAMPLES[variant.vectorised])
    pixels = off_axis_and_lit(truth)
    theirs = image[pixels] * (truth.image[..., 0][pixels].sum() / plain[pixels].sum())
    allowed = allowed_error(truth, pixels)
    passed = passed_angles(camera, angle)
    ours = through(truth, passed)[pixels]
    assert (np.abs(ours - theirs) < allowed).all()
    if camera.projection == "orthographic":  # the plate stands still while the camera rolls
        same = truth.polarised(angle_deg=angle - camera.roll_deg)[..., 0][pixels]
        assert same == pytest.approx(ours, abs=1e-6)
    # The same comparison must see a polariser that turns the wrong way or starts elsewhere.
    for wrong in (90.0 - passed, 90.0 + passed):
        if (np.abs(np.sin(np.radians(wrong - passed)[pixels])) > 0.2).all():
            mistaken = through(truth, wrong)[pixels]
            assert (np.abs(mistaken - theirs) > allowed).mean() > 0.2


def mirrored_stokes(camera: Camera) -> np.ndarray:
    """s1/s0 and s2/s0 (height, width, 2) of light that facets mirror from LIGHT, by Fresnel.

    It oscillates perpendicular to the plane of the ray and the light, whatever the surface.
    """
    rays, eta = world_rays(camera), 1.5
    light = np.array(LIGHT.direction)
    incidence = 0.5 * np.arccos(-rays @ light)
    refracted = np.arcsin(np.sin(incidence) / eta)
    perpendicular = (np.sin(incidence - refracted) / np.sin(incidence + refracted)) ** 2
    parallel = (np.tan(incidence - refracted) / np.tan(incidence + refracted)) ** 2
    degree = (perpendicular - parallel) / (perpendicular + parallel)
    roll = np.radians(camera.roll_deg)
    across = np.cross(rays, np.array([-np.sin(roll), np.cos(roll), 0.0]))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    oscillates = np.cross(light, rays)
    x, y = (oscillates * across).sum(-1), (oscillates * np.cross(across, rays)).sum(-1)
    twice = 2 * np.arctan2(y, x)
    return degree[..., None] * np.stack([np.cos(twice), np.sin(twice)], axis=-1)


def off_fresnel(truth: Truth) -> float:
    """Largest difference of s1/s0 and s2/s0 from `mirrored_stokes`."""
    pixels = off_axis_and_lit(truth)
    stokes = truth.stokes[:, :, 0][pixels]
    found = stokes[:, 1:] / stokes[:, :1]
    return float(np.abs(found - mirrored_stokes(truth.scene.camera)[pixels]).max())


LIMIT = {"orthographic": 2e-6, "perspective": 5e-3}
"""Of `off_fresnel`: parallel rays have one half vector, which leaves float32's rounding; a pixel of
the wide camera gathers rays that are up to 1.5° off its centre's and unequally bright."""


def test_mirrored_light_is_polarised_as_fresnel_says(camera: Camera, truth: Truth) -> None:
    """Every pixel, off axis too: nothing of Mitsuba's frames goes into the expected values."""
    assert off_fresnel(truth) < LIMIT[camera.projection]


def test_the_frame_follows_the_light_towards_the_camera(
    variant: Variant, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Light travels against the ray: a frame for the way back must not pass.

    An orthographic camera that is not rolled cannot see it; all others do.
    """
    if not variant.vectorised:
        pytest.skip("the scalar path has its frame from Mitsuba's own integrator")
    import drjit as dr

    def reversed_frame(mi: Any, sensor: Any, ray: Any) -> Any:
        across = dr.normalize(dr.cross(ray.d, sensor.world_transform() @ mi.Vector3f(0, 1, 0)))
        return mi.mueller.rotate_stokes_basis(ray.d, mi.mueller.stokes_basis(ray.d), across)

    monkeypatch.setattr("malus.renderers.mitsuba.shading.to_camera_frame", reversed_frame)
    wavefront.cached_stage.cache_clear()  # recordings know the right frame
    off = {name: off_fresnel(truth_of(variant, LIGHT, camera=c)) for name, c in CAMERAS.items()}
    wavefront.cached_stage.cache_clear()
    assert off.pop("orthographic") < LIMIT["orthographic"]
    assert min(off.values()) > 20 * LIMIT["perspective"]


def test_signs_on_a_specular_sphere_under_uniform_light(variant: Variant) -> None:
    """physics.md's self-test: right limb s1 < 0, top limb s1 > 0, upper-right limb s2 < 0."""
    stokes = truth_of(variant, Uniform(), samples=64).stokes[:, :, 0]
    middle, edge, diagonal = CAMERA.resolution // 2, 2, 5
    assert stokes[middle, -1 - edge, 1] < -0.01  # right
    assert stokes[middle, edge, 1] < -0.01  # left
    assert stokes[edge, middle, 1] > 0.01  # top
    assert stokes[-1 - edge, middle, 1] > 0.01  # bottom
    assert stokes[diagonal, -1 - diagonal, 2] < -0.01  # upper right
    assert stokes[diagonal, diagonal, 2] > 0.01  # upper left
    assert stokes[-1 - diagonal, diagonal, 2] < -0.01  # lower left


def test_the_light_comes_from_where_the_scene_says(truth: Truth) -> None:
    """The highlight lies on the light's side: x right, y up, rows from the top.

    A camera that rolls anticlockwise sees the light's azimuth fall by as much.
    """
    image = truth.image[..., 0]
    row, column = np.unravel_index(np.argmax(image), image.shape)
    normal = truth.normals[row, column]
    azimuth = np.degrees(np.arctan2(normal[1], normal[0]))
    expected = LIGHT.azimuth_deg - truth.scene.camera.roll_deg
    assert abs(azimuth - expected) < 15  # a pixel of 24 is 5°, the highlight is broad
    middle = (CAMERA.resolution - 1) / 2
    placed = np.degrees(np.arctan2(middle - row, column - middle))
    assert abs(placed - expected) < 15
