"""A lamp at the camera: Mitsuba's plane of incidence has no direction there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rooms import needs_arrays

from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.lighting import NEAR, beside, sampler
from malus.renderers.variant import choose, mitsuba
from malus.scenes import Camera, Dielectric, Distant, Sampling, Scene, Torus, Uniform

SLANTED = np.array([-1.06e-12, 1.87e-4, 1.0])
"""Towards a lamp and the camera as a facet that nearly faces them sees it: one sample in three to
six million of a sphere comes near it, and all of its pixel was lost."""
BSDFS = [
    {"type": "pplastic", "alpha": 0.2},
    {"type": "roughconductor", "material": "Au", "alpha": 0.3},
]


def facing(mi: Any, direction: np.ndarray) -> Any:
    """A hit that the camera sees from a local direction, which is a direction of the world, too."""
    import drjit as dr

    hit = dr.zeros(mi.SurfaceInteraction3f)
    hit.wi = dr.normalize(mi.Vector3f(*map(float, direction)))
    hit.sh_frame = mi.Frame3f(mi.Vector3f(0, 0, 1))
    return hit


@needs_arrays
@pytest.mark.parametrize("bsdf", BSDFS, ids=lambda bsdf: bsdf["type"])
def test_its_light_is_a_number(bsdf: dict[str, Any]) -> None:
    mi = mitsuba(choose("llvm"))
    hit = facing(mi, SLANTED)
    plain = mi.load_dict(bsdf)
    ((toward, _, _),) = sampler(mi, Distant.towards(SLANTED), None)(hit, plain, None, True)
    assert np.isnan(np.array(plain.eval(mi.BSDFContext(), hit, hit.wi))).any(), "see traps.md"
    mueller = np.array(plain.eval(mi.BSDFContext(), hit, toward)).reshape(4, 4)
    # Unpolarised light stays so: a facet reflects both directions alike, to single precision.
    np.testing.assert_allclose(mueller[1:, 0], 0.0, atol=1e-6 * mueller[0, 0])
    assert mueller[0, 0] > 0


@needs_arrays
@pytest.mark.parametrize(("angle", "turned"), [(0.0, NEAR), (0.9 * NEAR, NEAR), (1.1 * NEAR, 0.0)])
def test_only_a_lamp_at_the_camera_is_turned(angle: float, turned: float) -> None:
    """Single precision has directions to 1e-7, a thousandth of what they are turned by."""
    mi = mitsuba(choose("llvm"))
    lamp = np.array([0.6, np.sin(angle), 0.8])
    hit = facing(mi, np.array([0.6, 0.0, 0.8]))
    light = Distant.towards(lamp)
    ((toward, _, _),) = sampler(mi, light, None)(hit, None, None, True)
    moved = np.linalg.norm(np.array(toward).ravel() - light.direction)
    assert moved == pytest.approx(turned, abs=2e-7)


@pytest.mark.parametrize("camera", [Camera(), Camera(azimuth_deg=45, elevation_deg=35.2643897)])
def test_mitsubas_own_integrators_have_it_as_far_beside(camera: Camera) -> None:
    to_camera = camera.axes[2]
    at_camera = Distant.towards(to_camera)
    turned = beside(at_camera, to_camera)
    assert isinstance(turned, Distant)
    # An angle in degrees has 16 digits: the cosine of so small a one loses half of them.
    assert np.linalg.norm(turned.direction - to_camera) == pytest.approx(NEAR, rel=1e-6)
    assert turned.irradiance == at_camera.irradiance
    elsewhere = Distant(incidence_deg=1)
    assert beside(elsewhere, Camera().axes[2]) is elsewhere


@pytest.mark.parametrize(
    ("variant", "depth"),
    [
        ("scalar", 2),
        pytest.param("llvm", 2, marks=needs_arrays),
        pytest.param("llvm", 3, marks=needs_arrays),
    ],
)
def test_light_that_is_not_finite_is_an_error(variant: str, depth: int) -> None:
    """Sums beyond single precision, in place of what Mitsuba may return."""
    lamp = Distant(incidence_deg=60).model_copy(update={"irradiance": 3e38})
    surface = Dielectric(eta=1.5, alpha=0.3)
    scene = Scene(shape=Torus(), surface=surface, light=Uniform(), camera=Camera(resolution=8))
    bright = scene.model_copy(update={"light": lamp})
    sampling = Sampling(samples=16, max_depth=depth)
    with pytest.raises(FloatingPointError, match="expected finite light from Mitsuba"):
        render_family([bright], sampling, choose(variant)).truth(bright)
