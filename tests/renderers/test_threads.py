"""What decides no number: threads; and what no ray meets, which must not end the process."""

from __future__ import annotations

import drjit
import numpy as np
import pytest

from malus.renderers.families.family import render_family
from malus.renderers.variant import choose, use_threads
from malus.scenes import (
    Area,
    Blob,
    Camera,
    Dielectric,
    Distant,
    Environment,
    InputError,
    Sampling,
    Scene,
    Torus,
    Uniform,
)
from malus.scenes.lights.lights import Light


def test_truths_are_the_same_to_the_bit_for_any_number_of_threads() -> None:
    """Narrow lobes have products too small for full precision, which threads treat alike."""
    variant, before = choose(), drjit.thread_count()
    scene = Scene(
        shape=Blob(seed=7),
        surface=Dielectric(eta=1.5, alpha=0.4, albedo=0.5),
        light=Area(incidence_deg=60, half_angle_deg=15),
        camera=Camera(resolution=64),
    )
    found = []
    for threads in (2, 1, 3):
        use_threads(variant, threads)
        found.append(render_family([scene], Sampling(samples=16, seed=1)).truth(scene))
    drjit.set_thread_count(before)
    for name in ("specular", "diffuse", "standard_error", "normals"):
        one, *others = (getattr(truth, name) for truth in found)
        assert all(np.array_equal(one, other) for other in others), name


@pytest.mark.parametrize("backend", ["auto", "scalar"])
@pytest.mark.parametrize(
    "light", [Uniform(), Distant(incidence_deg=20), Environment()], ids=lambda o: o.kind
)
def test_what_no_ray_meets_is_refused_and_ends_no_process(light: Light, backend: str) -> None:
    """The camera looks through the hole of a ring."""
    camera = Camera(resolution=8, projection="perspective", fov_deg=5, distance=10)
    ring = Scene(
        shape=Torus(minor=0.09, tilt_deg=0),
        surface=Dielectric(eta=1.5, alpha=0.3),
        light=light,
        camera=camera,
    )
    with pytest.raises(InputError, match="expected an object that covers a pixel, found none"):
        render_family([ring], Sampling(samples=4), choose(backend))
