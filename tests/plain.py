"""Scenes in plain Mitsuba, written as its documentation says, to compare truths with."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from malus.renderers import Truth
from malus.renderers.comparison.plain_mitsuba import lamps
from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.translate import sensor, shape_object
from malus.renderers.variant import choose, mitsuba
from malus.scenes import (
    Area,
    Camera,
    Conductor,
    Dielectric,
    Distant,
    Light,
    Polariser,
    Sampling,
    Scene,
    Sky,
    SkyPolarisation,
    Sphere,
    Torus,
)
from malus.scenes.lights.polarised import is_polarised
from malus.scenes.materials.surface import Surface

PAINT = Dielectric(eta=1.5, alpha=0.3, albedo=0.6, body="polarised")
CHALK = Dielectric(eta=1.5, alpha=0.3, albedo=0.6, body="unpolarised")
COPPER = Conductor(eta=0.6, k=2.6, alpha=0.3)
GOLD = {"eta": 0.2, "k": 3.0}
MIRROR = {"eta": 0.01, "k": 20.0}
"""A metal that absorbs next to nothing."""

POLARISED: list[Light] = [
    Distant(incidence_deg=60, polarised=Polariser(angle_deg=30)),
    Area(incidence_deg=50, polarised=Polariser(angle_deg=110, degree=0.7)),
    Sky(sun_elevation_deg=20, polarised=SkyPolarisation()),
]
OBLIQUE = Distant(incidence_deg=55, azimuth_deg=35)
RING = Torus(major=0.62, minor=0.36, tilt_deg=65)
"""Its hollow lights itself."""

LAMP = Area(incidence_deg=50, azimuth_deg=200, half_angle_deg=25, radiance=2.0)


def flat(value: float) -> dict[str, Any]:
    return {"type": "uniform", "value": value}


def plain_bsdf(surface: Dielectric | Conductor) -> dict[str, Any]:
    """The whole BSDF as Mitsuba's documentation describes it."""
    if isinstance(surface, Conductor):
        along, across = surface.alphas
        roughness = {"alpha_u": along, "alpha_v": across, "distribution": surface.distribution}
        index = {"eta": flat(surface.eta), "k": flat(surface.k)}
        return {"type": "roughconductor", **index, **roughness}
    return {
        "type": "pplastic",
        "int_ior": surface.eta,
        "ext_ior": 1.0,
        "alpha": surface.alpha,
        "distribution": surface.distribution,
        "diffuse_reflectance": flat(surface.albedo),
    }


def by_mitsuba(scene: Scene, sampling: Sampling, shapes: dict[str, Any], runs: int) -> np.ndarray:
    """Stokes images (runs, height, width, 4) by Mitsuba's `stokes` over its `path` integrator."""
    mi = mitsuba(choose())
    depth = sampling.depth(scene) + is_polarised(scene.light)  # a lamp's plate counts
    path = {"type": "path", "max_depth": depth, "hide_emitters": True}
    loaded = mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(mi, scene.camera, 100.0),
            "integrator": {"type": "stokes", "path": path},
        }
        | lamps(mi, scene.light)
        | shapes
    )
    images = [np.asarray(mi.render(loaded, spp=sampling.samples, seed=i)) for i in range(runs)]
    return np.stack(images)[..., [-12, -9, -6, -3]]


def own_shape(scene: Scene) -> dict[str, Any]:
    mi = mitsuba(choose())
    return {"own": shape_object(mi, scene.shape, mi.load_dict(plain_bsdf(scene.surface)))}


def against_scalar(scene: Scene) -> np.ndarray:
    """Differences from the truth of the scalar variant, Mitsuba's `stokes`, over their errors.

    The scalar errors come from 8 batches: Student's t with 7 degrees of freedom, variance 7/5.
    """
    if not choose().vectorised:
        pytest.skip("only the scalar variant runs here: nothing to compare it with")
    ours = render_family([scene], Sampling(samples=64, seed=1)).truth(scene)
    theirs = render_family([scene], Sampling(samples=64, seed=2), choose("scalar")).truth(scene)
    # Pixels that are dark in both, four in ten of a ring's, tell nothing of errors.
    lit = ((ours.image > 0) | (theirs.image > 0)).any(axis=-1)
    both = ours.mask & theirs.mask & lit
    error = np.hypot(ours.standard_error, theirs.standard_error)[both]
    return ((ours.stokes - theirs.stokes)[both] / np.maximum(error, 1e-6)).ravel()


def compare(truth: Truth, theirs: np.ndarray) -> None:
    """Sums over the quarters of the image agree within five deviations, for every component."""
    ours, error = truth.stokes[:, :, 0], truth.standard_error[:, :, 0]
    if truth.s3 is not None:
        ours = np.concatenate([ours, truth.s3], axis=-1)
        error = np.concatenate([error, truth.s3_standard_error], axis=-1)
    components = ours.shape[-1]
    difference = ours - theirs.mean(axis=0)[..., :components]
    variance = error**2 + theirs.var(axis=0, ddof=1)[..., :components] / len(theirs)
    # Pixels at the outline see the background differently in every run: the mask leaves them out.
    side, visible = len(truth.mask) // 2, []
    for rows in (slice(0, side), slice(side, None)):
        for columns in (slice(0, side), slice(side, None)):
            inside = truth.mask[rows, columns]
            total = difference[rows, columns][inside].sum(axis=0)
            # Five deviations, once in two million; float32 sums of samples are far below 1e-5.
            deviation = np.sqrt(variance[rows, columns][inside].sum(axis=0))
            bound = 5 * deviation + 1e-5 * inside.sum()
            assert (np.abs(total) < bound).all(), (rows, columns, total / bound)
            seen = np.abs(ours[rows, columns][inside].sum(axis=0)) > bound
            visible.append(seen[2])
    assert any(visible), "s2, off the axes, should stand out from the noise"


def scene_of(
    surface: Surface, light: Light, shape: Any = None, resolution: int = 16, roll_deg: float = 0.0
) -> Scene:
    camera = Camera(resolution=resolution, roll_deg=roll_deg)
    return Scene(shape=shape or Sphere(), surface=surface, light=light, camera=camera)


def returns_no_more(truth: Truth) -> None:
    """Of light of radiance 1 from everywhere."""
    image, error = truth.image[truth.mask], truth.standard_error[truth.mask][..., 0]
    # Four deviations of the mean, six of the noisiest pixel, and float32 sums of samples.
    assert image.mean() < 1 + 4 * np.sqrt(np.mean(error**2) / image.size) + 1e-4
    assert image.max() < 1 + 6 * error.max() + 1e-3
