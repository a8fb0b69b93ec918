"""Scenes of several objects that light each other, and what they need of the machine."""

from __future__ import annotations

from typing import Any

import pytest

from malus.renderers.mitsuba.path_traced import Room
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Camera,
    Dielectric,
    Light,
    Placed,
    Plane,
    Sampling,
    Scene,
    Sphere,
    Superquadric,
    Surroundings,
)

needs_arrays = pytest.mark.skipif(
    not choose().vectorised, reason="scenes of several objects need LLVM or CUDA"
)


def table(light: Light, body: str = "polarised", resolution: int = 20) -> Scene:
    """A ball on a tilted floor with a small ball and a box beside it."""

    def paint(eta: float, alpha: float, albedo: float) -> Dielectric:
        return Dielectric(eta=eta, alpha=alpha, albedo=albedo, body=body)

    return Scene(
        shape=Sphere(),
        surface=paint(1.5, 0.3, 0.5),
        light=light,
        camera=Camera(resolution=resolution, half_width=1.8),
        surroundings=Surroundings(
            name="table",
            objects=(
                Placed(
                    shape=Plane(),
                    surface=paint(1.6, 0.1, 0.5),
                    position=(0, -1, 0),
                    tilt_deg=30,
                    scale=20,
                ),
                Placed(
                    shape=Sphere(),
                    surface=paint(1.33, 0.15, 0.8),
                    position=(1.2, -0.3, 0.8),
                    scale=0.5,
                ),
                Placed(
                    shape=Superquadric(),
                    surface=paint(1.7, 0.2, 0.8),
                    position=(-1.2, -0.3, 0.8),
                    scale=0.5,
                    turn_deg=30,
                ),
            ),
        ),
    )


def own_shapes(scene: Scene) -> dict[str, Any]:
    """Its objects as malus renders them, in the first band, for Mitsuba's own integrators."""
    room = Room(mitsuba(choose()), scene, Sampling(samples=2))
    for bsdf in room.bsdfs:
        eta = bsdf.surface.indices(scene.wavelengths_nm)[0].item()
        bsdf.set_band(eta, float(bsdf.surface.albedos(scene.wavelengths_nm)[0]))
    return {f"object{i}": shape for i, shape in enumerate(room.shapes)}
