"""Light that bounces on one object, and its fourth Stokes component: plain Mitsuba, and laws."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from plain import (
    GOLD,
    LAMP,
    MIRROR,
    RING,
    by_mitsuba,
    compare,
    flat,
    own_shape,
    returns_no_more,
    scene_of,
)
from rooms import needs_arrays

from malus.bench.scoring.extra_metrics import polarisation_error
from malus.renderers import Truth, render
from malus.renderers.datasets.scene_folder import read_scene, write_scene
from malus.renderers.datasets.spectral_exr import read_spectral
from malus.renderers.families import bounced
from malus.renderers.families.family import render_family
from malus.renderers.families.interpolated import Family
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Camera,
    Conductor,
    Dielectric,
    InputError,
    MeshFile,
    Patterned,
    Sampling,
    Scene,
    Stripes,
    Torus,
    Uniform,
)
from malus.scenes.materials.surface import Surface


@needs_arrays
@pytest.mark.parametrize(
    "surface",
    [
        Dielectric(eta=1.5, alpha=0.3, albedo=0.9),
        Dielectric(eta=1.8, alpha=0.1, albedo=0.9, distribution="ggx"),
        Conductor(**GOLD, alpha=0.3),
        Conductor(**GOLD, alpha=0.2, distribution="ggx"),
    ],
)
def test_light_that_bounces_is_that_of_mitsuba(surface: Surface) -> None:
    """All four components where the object is of metal; of a dielectric s3 is zero."""
    scene, sampling = scene_of(surface, LAMP, RING, 24), Sampling(samples=256, max_depth=4)
    truth, theirs = render(scene, sampling), by_mitsuba(scene, sampling, own_shape(scene), 8)
    assert (truth.s3 is not None) == isinstance(surface, Conductor)
    compare(truth, theirs)
    if truth.s3 is None:
        assert not theirs[..., 3].any()
    else:
        assert np.abs(truth.s3)[truth.mask].max() > 5 * truth.s3_standard_error[truth.mask].mean()
    once = render(scene, Sampling(samples=256))
    assert truth.image.sum() > 1.005 * once.image.sum()


@needs_arrays
def test_families_that_bounce_are_interpolated() -> None:
    """Nodes in η for each albedo give what renders at the indices themselves give."""
    sampling = Sampling(samples=16, max_depth=4)
    bands = (450.0, 650.0)
    scenes = [
        scene_of(Dielectric(eta=eta, alpha=0.2, albedo="red"), LAMP, RING).model_copy(
            update={"wavelengths_nm": bands}
        )
        for eta in np.linspace(1.33, 1.7, 12).tolist()
    ]
    family = render_family(scenes, sampling)
    assert isinstance(family, Family)
    assert len(family.nodes.rendered) < len(scenes) * len(bands)
    assert 0 < family.interpolation_error["rms"] < 1e-5
    for scene in (scenes[0], scenes[7]):
        alone = render_family([scene], sampling).truth(scene)
        truth = family.truth(scene)
        difference = (truth.stokes - alone.stokes).astype(float)
        # The documented error of the interpolation, over the peak.
        assert np.sqrt(np.mean(difference**2)) < 1e-5 * alone.image.max()
        np.testing.assert_array_equal(truth.mask, alone.mask)
        np.testing.assert_allclose(truth.normals, alone.normals, atol=1e-6)


@needs_arrays
@pytest.mark.parametrize("depth", [2, 4])
@pytest.mark.parametrize("radiance", [2.0, 200.0])
def test_the_error_of_interpolation_is_that_of_the_held_out_render(
    depth: int, radiance: float
) -> None:
    """Over the peak of its lobe, whatever the light's strength: the worst of all bands and lobes.

    Three nodes, so that what interpolation leaves is far above rounding; the least index, where it
    leaves most, is held out.
    """
    sampling, bands = Sampling(samples=4, max_depth=depth), (450.0, 650.0)
    light = LAMP.model_copy(update={"radiance": radiance})
    scenes = [
        scene_of(Dielectric(eta=eta, alpha=0.2, albedo="red"), light, RING).model_copy(
            update={"wavelengths_nm": bands}
        )
        for eta in (1.33, 1.4, 1.5, 1.6, 1.7)
    ]
    family = render_family(scenes, sampling, nodes=3)
    between, direct = (f.truth(scenes[0]) for f in (family, render_family(scenes[:1], sampling)))
    seen = np.linalg.norm(direct.normals, axis=-1) > 0
    rms, worst = [], []
    for name in ("specular", "diffuse"):
        found, true = (getattr(truth, name)[seen].astype(float) for truth in (between, direct))
        peak = true[..., 0].max(axis=0)
        rms.extend(np.sqrt(np.mean((found - true) ** 2, axis=(0, 2))) / peak)
        worst.extend(np.abs(found - true).max(axis=(0, 2)) / peak)
    assert max(rms) > 2e-5
    # Rounding of single precision is a hundredth of these errors.
    assert family.interpolation_error["rms"] == pytest.approx(max(rms), rel=0.02)
    assert family.interpolation_error["worst"] == pytest.approx(max(worst), rel=0.02)


@needs_arrays
def test_paths_do_not_end_at_random_in_a_deep_hollow(tmp_path: Path) -> None:
    """Where they would, by surfaces, images of one seed would jump from an index to the next."""
    box = trimesh.creation.box((1, 1, 2))
    lid = (box.vertices[box.faces][..., 2] > 0).all(axis=1)
    well = trimesh.Trimesh(box.vertices, box.faces[~lid, ::-1], process=False)
    well.export(tmp_path / "well.ply")
    shape = MeshFile(path=str(tmp_path / "well.ply"), shading="flat")
    camera = Camera(resolution=6, half_width=0.3)
    scenes = [
        Scene(
            shape=shape,
            surface=Dielectric(eta=eta, alpha=0.2, albedo=0.9),
            light=Uniform(),
            camera=camera,
        )
        for eta in np.linspace(1.33, 1.7, 12).tolist()
    ]

    def family(depth: int) -> Family:
        rendered = render_family(scenes, Sampling(samples=16, max_depth=depth))
        assert isinstance(rendered, Family)
        return rendered

    deep, shallow = family(12), family(5)
    light, less = (f.truth(scenes[0]).image.mean() for f in (deep, shallow))
    assert light > 1.05 * less  # of paths that are long enough for an end at random
    # The documented error of the interpolation; with ends at random it is 1e-2.
    assert 0 < deep.interpolation_error["rms"] < 1e-5


@needs_arrays
def test_the_albedo_counts_more_than_once_where_light_bounces() -> None:
    sampling = Sampling(samples=64, max_depth=6)

    def diffuse(albedo: float) -> float:
        paint = Dielectric(eta=1.5, alpha=0.3, albedo=albedo, body="unpolarised")
        return float(render(scene_of(paint, Uniform(), RING), sampling).diffuse.sum())

    assert diffuse(1.0) > 2.03 * diffuse(0.5)


@needs_arrays
def test_patterns_bounce_band_by_band() -> None:
    """A pattern of two equal surfaces is that surface, though other random numbers choose."""
    paint = Dielectric(eta=1.5, alpha=0.3, albedo=0.9)
    striped = Patterned(pattern=Stripes(width=0.2), surfaces=(paint, paint))
    sampling = Sampling(samples=64, max_depth=3)
    one, other = (render(scene_of(s, LAMP, RING), sampling) for s in (paint, striped))
    np.testing.assert_array_equal(one.mask, other.mask)
    difference = (one.image - other.image)[one.mask].sum()
    variance = (one.standard_error**2 + other.standard_error**2)[one.mask][..., 0].sum()
    assert abs(difference) < 5 * np.sqrt(variance)
    np.testing.assert_allclose(other.alpha[other.mask], 0.3)


def test_a_sphere_alone_lights_no_point_of_itself() -> None:
    scene = scene_of(Dielectric(eta=1.5, alpha=0.3), LAMP)
    deep, once = (render(scene, Sampling(samples=4, max_depth=depth)) for depth in (8, 2))
    np.testing.assert_array_equal(deep.stokes, once.stokes)


@needs_arrays
@pytest.mark.parametrize(
    "surface",
    [
        Dielectric(eta=1.5, alpha=0.05, albedo=1.0),
        Dielectric(eta=2.5, alpha=1.0, albedo=1.0, distribution="ggx"),
        Conductor(**MIRROR, alpha=0.05, distribution="ggx"),
        Conductor(**MIRROR, alpha=0.3),
    ],
    ids=lambda surface: f"{surface.kind} {surface.label}",
)
def test_nothing_returns_more_than_it_receives_however_often(surface: Surface) -> None:
    """Radiance 1 from everywhere: the hollow of a ring returns no more of it."""
    returns_no_more(
        render(scene_of(surface, Uniform(), RING, 12), Sampling(samples=64, max_depth=8))
    )


@needs_arrays
def test_s3_shifts_and_averages_with_the_samples() -> None:
    gold = Conductor(**GOLD, alpha=0.3)
    scene = scene_of(gold, LAMP, RING)
    truth = render(scene, Sampling(samples=32, max_depth=3))
    first, second = truth.halves()
    np.testing.assert_allclose(0.5 * (first.s3 + second.s3), truth.s3, atol=1e-7)
    # A target that is not met takes all samples, in several renders.
    adaptive = render(scene, Sampling(samples=64, max_depth=3, target=1e-9))
    assert adaptive.samples == 64
    error = np.hypot(adaptive.s3_standard_error, truth.s3_standard_error)[truth.mask]
    difference = (adaptive.s3 - truth.s3)[truth.mask]
    assert np.sum(difference**2) < 3 * np.sum(error**2)


def test_paths_refuse_what_they_cannot_trace() -> None:
    scene = scene_of(Dielectric(eta=1.5, alpha=0.3), LAMP, Torus())
    deep = Sampling(samples=2, max_depth=3)
    with pytest.raises(InputError, match=r"light that bounces.*leave max_depth out"):
        render_family([scene], deep, choose("scalar"))


@needs_arrays
def test_files_keep_s3_to_the_bit(tmp_path: Path) -> None:
    scene = scene_of(Conductor(**GOLD, alpha=0.3), LAMP, RING)
    truth = render(scene, Sampling(samples=4, max_depth=3))
    write_scene(tmp_path / scene.id, truth)
    read = read_scene(tmp_path / scene.id)
    for name in ("s3", "s3_noise", "s3_standard_error", "specular", "standard_error"):
        np.testing.assert_array_equal(getattr(read, name), getattr(truth, name), name)
    for name, expected in (("stokes", truth.s3), ("specular", truth.s3), ("diffuse", 0 * truth.s3)):
        image = read_spectral(
            tmp_path / scene.id / f"{name}.exr", truth.mask.shape, (550.0,), components=4
        )
        np.testing.assert_array_equal(image[..., 3], expected)


@needs_arrays
def test_s3_is_scored_where_it_is_there() -> None:
    """Nobody estimates it: all of it is error."""
    scene = scene_of(Conductor(**GOLD, alpha=0.3), LAMP, RING)
    deep, once = (render(scene, Sampling(samples=16, max_depth=depth)) for depth in (4, 2))

    def values(truth: Truth) -> dict[str, float]:
        return {
            value.metric: value.value
            for value in polarisation_error(truth)(truth.stokes[truth.mask])
        }

    expected = np.sqrt(np.mean(deep.s3[deep.mask] ** 2)) / deep.image[deep.mask].max()
    assert values(deep)["s3_rmse"] == pytest.approx(float(expected), rel=1e-5)
    assert "s3_rmse" not in values(once)


def test_the_sign_of_s3_is_that_of_the_field() -> None:
    """s3 > 0 where the field turns clockwise for who looks at the light: Born and Wolf's formulas.

    With fields E exp(−iωt) and an index n + ik (Principles of Optics, 14.2), x + iy turns from x to
    y, anticlockwise: its s3 = 2 Im(E_x E_y*) is negative.
    """
    mi, index, angle = mitsuba(choose()), complex(0.3, 3.0), 0.9
    sine, cosine = np.sin(angle), np.cos(angle)
    to_camera, to_light = np.array([sine, 0, cosine]), np.array([-sine, 0, cosine])
    across = np.array([0.0, 1.0, 0.0])
    inside = np.sqrt(index**2 - sine**2)
    r_s = (cosine - inside) / (cosine + inside)
    r_p = (index**2 * cosine - inside) / (index**2 * cosine + inside)

    def basis(direction: np.ndarray) -> np.ndarray:
        x = np.ravel(np.array(mi.mueller.stokes_basis(mi.Vector3f(*direction.tolist()))))
        return np.stack([x, np.cross(direction, x)])

    def stokes(field: np.ndarray, axes: np.ndarray) -> np.ndarray:
        x, y = axes @ field
        power = np.array([abs(x) ** 2 + abs(y) ** 2, abs(x) ** 2 - abs(y) ** 2])
        return np.array([*power, 2 * (x * np.conj(y)).real, 2 * (x * np.conj(y)).imag])

    def mirrored(field: np.ndarray) -> np.ndarray:
        parallel = field @ np.cross(across, -to_light)
        return r_s * (field @ across) * across + r_p * parallel * np.cross(across, to_camera)

    x, y = basis(-to_light)
    metal = {"type": "roughconductor", "eta": flat(index.real), "k": flat(index.imag), "alpha": 0.1}
    hit = dr_hit(mi, to_camera)
    mueller = mi.load_dict(metal).eval(mi.BSDFContext(), hit, mi.Vector3f(*to_light.tolist()))
    arriving, leaving = mi.Vector3f(*(-to_light).tolist()), mi.Vector3f(*to_camera.tolist())
    mueller = hit.to_world_mueller(mueller, arriving, leaving)
    matrix = np.array([[np.ravel(mueller[i, j][0])[0] for j in range(4)] for i in range(4)])
    for field in (x + y, x + 1j * y):
        expected = stokes(mirrored(field.astype(complex)), basis(to_camera))
        found = matrix @ stokes(field, np.stack([x, y]))
        np.testing.assert_allclose(found / found[0], expected / expected[0], atol=1e-5)  # 32 bits


def dr_hit(mi: Any, to_camera: np.ndarray) -> Any:
    """A hit on a surface that faces +z, seen from a direction."""
    import drjit as dr

    hit = dr.zeros(mi.SurfaceInteraction3f)
    hit.wi, hit.n = mi.Vector3f(*to_camera.tolist()), mi.Normal3f(0, 0, 1)
    hit.sh_frame = mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0), mi.Vector3f(0, 0, 1))
    return hit


def test_each_pass_of_a_pattern_is_rendered_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether it is enough, and the mean of all passes, ask for the same truth again."""
    rendered = []

    def counted(scene: Scene, sampling: Sampling, _: object) -> SimpleNamespace:
        rendered.append((scene.id, sampling.samples))
        return SimpleNamespace(scene=scene)

    monkeypatch.setattr(bounced, "render_room", counted)
    family = bounced.OneByOne(Sampling(samples=4), choose())
    scene = scene_of(Dielectric(eta=1.5, alpha=0.3), LAMP, RING, 8)
    for _ in range(3):
        assert family.truth(scene).scene == scene
    assert rendered == [(scene.id, 4)]


def test_threads_get_the_truths_that_they_ask_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another thread may keep the truth of its scene at any moment."""
    first, other = (scene_of(Dielectric(eta=eta, alpha=0.3), LAMP, RING, 8) for eta in (1.4, 1.5))

    class KeptByAnother(list[Any]):
        def __setitem__(self, *_: object) -> None:
            super().__setitem__(slice(None), [SimpleNamespace(scene=other)])

    monkeypatch.setattr(bounced, "render_room", lambda scene, *_: SimpleNamespace(scene=scene))
    family = bounced.OneByOne(Sampling(samples=4), choose(), KeptByAnother())
    assert family.truth(first).scene == first
    assert family.truth(first).scene == first
