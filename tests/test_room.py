"""Several objects that light each other: against Mitsuba's own integrator, and laws of light."""

from __future__ import annotations

import numpy as np
import pytest

from malus.renderers import render
from malus.renderers.family import render_family
from malus.renderers.room import Room
from malus.renderers.translate import emitter, sensor
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Area,
    Camera,
    Dielectric,
    Distant,
    Environment,
    InputError,
    Light,
    Placed,
    Plane,
    Sampling,
    Scene,
    Sphere,
    Superquadric,
    Surroundings,
    Uniform,
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


def by_mitsuba(scene: Scene, sampling: Sampling, runs: int) -> np.ndarray:
    """Stokes images (runs, height, width, 3) by Mitsuba's `stokes` over its `path` integrator."""
    mi = mitsuba(choose())
    room = Room(mi, scene, Sampling(samples=2))
    for paint in room.paints:
        paint.set_band(float(paint.surface.indices(scene.wavelengths_nm)[0]), paint.surface.albedo)
    path = {"type": "path", "max_depth": sampling.max_depth, "hide_emitters": True}
    loaded = mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(mi, scene.camera, 100.0),
            "light": emitter(mi, scene.light),
            "integrator": {"type": "stokes", "path": path},
        }
        | {f"object{i}": shape for i, shape in enumerate(room.shapes)}
    )
    images = [np.asarray(mi.render(loaded, spp=sampling.samples, seed=i)) for i in range(runs)]
    # S0 to S3 of R, G, B follow the film's own channels; in this variant all three are equal.
    return np.stack(images)[..., [-12, -9, -6]]


@needs_arrays
@pytest.mark.parametrize(
    ("light", "body"),
    [
        (Distant(incidence_deg=60, azimuth_deg=60), "unpolarised"),
        (Area(incidence_deg=60, azimuth_deg=60), "polarised"),
        (Area(incidence_deg=60, azimuth_deg=60), "unpolarised"),
        (Uniform(), "unpolarised"),
        (Environment(), "polarised"),
    ],
    ids=lambda value: getattr(value, "kind", value),
)
def test_both_lobes_together_are_what_mitsuba_renders(light: Light, body: str) -> None:
    scene, sampling, runs = table(light, body), Sampling(samples=256), 8
    truth = render(scene, sampling)
    theirs = by_mitsuba(scene, sampling, runs)[:, truth.mask]
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


def test_the_scalar_variant_refuses_in_one_line() -> None:
    scene = table(Uniform())
    with pytest.raises(InputError, match=r"expected LLVM or CUDA .* found scalar.*; install LLVM"):
        render_family([scene], Sampling(samples=2), choose("scalar"))
