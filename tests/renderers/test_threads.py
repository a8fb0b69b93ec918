"""Threads decide no number."""

from __future__ import annotations

import drjit
import numpy as np

from malus.renderers.families.family import render_family
from malus.renderers.variant import choose, use_threads
from malus.scenes import (
    Area,
    Blob,
    Camera,
    Dielectric,
    Sampling,
    Scene,
)


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
