"""How far the normals in a pixel differ: against normals counted one by one, in every renderer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up import made_up_truth
from rooms import needs_arrays

from malus.renderers import Truth, render
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.families.family import render_family
from malus.renderers.variant import SCALAR, Variant, choose
from malus.scenes import (
    Camera,
    Dielectric,
    Distant,
    MeshFile,
    Patterned,
    Placed,
    Plane,
    Sampling,
    Scene,
    Shape,
    Sphere,
    Stripes,
    Surroundings,
    Uniform,
)
from malus.scenes.core.arrays import Float64Array

SURFACE = Dielectric(eta=1.5, alpha=0.3)
SIDE = 12
VARIANTS = [choose(), *([Variant(SCALAR, "compared")] if choose().name != SCALAR else [])]


def scene_of(
    shape: Shape, surface: Dielectric | Patterned = SURFACE, resolution: int = SIDE
) -> Scene:
    camera = Camera(resolution=resolution)
    return Scene(shape=shape, surface=surface, light=Uniform(), camera=camera)


def roof(folder: Path) -> MeshFile:
    """Two squares that meet at a right angle, the ridge upright and towards the viewer."""
    corners = "v -1 -1 0\nv -1 1 0\nv 0 -1 1\nv 0 1 1\nv 1 -1 0\nv 1 1 0\n"
    path = folder / "roof.obj"
    path.write_text(corners + "f 1 3 4\nf 1 4 2\nf 3 5 6\nf 3 6 4\n")
    return MeshFile(path=str(path))


def counted(camera: Camera, each: int = 40) -> Float64Array:
    """Root mean square angle in degrees between the sphere's normals in a pixel and their mean."""
    side, step = camera.resolution, 2 * camera.half_width / camera.resolution
    inner = (np.arange(side * each) + 0.5) * step / each - camera.half_width
    x, y = np.meshgrid(inner, -inner)
    z = np.sqrt(np.clip(1 - x**2 - y**2, 0, None))
    normals = np.stack([x, y, z], axis=-1).reshape(side, each, side, each, 3)
    mean = normals.mean(axis=(1, 3), keepdims=True)
    mean /= np.linalg.norm(mean, axis=-1, keepdims=True)
    angles = np.arccos(np.clip((normals * mean).sum(axis=-1), -1, 1))
    return np.degrees(np.sqrt((angles**2).mean(axis=(1, 3))))


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_of_a_sphere_it_is_the_mean_angle_from_the_mean_normal(variant: Variant) -> None:
    scene = scene_of(Sphere())
    truth = render_family([scene], Sampling(samples=256), variant).truth(scene)
    wanted = counted(scene.camera)[truth.mask]
    assert truth.normal_spread is not None
    # 256 random points of a pixel instead of all: 1/√(2·256) is 4 % of a root mean square; the
    # worst of a hundred pixels is three times that.
    np.testing.assert_allclose(truth.normal_spread[truth.mask], wanted, rtol=0.15)
    assert np.mean(truth.normal_spread[truth.mask] / wanted) == pytest.approx(1, abs=0.02)
    assert wanted.max() > 5  # the rim of so coarse a sphere


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_at_an_edge_it_is_half_the_angle_of_the_faces(tmp_path: Path, variant: Variant) -> None:
    """An odd number of pixels has the ridge in the middle of one column."""
    scene = scene_of(roof(tmp_path), resolution=SIDE + 1)
    truth = render_family([scene], Sampling(samples=256), variant).truth(scene)
    spread = truth.normal_spread
    assert spread is not None
    inside = truth.mask
    ridge = inside & (np.arange(SIDE + 1) == SIDE // 2)
    assert ridge.sum() > 5
    # The share of a face is 1/2 + d, where d is 0.031 in 256 samples. The mean's square is then
    # 1/2 + 2 d²: at three times 0.031, a spread of 44.0°.
    np.testing.assert_allclose(spread[ridge], 45, atol=1.0)
    # A face is flat: nothing but rounding, 256 additions of 32-bit floats.
    assert spread[inside & ~ridge].max() < 0.2


def test_a_pattern_does_not_bend_a_surface() -> None:
    if not choose().vectorised:
        pytest.skip("patterns need LLVM or CUDA")
    several = Patterned(pattern=Stripes(), surfaces=(SURFACE, Dielectric(eta=1.7, alpha=0.1)))
    plain, patterned = scene_of(Sphere()), scene_of(Sphere(), several)
    spreads = [
        render_family([scene], Sampling(samples=16)).truth(scene).normal_spread
        for scene in (plain, patterned)
    ]
    np.testing.assert_array_equal(*spreads)


@needs_arrays
def test_among_objects_each_pixel_has_its_own() -> None:
    floor = Placed(shape=Plane(), surface=SURFACE, position=(0, -1, 0), tilt_deg=30, scale=20)
    around = Surroundings(name="floor", objects=(floor,))
    alone = scene_of(Sphere())
    among = Scene(**dict(alone) | {"surroundings": around})
    one, other = (
        render_family([scene], Sampling(samples=64)).truth(scene) for scene in (alone, among)
    )
    assert one.normal_spread is not None
    assert other.normal_spread is not None
    # The sphere's pixels have the same rays; the others see the floor, which is flat.
    np.testing.assert_allclose(other.normal_spread[one.mask], one.normal_spread[one.mask], atol=0.1)
    flat = other.mask & ~one.mask & (np.abs(other.normals[..., 1] - np.cos(np.pi / 6)) < 1e-3)
    assert flat.any()
    assert other.normal_spread[flat].max() < 0.2  # rounding


def test_several_passes_are_as_one() -> None:
    scene = scene_of(Sphere())
    found = render_family([scene], Sampling(samples=256, seed=3, target=1e-9)).truth(scene)
    assert found.samples == 256
    assert found.normal_spread is not None
    wanted = counted(scene.camera)[found.mask]
    np.testing.assert_allclose(found.normal_spread[found.mask], wanted, rtol=0.15)  # as above


def test_formulas_know_one_normal_a_pixel() -> None:
    surface = SURFACE.model_copy(update={"body": "unpolarised"})
    scene = scene_of(Sphere(), surface).model_copy(update={"light": Distant(incidence_deg=60)})
    assert not np.any(render(scene, renderer="torrance-sparrow").normal_spread)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, None])
def test_datasets_keep_it(tmp_path: Path, dtype: type | None) -> None:
    truth = made_up_truth()
    if dtype is not None:
        random = np.random.default_rng(5).random(truth.mask.shape)
        truth = replace(truth, normal_spread=random.astype(dtype))
    with DatasetWriter(tmp_path) as writer:
        writer.add(truth)
    found: Truth = open_folder(tmp_path).truth(truth.scene.id)
    if dtype is None:
        assert found.normal_spread is None  # as in datasets of earlier versions
    else:
        assert found.normal_spread is not None
        assert found.normal_spread.tobytes() == np.asarray(truth.normal_spread).tobytes()
