"""Polarised light among several objects: at the first hit, and by way of other objects."""

from __future__ import annotations

import numpy as np
import pytest
from plain import CHALK, PAINT, POLARISED, by_mitsuba
from rooms import needs_arrays, own_shapes, table

from malus.renderers import render
from malus.scenes import (
    Area,
    Camera,
    Conductor,
    Distant,
    Light,
    Placed,
    Polariser,
    Sampling,
    Scene,
    Sky,
    Sphere,
    Surroundings,
)

GOLD = Conductor(eta=0.2, k=3.0, alpha=0.2)

pytestmark = needs_arrays


def scene_of(light: Light, **more: object) -> Scene:
    content = {"light": light, "surface": PAINT, "camera": Camera(resolution=12)}
    return Scene.model_validate({"shape": Sphere()} | content | more)


def golden_table(light: Light, resolution: int = 16) -> Scene:
    """A ball of plastic among objects of gold, in which light goes to and fro."""
    scene = table(light, "polarised", resolution)
    assert scene.surroundings is not None
    gold = tuple(p.model_copy(update={"surface": GOLD}) for p in scene.surroundings.objects)
    return scene.model_copy(update={"surroundings": Surroundings(name="gold", objects=gold)})


@pytest.mark.parametrize("light", POLARISED, ids=lambda light: light.label)
def test_with_nothing_near_a_room_is_its_object_alone(light: Light) -> None:
    """Polarised light at the first hit in rooms, which have another kernel."""
    far = Placed(shape=Sphere(), surface=CHALK, position=(0, 0, -500))
    around = Surroundings(name="nothing", objects=(far,))
    one = render(scene_of(light), Sampling(samples=256))
    other = render(scene_of(light, surroundings=around), Sampling(samples=256, max_depth=3))
    mask = one.mask & (other.normals[..., 2] > 0.2)
    for lobe in ("specular", "diffuse"):
        a, b = (getattr(truth, lobe)[mask] for truth in (one, other))
        draws = [getattr(truth, f"{lobe}_noise")[mask] for truth in (one, other)]
        # As in test_room: five deviations of sums over independent pixels.
        bound = 5 * np.sqrt(np.square(draws).sum(axis=(0, 1))) + 1e-4 * np.abs(a).sum(axis=0)
        assert (np.abs((a - b).sum(axis=0)) <= bound).all()


def test_light_by_way_of_other_objects_is_what_mitsuba_renders() -> None:
    """Gold keeps and turns most of how light oscillates: it matters that the lamp is polarised."""
    lamp = Area(incidence_deg=50, azimuth_deg=60, half_angle_deg=40)
    scene = golden_table(lamp.model_copy(update={"polarised": Polariser(angle_deg=30)}))
    sampling, runs = Sampling(samples=512, max_depth=4), 8
    truth = render(scene, sampling)
    mask = truth.mask
    many = Sampling(samples=2048, max_depth=4)
    theirs = by_mitsuba(scene, many, own_shapes(scene), runs)[:, mask, :3]
    ours, error = truth.stokes[:, :, 0][mask], truth.standard_error[:, :, 0][mask]
    variance = error**2 + theirs.var(axis=0, ddof=1) / runs
    misfit = np.square(ours - theirs.mean(axis=0)).sum(axis=0) / variance.sum(axis=0)
    # Sums over 150 pixels, some of which have most of the noise: 1 ± 0.3.
    assert (misfit < 2.0).all()
    direct = render(scene, Sampling(samples=128, max_depth=2)).stokes
    plain = golden_table(lamp)
    indirect = [render(plain, Sampling(samples=128, max_depth=d)).stokes for d in (4, 2)]
    # As if what comes by another object came from an unpolarised lamp.
    without = (direct + indirect[0] - indirect[1])[:, :, 0][mask]
    wrong = np.square(without - theirs.mean(axis=0)).sum(axis=0) / variance.sum(axis=0)
    assert (wrong[1:] > 10).all()


@pytest.mark.parametrize("light", [POLARISED[0], POLARISED[2]], ids=lambda light: light.label)
def test_a_degree_is_a_mixture_by_way_of_other_objects_too(light: Light) -> None:
    """Light of degree p is p of that of degree 1 and the rest unpolarised, along every path."""
    stokes = {}
    for degree in (1e-9, 0.4, 1.0):
        assert isinstance(light, Distant | Area | Sky)
        assert light.polarised is not None
        how = light.polarised.model_copy(update={"degree": degree})
        scene = golden_table(light.model_copy(update={"polarised": how}), resolution=10)
        truth = render(scene, Sampling(samples=16, max_depth=4))
        stokes[degree] = truth.stokes[truth.mask]
    # The same random numbers: float32, and what rounding changes of a path.
    mixture = 0.4 * stokes[1.0] + 0.6 * stokes[1e-9]
    peak = float(mixture.max())
    assert np.quantile(np.abs(stokes[0.4] - mixture), 0.95) < 1e-5 * peak
    assert np.quantile(np.abs(stokes[1.0] - stokes[1e-9]), 0.95) > 1e-2 * peak


def test_a_distant_lamp_is_a_small_one_by_way_of_other_objects() -> None:
    """Both are emitters of their own: a direction, and a cone of them."""
    how, half_angle = Polariser(angle_deg=30), 1.0
    irradiance = 2 * np.pi * (1 - np.cos(np.radians(half_angle))) * 50.0
    where = {"incidence_deg": 50.0, "azimuth_deg": 60.0, "polarised": how}
    far = Distant.model_validate(where | {"irradiance": irradiance})
    near = Area.model_validate(where | {"half_angle_deg": half_angle, "radiance": 50.0})
    sampling = Sampling(samples=256, max_depth=4)
    one, other = (render(golden_table(light), sampling) for light in (far, near))
    mask = one.mask
    error = np.hypot(one.standard_error, other.standard_error)[mask]
    # Sums over an image, five deviations, and a thousandth for a cone's edge in sharp reflections.
    difference = np.abs((one.stokes - other.stokes)[mask].sum(axis=0))
    bound = 5 * np.sqrt(np.square(error).sum(axis=0)) + 1e-3 * one.image[mask].sum()
    assert (difference < bound).all()
    assert (np.abs(one.stokes[mask].sum(axis=0))[:, 1:] > bound[:, 1:]).any()
