"""The chains from one picture through a perspective camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from malus.bench.scoring.observe import observe
from malus.reconstruct import ChainResult, Observation, run_chain, run_paper
from malus.renderers import render
from malus.renderers.truth import Truth
from malus.scenes import Blob, Camera, Dielectric, Distant, Scene, Sphere
from malus.scenes.polarisation import image_frame, viewing_frame

VIEW = np.array([0.36, -0.48, 0.8])


def test_image_frame_is_the_inverse_of_viewing_frame() -> None:
    rng = np.random.default_rng(4)
    views, vectors = rng.normal(size=(2, 200, 3))
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    # A division by the distance from the y axis, 0.03 here at least, costs two digits of sixteen.
    back = image_frame(viewing_frame(vectors, views), views)
    np.testing.assert_allclose(back, vectors, atol=1e-13)


def turned(told: Observation) -> Observation:
    """The same as a camera on `VIEW` tells it, whose rays are parallel: nothing is to be seen."""
    picture: dict[str, Any] = {
        "view_direction": np.broadcast_to(VIEW, (*told.mask.shape, 3)).copy(),
    }
    if told.normals is not None:
        picture["normals"] = image_frame(told.normals, VIEW)
    if isinstance(told.light, Distant):
        direction = image_frame(np.array(told.light.direction), VIEW)
        picture["light"] = Distant.towards(direction, told.light.irradiance)
    return replace(told, **picture)


@pytest.mark.parametrize("chain", [run_chain, run_paper])
@pytest.mark.parametrize("names", ["light", "normals", "light normals", "illuminant"])
def test_what_a_camera_sees_does_not_depend_on_how_it_is_turned(
    chain: Callable[[Observation], ChainResult], names: str
) -> None:
    scene = Scene(
        shape=Sphere(),
        surface=Dielectric(eta=1.5, alpha=0.25, body="unpolarised"),
        light=Distant(incidence_deg=60, azimuth_deg=25),
        camera=Camera(resolution=24),
    )
    told = observe(render(scene, renderer="torrance-sparrow"), frozenset(names.split()))
    upright, other = chain(told), chain(turned(told))
    # Searches end within 1e-3 of the cost; where they begin with other roundings, so far apart.
    atol = 1e-3 * float(np.abs(upright.components.s1).max())
    for name in ("s1", "s2"):
        own, seen = getattr(upright.components, name), getattr(other.components, name)
        np.testing.assert_allclose(seen, own, atol=atol)
    assert upright.observation.light is not None
    assert isinstance(other.observation.light, Distant)
    light = viewing_frame(np.array(other.observation.light.direction), VIEW)
    np.testing.assert_allclose(light, upright.observation.light.direction, atol=1e-3)
    normals = viewing_frame(other.observation.normals, VIEW)
    np.testing.assert_allclose(normals, upright.observation.normals, atol=1e-3)


def perspective(shape: Sphere | Blob, body: str, incidence_deg: float, side: int = 48) -> Truth:
    return render(
        Scene(
            shape=shape,
            surface=Dielectric(eta=1.5, alpha=0.3, body=body),
            light=Distant(incidence_deg=incidence_deg, azimuth_deg=20),
            camera=Camera(resolution=side, projection="perspective", fov_deg=50, distance=3),
        )
    )


@pytest.mark.parametrize("incidence_deg", [60, 80])
@pytest.mark.parametrize("body", ["unpolarised", "polarised"])
def test_index_and_roughness_of_a_render_come_back(body: str, incidence_deg: float) -> None:
    """Lines of sight 17° apart from the axis: as one, they gave 1.54 and 0.27 at 80°."""
    truth = perspective(Sphere(), body, incidence_deg)
    found = run_chain(observe(truth, frozenset({"light", "normals"})))
    assert found.body == body
    # The error is that of pixels at the highlight's edge, where a normal is a mean over the pixel.
    np.testing.assert_allclose(found.observation.eta, 1.5, atol=0.01)
    assert found.observation.alpha == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize("shape", [Sphere(), Blob(seed=1)])
def test_a_known_light_does_no_harm(shape: Sphere | Blob) -> None:
    """With it comes the line of sight of each pixel, to which the outline's normals are across."""
    truth = perspective(shape, "polarised", 60, side=32)
    true = truth.stokes[truth.mask, :, 1:]

    def error(names: set[str]) -> float:
        estimate = run_chain(observe(truth, frozenset(names))).components.stokes
        return float(np.mean(np.square(estimate[truth.mask, :, 1:] - true)))

    # Normals that were taken for those of an orthographic camera lost half of the polarisation.
    assert error({"light"}) < min(error(set()), 0.25 * float(np.mean(np.square(true))))
