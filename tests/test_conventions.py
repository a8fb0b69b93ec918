"""The conventions held against Mitsuba itself: a real polariser plate before the camera.

physics.md: a `polarizer` plate whose front faces the object turns its angle anticlockwise as the
camera sees it, from the horizontal. Axis-aligned pixels at 0 and 90 degrees cannot see a sign or
an order that is wrong; the pixels used here lie off every axis.
"""

from __future__ import annotations

import numpy as np
import pytest

from malus.renderers import Truth
from malus.renderers.family import render_family
from malus.renderers.translate import CAMERA_DISTANCE, emitter, interface_bsdf, sensor, shape_object
from malus.renderers.variant import Variant, choose, mitsuba
from malus.scenes import Camera, Dielectric, Distant, Sampling, Scene, Sphere, Uniform

CAMERA = Camera(resolution=32)
# So oblique that no light reaches the sphere through the plate.
LIGHT = Distant(incidence_deg=75.0, azimuth_deg=35.0)
SURFACE = Dielectric(eta=1.5, alpha=0.3, albedo=0.0)
SAMPLES = 256


def variants() -> list[Variant]:
    best = choose()
    return [best, choose("scalar")] if best.vectorised else [best]


@pytest.fixture(scope="module", params=variants(), ids=lambda v: v.name)
def variant(request: pytest.FixtureRequest) -> Variant:
    chosen: Variant = request.param
    return chosen


def truth_of(variant: Variant, light: Distant | Uniform, samples: int = SAMPLES) -> Truth:
    scene = Scene(shape=Sphere(), surface=SURFACE, light=light, camera=CAMERA)
    return render_family([scene], Sampling(samples=samples, seed=5), variant).truth(scene)


@pytest.fixture(scope="module")
def truth(variant: Variant) -> Truth:
    return truth_of(variant, LIGHT)


def seen_through_a_plate(variant: Variant, angle_deg: float, samples: int) -> np.ndarray:
    """What Mitsuba's camera records behind its own polariser plate, in units of our truth."""
    mi = mitsuba(variant)
    turned = mi.ScalarTransform4f().translate([0, 0, CAMERA_DISTANCE - 1.0])
    turned = (
        turned @ mi.ScalarTransform4f().rotate([0, 1, 0], 180) @ mi.ScalarTransform4f().scale(1.1)
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
        "sensor": sensor(mi, CAMERA) | ({} if variant.vectorised else {"srf": window}),
        "sphere": shape_object(mi, Sphere(), mi.load_dict(interface_bsdf(1.5, 0.3))),
        "light": emitter(mi, LIGHT),
        "integrator": {"type": "path", "max_depth": 3, "hide_emitters": True},
    }
    loaded = mi.load_dict(scene | {"plate": plate})
    image = np.asarray(mi.render(loaded, spp=samples, seed=9))
    plain = np.asarray(mi.render(mi.load_dict(scene), spp=samples, seed=9))
    channel = 1 if image.shape[-1] >= 3 else 0  # green of RGB, or the only one
    return image[..., channel], plain[..., channel]


@pytest.mark.parametrize("angle", [0.0, 30.0, 45.0, 90.0, 135.0])
def test_polarised_equals_a_plate_before_the_camera(
    variant: Variant, truth: Truth, angle: float
) -> None:
    image, plain = seen_through_a_plate(variant, angle, SAMPLES)
    # Off-axis and lit: where sign and order mistakes show.
    y, x = np.mgrid[: CAMERA.resolution, : CAMERA.resolution] - (CAMERA.resolution - 1) / 2
    off_axis = (np.abs(x) > 2) & (np.abs(y) > 2) & (np.abs(np.abs(x) - np.abs(y)) > 2)
    pixels = truth.mask & off_axis & (truth.image[..., 0] > 0.05 * truth.image.max())
    assert pixels.sum() > 50
    scale = truth.image[..., 0][pixels].sum() / plain[pixels].sum()
    theirs = image[pixels] * scale
    # The error of I(ϑ) is at most half the sum of the errors of s0, s1 and s2. Two independent
    # renders and some 100 pixels: five deviations of the difference, once in 10 000 runs.
    one = 0.5 * truth.standard_error[:, :, 0].sum(axis=-1)[pixels]
    allowed = 5 * np.sqrt(2) * one + 1e-6
    ours = truth.polarised(angle_deg=angle)[..., 0][pixels]
    assert (np.abs(ours - theirs) < allowed).all()
    # The same comparison must see a polariser that turns the wrong way or starts elsewhere.
    for wrong in (90.0 - angle, 90.0 + angle):
        if (wrong - angle) % 180.0:
            mistaken = truth.polarised(angle_deg=wrong)[..., 0][pixels]
            assert (np.abs(mistaken - theirs) > allowed).mean() > 0.2


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
    """The highlight lies on the light's side: x right, y up, rows from the top."""
    image = truth.image[..., 0]
    row, column = np.unravel_index(np.argmax(image), image.shape)
    normal = truth.normals[row, column]
    azimuth = np.degrees(np.arctan2(normal[1], normal[0]))
    assert abs(azimuth - LIGHT.azimuth_deg) < 15  # a pixel of 24 is 5°, the highlight is broad
    middle = (CAMERA.resolution - 1) / 2
    assert column > middle
    assert row < middle
