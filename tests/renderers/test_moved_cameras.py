"""Cameras around the object: rays, matrices, and that moving one is turning all else.

Polarised lights show more of a frame than unpolarised ones: how they oscillate turns with them.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from plain import CHALK, COPPER, PAINT, POLARISED
from rooms import needs_arrays

from malus.bench import score
from malus.renderers import render
from malus.renderers.datasets.scene_folder import SCENE, read_record, read_scene, write_scene
from malus.renderers.mitsuba.translate import sensor
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Area,
    Camera,
    Distant,
    Environment,
    Light,
    Placed,
    Polariser,
    Sampling,
    Scene,
    Sky,
    SkyPolarisation,
    Sphere,
    Superquadric,
    Surroundings,
)
from malus.scenes.lights.lights import rotated, turned
from malus.scenes.materials.surface import Surface

WIDE = {"projection": "perspective", "fov_deg": 60.0, "distance": 2.2}
PLACES = [(0.0, 0.0), (35.0, 20.0), (-120.0, -50.0), (80.0, 90.0), (180.0, 0.0)]
LIGHTS: list[Light] = [
    *POLARISED,
    Sky(
        sun_elevation_deg=20, heading_deg=30, tilt_deg=-40, turn_deg=15, polarised=SkyPolarisation()
    ),
]


def scene_of(
    light: Light, surface: Surface = PAINT, camera: Camera | None = None, **more: object
) -> Scene:
    content = {"light": light, "surface": surface, "camera": camera or Camera(resolution=12)}
    return Scene.model_validate({"shape": Sphere()} | content | more)


@pytest.mark.parametrize(("azimuth", "elevation"), PLACES)
@pytest.mark.parametrize("roll", [0.0, -70.0])
@pytest.mark.parametrize("lens", [{}, WIDE], ids=["orthographic", "perspective"])
def test_axes_and_matrices_are_those_of_mitsubas_rays(
    azimuth: float, elevation: float, roll: float, lens: dict[str, object]
) -> None:
    """Where Mitsuba's ray through a pixel's centre goes, K [R | t] shows at that pixel."""
    mi = mitsuba(choose())
    turns = {"azimuth_deg": azimuth, "elevation_deg": elevation, "roll_deg": roll}
    camera = Camera.model_validate({"resolution": 5} | turns | lens)
    looking = mi.load_dict(sensor(mi, camera))
    view = camera.view_directions()
    for row, column in np.ndindex(5, 5):
        position = mi.Point2f((column + 0.5) / 5, (row + 0.5) / 5)
        ray = looking.sample_ray(0.0, 0.0, position, mi.Point2f(0.5))[0]
        along, start = np.ravel(ray.d).astype(float), np.ravel(ray.o).astype(float)
        expected = [0.0, 0.0, 1.0] if view is None else view[row, column]
        assert -camera.axes @ along == pytest.approx(expected, abs=2e-6)  # float32 rays
        x, y, z = camera.extrinsics() @ [*(start + 1.7 * along), 1.0]
        seen = [x / z, y / z, 1.0] if lens else [x, y, 1.0]
        u, v, _ = camera.intrinsics() @ seen
        assert (u, v) == pytest.approx((column, row), abs=1e-5)


def test_the_camera_stands_where_its_angles_say() -> None:
    """Azimuth over the right, elevation upwards, and the world's up stays up in the image."""
    assert Camera(azimuth_deg=90).axes[2] == pytest.approx([1, 0, 0], abs=1e-12)
    assert Camera(elevation_deg=90).axes[2] == pytest.approx([0, 1, 0], abs=1e-12)
    assert Camera(elevation_deg=90).axes[1] == pytest.approx([0, 0, -1], abs=1e-12)
    right, up, back = Camera(azimuth_deg=50, elevation_deg=30).axes
    assert right[1] == pytest.approx(0.0)  # horizontal
    assert up[1] > 0
    assert np.cross(right, up) == pytest.approx(back)


@needs_arrays
@pytest.mark.parametrize("light", LIGHTS, ids=lambda light: light.label)
def test_a_sphere_cannot_tell_a_moved_camera_from_a_turned_world(light: Light) -> None:
    """Turning the world about the camera's axis, and about any other, with its polarisers."""
    for camera, other in (
        (Camera(resolution=16, roll_deg=35), turned(light, -35.0)),
        (
            moved := Camera(resolution=16, azimuth_deg=50, elevation_deg=-30, roll_deg=20),
            rotated(light, moved.axes),
        ),
    ):
        ours = render(scene_of(light, camera=camera), Sampling(samples=128))
        theirs = render(scene_of(other, camera=Camera(resolution=16)), Sampling(samples=128))
        mask = ours.mask & theirs.mask
        assert mask.sum() > 100
        assert ours.normals[mask] == pytest.approx(theirs.normals[mask], abs=1e-5)
        error = np.hypot(ours.standard_error, theirs.standard_error)[mask]
        residual = (ours.stokes - theirs.stokes)[mask] / np.maximum(error, 1e-6)
        # 130 pixels and more of independent noise: 1 ± 0.15 a component.
        assert (np.mean(residual**2, axis=(0, 1)) < 1.6).all()
        mirror = np.array([1, 1, -1])
        wrong = (ours.stokes - theirs.stokes * mirror)[mask] / np.maximum(error, 1e-6)
        assert np.mean(wrong**2) > 5


@needs_arrays
def test_a_roll_turns_s1_and_s2_by_twice_its_angle() -> None:
    """At the middle of a sphere, where the pixel stays: s1 + i s2 turns by −2θ, s0 not at all."""
    light = Distant(incidence_deg=60, polarised=Polariser(angle_deg=30))

    def centre(roll: float) -> np.ndarray:
        camera = Camera(resolution=3, half_width=0.003, roll_deg=roll)
        truth = render(scene_of(light, COPPER, camera), Sampling(samples=256))
        return truth.stokes[1, 1, 0].astype(float)

    still, rolled = centre(0.0), centre(35.0)
    expected = (still[1] + 1j * still[2]) * np.exp(-2j * np.radians(35.0))
    assert rolled[0] == pytest.approx(still[0], rel=1e-3)  # normals across a pixel of 0.002
    assert rolled[1] == pytest.approx(expected.real, abs=1e-3 * still[0])
    assert rolled[2] == pytest.approx(expected.imag, abs=1e-3 * still[0])
    assert abs(expected) > 0.05 * still[0]


@needs_arrays
@pytest.mark.parametrize("light", [LIGHTS[0], LIGHTS[2]], ids=lambda light: light.label)
@pytest.mark.parametrize(("azimuth", "elevation"), [(40.0, 0.0), (0.0, 35.0)])
def test_moving_the_camera_is_turning_object_and_light(
    light: Light, azimuth: float, elevation: float
) -> None:
    """A box beside a ball: what a camera sees that moved, one sees that stayed and they turned."""
    camera = Camera(
        resolution=24, half_width=2.0, azimuth_deg=azimuth, elevation_deg=elevation, roll_deg=0.0
    )
    box = Placed(shape=Superquadric(e1=0.4, e2=0.4), surface=COPPER, position=(1.2, 0.3, 0.4))
    turned_box = box.model_copy(
        update={
            "position": tuple(map(float, camera.axes @ box.position)),
            "turn_deg": -azimuth,
            "tilt_deg": elevation,
        }
    )
    stayed = Camera(resolution=24, half_width=2.0)
    pairs = (
        (light, camera, box),
        (rotated(light, camera.axes), stayed, turned_box),
    )
    sampling = Sampling(samples=64, max_depth=3)
    ours, theirs = (
        render(
            scene_of(lamp, PAINT, at, surroundings=Surroundings(name="box", objects=(beside,))),
            sampling,
        )
        for lamp, at, beside in pairs
    )
    mask = ours.mask & theirs.mask
    assert mask.sum() > 60
    assert (ours.mask != theirs.mask).sum() <= 2  # corners that float32 decides
    assert np.median(np.abs(ours.normals - theirs.normals)[mask]) < 0.01
    for name in ("specular", "diffuse"):
        difference = (getattr(ours, name) - getattr(theirs, name))[mask]
        draws = [getattr(truth, f"{name}_noise")[mask] for truth in (ours, theirs)]
        # Sums over independent pixels, five deviations, as in test_room.
        bound = 5 * np.sqrt(np.square(draws).sum(axis=(0, 1))) + 1e-5
        assert (np.abs(difference.sum(axis=0)) < bound).all()


@needs_arrays
@pytest.mark.parametrize(
    ("light", "method"),
    [
        (Distant(incidence_deg=60), "half_vector+body"),
        (Environment(heading_deg=30), "lights+body"),
        (Area(incidence_deg=45), "lights+body"),
        (Sky(), "lights+body"),
    ],
    ids=lambda value: getattr(value, "kind", value),
)
def test_the_right_physics_reaches_full_skill_from_a_moved_camera(
    light: Light, method: str
) -> None:
    """Methods are told lights, normals and view in the image frame, and nothing of the world."""
    turns = {"azimuth_deg": 40.0, "elevation_deg": 25.0, "roll_deg": -20.0}
    camera = Camera.model_validate({"resolution": 32} | WIDE | turns)
    truth = render(scene_of(light, camera=camera), Sampling(samples=64))
    # As in test_cameras: 64 samples and the light's quadrature leave a hundredth.
    assert score(truth, method).skill == pytest.approx(1.0, abs=0.01)
    unmoved = truth.scene.model_copy(update={"camera": Camera(resolution=32)})
    assert unmoved.light_in_image != truth.scene.light_in_image


def test_a_scene_is_stored_with_its_camera(tmp_path: Path) -> None:
    camera = Camera(resolution=8, azimuth_deg=30, elevation_deg=10)
    scene = scene_of(Distant(incidence_deg=30), CHALK, camera)
    truth = render(scene, renderer="torrance-sparrow")
    folder = tmp_path / scene.id
    write_scene(folder, truth)
    record, _ = read_record(folder)
    assert record.camera is not None
    assert np.array_equal(record.camera.intrinsics, camera.intrinsics())
    assert np.array_equal(record.camera.extrinsics, camera.extrinsics())
    # A record from before it was kept.
    lines = (folder / SCENE).read_text(encoding="utf-8")
    content = json.loads(lines)
    del content["camera"]
    (folder / SCENE).write_text(json.dumps(content), encoding="utf-8")
    assert np.array_equal(read_scene(folder).stokes, truth.stokes)
