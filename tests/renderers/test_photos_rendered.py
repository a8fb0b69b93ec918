"""What the suite `photos` is made of, as rendered: noise, whole frames, shared kernels."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rooms import needs_arrays

from malus.renderers import render
from malus.renderers.mitsuba.patterns import surface_number
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Blob,
    Camera,
    Dielectric,
    Distant,
    Interior,
    Light,
    Noise,
    Patterned,
    Placed,
    Plane,
    Sampling,
    Scene,
    Sky,
    SkyPolarisation,
    Sphere,
    Surroundings,
    load_suite,
)

pytestmark = needs_arrays

DULL = Dielectric(eta=1.4, alpha=0.4, albedo=0.3)
GLOSSY = Dielectric(eta=1.6, alpha=0.1, albedo=(0.1, 0.5, 0.7))
BANDS = (450.0, 550.0, 650.0)


@pytest.fixture
def mi() -> ModuleType:
    return mitsuba(choose())


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("grain", ["none", "x"])
def test_noise_is_the_quantile_of_a_sum_of_waves(mi: ModuleType, soft: bool, grain: Any) -> None:
    pattern = Noise(seed=5, size=0.4, grain=grain, soft=soft)
    points = np.random.default_rng(1).uniform(-1, 1, (2000, 3))
    found = surface_number(mi, pattern, 3)(SimpleNamespace(p=mi.Point3f(points.T)))
    field = np.zeros(len(points))
    for *wave, phase, amplitude in pattern.waves():
        field += amplitude * np.sin(points @ wave + phase)
    share = np.array([0.5 + 0.5 * math.erf(value / math.sqrt(2)) for value in field])
    expected = 2 * share if soft else np.clip(np.floor(3 * share), 0, 2)
    # float32 is off by 1e-5 at phases of up to 100; at edges that decides, for few of the points.
    off = np.abs(np.asarray(found) - expected) > 1e-4
    assert off.mean() < 1e-3


def test_parts_of_noise_are_of_equal_area(mi: ModuleType) -> None:
    points = np.random.default_rng(2).uniform(-10, 10, (40_000, 3))
    for seed in range(3):
        pattern = Noise(seed=seed, size=0.3)
        found = surface_number(mi, pattern, 2)(SimpleNamespace(p=mi.Point3f(points.T)))
        # The field is symmetric: half each, within four standard errors of 40,000 points, which
        # lie in far more patches.
        assert np.asarray(found).mean() == pytest.approx(0.5, abs=0.01)


def test_three_parts_of_noise_are_of_nearly_equal_area(mi: ModuleType) -> None:
    points = np.random.default_rng(2).uniform(-10, 10, (40_000, 3))
    hit = SimpleNamespace(p=mi.Point3f(points.T))
    for seed in range(3):
        found = np.asarray(surface_number(mi, Noise(seed=seed, size=0.3), 3)(hit))
        # A sum of seven waves is nearly normal: by 0.01 too few of the middle part, besides noise.
        assert np.bincount(found.astype(int)) / len(found) == pytest.approx(1 / 3, abs=0.02)


def test_waves_are_as_long_as_the_size_to_a_third_of_it() -> None:
    waves = Noise(seed=3, size=0.4).waves()
    lengths = 2 * math.pi / np.linalg.norm(waves[:, :3], axis=1)
    assert lengths.max() == pytest.approx(0.4)
    assert lengths.min() == pytest.approx(0.4 / 2**1.5)
    np.testing.assert_allclose(waves[:, 4] / waves[:, 4].max(), lengths / 0.4)
    assert (waves[:, 4] ** 2).sum() / 2 == pytest.approx(1)
    assert not np.array_equal(waves, Noise(seed=4, size=0.4).waves())


def test_waves_are_longer_along_the_grain() -> None:
    plain, grained = Noise(seed=1).waves(), Noise(seed=1, grain="z").waves()
    np.testing.assert_allclose(grained[:, 2] * 6, plain[:, 2])
    np.testing.assert_array_equal(grained[:, :2], plain[:, :2])


def test_noise_is_the_same_on_one_object_and_among_others() -> None:
    surface = Patterned(pattern=Noise(seed=2, size=0.6), surfaces=(DULL, GLOSSY))
    alone = Scene(
        shape=Sphere(),
        surface=surface,
        light=Interior(seed=1),
        camera=Camera(resolution=16),
        wavelengths_nm=BANDS,
    )
    far = Placed(shape=Sphere(), surface=DULL, position=(0, 0, -500))
    beside = alone.model_copy(update={"surroundings": Surroundings(name="far", objects=(far,))})
    one, other = (render(scene, Sampling(samples=16)) for scene in (alone, beside))
    mask = one.mask & other.mask
    np.testing.assert_allclose(one.eta[mask], other.eta[mask], rtol=1e-6)
    assert len(np.unique(one.eta[mask])) > 2  # both surfaces, and pixels of both


def test_the_frame_of_a_corner_is_full() -> None:
    suite = load_suite("photos")
    assert suite.draws is not None
    drawn = (suite.draws.scene(index) for index in range(60))
    corners = [s for s in drawn if s.surroundings and s.surroundings.name == "corner"]
    scene = corners[0]
    camera = scene.camera.model_copy(update={"resolution": 24})
    truth = render(scene.model_copy(update={"camera": camera}), Sampling(samples=8))
    assert (truth.image.min(axis=-1) >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(truth.normals, axis=-1), 1, atol=1e-5)
    # All but the pixels in which two objects meet: outlines of 8 objects in 24² pixels.
    assert truth.mask.mean() > 0.7


@pytest.fixture
def kernels() -> Iterator[Any]:
    import drjit as dr

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        yield dr.kernel_history
    dr.kernel_history_clear()


@pytest.mark.parametrize(
    "light_of",
    [
        lambda order: Interior(seed=order),
        lambda order: Sky(sun_elevation_deg=30 + 9 * order, turbidity=3 + order),
        lambda order: Distant(incidence_deg=30 + 9 * order, irradiance=1 + order),
    ],
    ids=["interior", "sky and sun", "distant"],
)
def test_rooms_of_one_structure_share_a_kernel(
    kernels: Any, light_of: Callable[[int], Light]
) -> None:
    """Other shapes, places, numbers and order of objects, roughness, noise, camera and light."""

    def scene(order: int, *extra: Placed, **camera: float) -> Scene:
        marble = Patterned(pattern=Noise(seed=order, size=0.1 + order), surfaces=(DULL, GLOSSY))
        clear = Dielectric(eta=1.3 + 0.1 * order, alpha=0.1 + 0.1 * order, albedo=0.2)
        floor = Placed(shape=Plane(), surface=clear, position=(0, -1, 0), scale=9 + order)
        thing = Placed(
            shape=Plane() if order else Blob(),
            surface=marble,
            position=(2, order, 0),
            scale=0.5 + 0.1 * order,
            turn_deg=10 + 30 * order,
        )
        return Scene(
            shape=Blob(seed=3 + order),
            surface=clear,
            light=light_of(order),
            camera=Camera(resolution=8, projection="perspective", **camera),
            wavelengths_nm=BANDS,
            surroundings=Surroundings(
                name="room", objects=(floor, thing, *extra)[:: 1 - 2 * order]
            ),
        )

    def new() -> int:
        """Kernels of paths, not small ones, compiled or read from the disk since the last call."""
        jit = [kernel for kernel in kernels() if kernel.get("operation_count", 0) > 1000]
        return sum(not kernel["cache_hit"] or kernel["cache_disk"] for kernel in jit)

    render(scene(0, fov_deg=40, distance=4), Sampling(samples=2))
    assert new() > 0
    fourth = Placed(shape=Blob(), surface=DULL, position=(-3, 0, 1), scale=0.5)
    render(scene(1, fourth, fov_deg=50, distance=5, elevation_deg=20), Sampling(samples=4, seed=2))
    assert new() == 0


def test_what_an_earlier_room_leaves_makes_no_new_kernel(kernels: Any) -> None:
    """Dr.Jit counts all emitters of a process, those of garbage too."""
    sky = Sky(sun_elevation_deg=40, polarised=SkyPolarisation())

    def paths_of(light: Light) -> set[str]:
        kernels()  # forget what was before
        ball = Placed(shape=Sphere(), surface=DULL, position=(2.5, 0, 0))
        scene = Scene(
            shape=Sphere(),
            surface=DULL,
            light=light,
            camera=Camera(resolution=8),
            surroundings=Surroundings(name="two", objects=(ball,)),
        )
        render(scene, Sampling(samples=2))
        return {str(k["hash"]) for k in kernels() if k.get("operation_count", 0) > 1000}

    gc.collect()
    gc.disable()
    try:
        first = paths_of(Interior(seed=1))
        assert first
        paths_of(sky)
        assert paths_of(Interior(seed=1)) == first
    finally:
        gc.enable()
