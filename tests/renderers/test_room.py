"""Several objects that light each other: against Mitsuba's own integrator, and laws of light."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plain import by_mitsuba
from rooms import needs_arrays, own_shapes, table

from malus.bench import run, score
from malus.bench.datasets.export import export
from malus.bench.datasets.render import render_dataset
from malus.bench.running.plan import plan
from malus.renderers import render
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.translate import LAMP_DISTANCE, emitters
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Area,
    Camera,
    Conductor,
    Dielectric,
    Distant,
    Environment,
    InputError,
    Light,
    Placed,
    Plane,
    Sampling,
    Scene,
    Sky,
    Sphere,
    Suite,
    Superquadric,
    Surroundings,
    Uniform,
    load_suite,
)
from malus.scenes.materials.surface import Surface


@needs_arrays
@pytest.mark.parametrize(
    ("light", "body"),
    [
        (Distant(incidence_deg=60, azimuth_deg=60), "unpolarised"),
        (Area(incidence_deg=60, azimuth_deg=60), "polarised"),
        (Uniform(), "unpolarised"),
        (Environment(), "polarised"),
        (Sky(), "unpolarised"),
    ],
    ids=lambda value: getattr(value, "kind", value),
)
def test_both_lobes_together_are_what_mitsuba_renders(light: Light, body: str) -> None:
    scene, sampling, runs = table(light, body), Sampling(samples=256), 8
    truth = render(scene, sampling)
    theirs = by_mitsuba(scene, sampling, own_shapes(scene), runs)[:, truth.mask, :3]
    ours, error = truth.stokes[:, :, 0][truth.mask], truth.standard_error[:, :, 0][truth.mask]
    difference = ours - theirs.mean(axis=0)
    variance = error**2 + theirs.var(axis=0, ddof=1) / runs
    owner = np.unique(truth.alpha[truth.mask], return_inverse=True)[1]
    assert len(set(owner)) == 4
    for index in range(4):
        own = owner == index
        # Sums over an object's pixels, which are independent: five deviations, once in two
        # million. What is left of float32 sums of 256 samples is far below 1e-6.
        bound = 5 * np.sqrt(variance[own].sum(axis=0)) + 1e-6 * own.sum()
        assert (np.abs(difference[own].sum(axis=0)) < bound).all()
    # The errors explain the pixels too. Sums, not means of ratios: a pixel that light reaches by
    # a rare way only has seldom seen its own variance.
    assert 0.7 < (difference**2).sum() / variance.sum() < 1.4


@pytest.mark.parametrize("reach", [1.0, 40.0, 3000.0])
def test_a_lamp_stands_in_one_direction_from_all_objects(reach: float) -> None:
    """Light between objects starts at a disk of Mitsuba's; direct light is that of a direction."""
    light = Area(incidence_deg=60, azimuth_deg=200)
    place = emitters(mitsuba(choose()), light, LAMP_DISTANCE * reach)["light0"]["to_world"]
    lamp = np.asarray(place.matrix)[:3, 3].astype(float)
    for corner in np.eye(3) * reach:
        seen = lamp - corner
        seen /= np.linalg.norm(seen)
        # At most a thousandth in radians, and float32.
        assert np.linalg.norm(seen - light.direction) < 1.1e-3


def test_the_scalar_variant_refuses_in_one_line() -> None:
    scene = table(Uniform())
    with pytest.raises(InputError, match=r"expected LLVM or CUDA .* found scalar.*; install LLVM"):
        render_family([scene], Sampling(samples=2), choose("scalar"))


NEARLY_AIR = 1.001
"""Index of an interface that mirrors next to nothing: 3e-7 head on."""


@needs_arrays
def test_in_a_white_furnace_nothing_is_seen() -> None:
    """White Lambertian objects under equal light from everywhere are as bright as the light.

    Radiance 1 solves the rendering equation, whatever the shapes: what an object hides from
    another it sends itself. What is missing at depth 2 is what objects send each other.
    """
    white = Dielectric(eta=NEARLY_AIR, alpha=0.3, albedo=1.0, body="unpolarised")
    scene = table(Uniform(), resolution=16)
    objects = [p.model_copy(update={"surface": white}) for p in scene.surroundings.objects]
    around = Surroundings(name="white", objects=tuple(objects))
    scene = scene.model_copy(update={"surface": white, "surroundings": around})
    truth = render(scene, Sampling(samples=128, max_depth=64))
    image = truth.image[truth.mask]
    # Light grazes an interface of any index and is mirrored; that is at most a few thousandths.
    assert image.mean() == pytest.approx(1.0, abs=5e-3)
    assert np.abs(image - 1.0).max() < 5 * truth.standard_error[truth.mask][..., 0].max() + 0.01
    direct = render(scene, Sampling(samples=128, max_depth=2))
    assert direct.image[direct.mask].mean() < 0.97


@needs_arrays
@pytest.mark.parametrize(
    "surface",
    [
        Dielectric(material="water", alpha=0.3, albedo="red", body="polarised"),
        Dielectric(material="water", alpha=0.3, albedo="red", body="unpolarised"),
        Conductor(eta=0.2, k=3.0, alpha=0.3),
    ],
    ids=["polarised", "unpolarised", "conductor"],
)
def test_with_nothing_near_a_scene_is_that_of_its_shape_alone(surface: Surface) -> None:
    far = Placed(shape=Sphere(), surface=surface, position=(0, 0, -500))
    alone = Scene(
        shape=Superquadric(),
        surface=surface,
        light=Area(incidence_deg=45),
        camera=Camera(resolution=16, roll_deg=20),
        wavelengths_nm=(450, 650),
    )
    around = Surroundings(name="nothing", objects=(far,))
    beside = alone.model_copy(update={"surroundings": around})
    one, other = (render(scene, Sampling(samples=256)) for scene in (alone, beside))
    mask = one.mask & (other.alpha == 0.3)
    assert (one.mask[mask] == other.mask[mask]).all()
    # Different random numbers: directions within a pixel, a few degrees at the edges of a box.
    assert np.median(np.abs(one.normals - other.normals)[mask]) < 0.02
    assert other.eta[mask] == pytest.approx(np.broadcast_to(alone.eta, other.eta[mask].shape))
    for lobe in ("specular", "diffuse"):
        difference = (getattr(one, lobe) - getattr(other, lobe))[mask].sum(axis=0)
        draws = [getattr(truth, f"{lobe}_noise")[mask] for truth in (one, other)]
        # Sums over 100 independent pixels, each with one draw of its noise in either truth: their
        # deviation is known to 5 %. Five of them, once in two million.
        assert (np.abs(difference) <= 5 * np.sqrt(np.square(draws).sum(axis=(0, 1)))).all()


def two_mirrors(crossed: bool) -> Scene:
    """Light that comes to the camera by way of two mirrors, at Brewster's angle on both."""
    eta = 1.5
    brewster = np.arctan(eta)
    # The near mirror lies in the camera's view and faces up and back; r is where it looks.
    near = np.pi / 2 - brewster
    r = np.array([0.0, np.sin(2 * near), -np.cos(2 * near)])
    aside = np.array([1.0, 0.0, 0.0]) if crossed else np.cross([1.0, 0.0, 0.0], r)
    normal = -np.cos(brewster) * r + np.sin(brewster) * aside
    toward_light = 2 * np.cos(brewster) * normal + r
    mirror = Dielectric(eta=eta, alpha=0.02, albedo=0.0)
    at = np.array([0.0, 0.0, 8.0])
    return Scene(
        shape=Sphere(),
        surface=mirror,
        light=Distant(
            incidence_deg=np.degrees(np.arccos(toward_light[2])),
            azimuth_deg=np.degrees(np.arctan2(toward_light[1], toward_light[0])),
        ),
        camera=Camera(resolution=8),
        surroundings=Surroundings(
            name="mirrors",
            objects=(
                Placed(
                    shape=Plane(),
                    surface=mirror,
                    position=tuple(at),
                    tilt_deg=np.degrees(near),
                    scale=3,
                ),
                Placed(
                    shape=Plane(),
                    surface=mirror,
                    position=tuple(at + 12 * r),
                    tilt_deg=np.degrees(np.arccos(normal[1])),
                    turn_deg=np.degrees(np.arctan2(normal[0], normal[2])),
                    scale=5,
                ),
            ),
        ),
    )


@needs_arrays
def test_a_second_mirror_sees_the_polarisation_of_the_first() -> None:
    """At Brewster's angle a mirror sends on only what oscillates across its plane of reflection.

    Two with one plane send horizontal light to the camera; two with crossed planes send nothing.
    Without Stokes vectors along the path both would be equally bright.
    """
    parallel, crossed = (render(two_mirrors(c), Sampling(samples=64)) for c in (False, True))
    assert parallel.mask.all()
    s0, s1, s2 = parallel.stokes.mean(axis=(0, 1, 2))
    assert s0 > 0.01
    assert s1 / s0 == pytest.approx(1.0, abs=5e-3)  # facets of slope 0.02 stand about 1° off
    assert s2 / s0 == pytest.approx(0.0, abs=5e-3)
    assert crossed.image.mean() / s0 < 5e-3
    assert np.abs(parallel.diffuse).max() == 0


SUITE = """
name = "shelf"
shapes = [{ kind = "sphere" }, { kind = "blob" }]
materials = [{ eta = 1.5 }, "water"]
surfaces = ["obsidian"]
lights = [{ kind = "distant", incidence_deg = 50 }]
wavelengths_nm = [450, 650]
methods = ["unpolarised", "eq8"]
camera = { resolution = 12, half_width = 2 }
sampling = { samples = 8, max_depth = 3 }

[[surroundings]]
name = "shelf"
[[surroundings.objects]]
shape = { kind = "plane" }
surface = { material = "pmma", alpha = 0.2, body = "unpolarised" }
position = [0, -1, 0]
tilt_deg = 30
scale = 9
[[surroundings.objects]]
shape = { kind = "mesh", path = "wedge.obj" }
surface = { eta = 1.7, alpha = 0.3 }
position = [1.2, 0, 1]
scale = 1.2
turn_deg = 45
"""
WEDGE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def shelf(tmp_path: Path) -> Path:
    (tmp_path / "wedge.obj").write_text(WEDGE, "utf-8")
    path = tmp_path / "shelf.toml"
    path.write_text(SUITE, "utf-8")
    return path


@pytest.fixture
def water_shelf(shelf: Path) -> Suite:
    """Its scenes of water only: a sphere and a blob."""
    suite = load_suite(shelf)
    return suite.model_copy(update={"materials": suite.materials[1:]})


def test_a_suite_with_surroundings(shelf: Path, tmp_path: Path) -> None:
    suite = load_suite(shelf)
    scenes, families = list(suite.scenes()), plan(suite)
    assert len(scenes) == len(families) == 4
    assert {scene.label for scene in scenes} == {"sphere in shelf", "blob in shelf"}
    # Both lobes at every band, with nothing interpolated.
    assert {(f.specular_images, f.diffuse_images, f.traces) for f in families} == {(2, 2, 2)}
    assert Suite.model_validate_json(suite.model_dump_json()) == suite
    before = scenes[0].id
    (tmp_path / "wedge.obj").write_text(WEDGE.replace("v 0 0 1", "v 0 0 2"), "utf-8")
    assert next(load_suite(shelf).scenes()).id != before
    (tmp_path / "wedge.obj").unlink()
    with pytest.raises(InputError, match=r"wedge\.obj"):
        load_suite(shelf)


@needs_arrays
def test_a_dataset_of_rooms_is_gone_on_with_and_comes_back_to_the_bit(
    water_shelf: Suite, tmp_path: Path
) -> None:
    suite = water_shelf
    assert render_dataset(suite, tmp_path / "data")["rendered"] == 2
    assert render_dataset(suite, tmp_path / "data")["rendered"] == 0
    dataset = open_folder(tmp_path / "data")
    scene = next(suite.scenes())
    stored, again = dataset.truth(scene.id), render(scene, suite.sampling)
    assert stored.scene.id == scene.id  # the mesh is read from the dataset
    for name in ("specular", "diffuse", "normals", "mask", "standard_error", "eta", "alpha"):
        assert np.array_equal(getattr(stored, name), getattr(again, name)), name
    assert stored.eta.shape == (12, 12, 2)
    assert set(np.unique(stored.alpha[stored.mask])) == {0.15, 0.2, 0.3}
    assert export(dataset, "numpy", tmp_path / "numpy") == 2
    other = render(scene, suite.sampling.model_copy(update={"seed": 2}))
    assert not np.array_equal(other.specular, again.specular)


@needs_arrays
def test_a_run_of_rooms_scores_and_goes_on(water_shelf: Suite, tmp_path: Path) -> None:
    results = run(water_shelf, tmp_path / "out")
    assert set(results.table["shape"]) == {"sphere in shelf", "blob in shelf"}
    assert results.run["families_failed"] == 0
    assert run(water_shelf, tmp_path / "out").run["families_taken_over"] == 2


@needs_arrays
def test_light_between_objects_is_what_a_method_that_knows_the_light_lacks() -> None:
    """Told of every pixel's index and roughness it is right about direct light, and only that."""
    scene = table(Distant(incidence_deg=60, azimuth_deg=60), resolution=24)
    direct, whole = (
        score(render(scene, Sampling(samples=256, max_depth=depth)), "lights+body").skill
        for depth in (2, 5)
    )
    # What is left: the mean of a pixel against one viewing direction and normal for it.
    assert direct > 0.999
    assert whole < 0.99
