"""Laws of optics and of Monte Carlo that `self_check` holds small renders against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from malus.renderers.comparison.plain_mitsuba import plate_image
from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.lobe_samples import MOST_IN_FLOAT32
from malus.renderers.mitsuba.wavefront import cached_stage
from malus.renderers.self_check_scenes import SCENES
from malus.renderers.torrance_sparrow import fresnel, render_torrance_sparrow
from malus.renderers.variant import Variant
from malus.scenes import (
    Area,
    Camera,
    Dielectric,
    Distant,
    Polariser,
    Sampling,
    Scene,
    Sphere,
    Superquadric,
    Torus,
    Uniform,
)
from malus.scenes.core.arrays import AnyArray
from malus.scenes.polarisation import dolp

ALIKE = 1e-3
"""Difference of two draws, in standard deviations, below which they come of the same numbers."""

TWO_LAUNCHES = 257
"""Pixels a side of an image that takes two launches of `PIXELS_A_LAUNCH` pixels."""


def _furnace(variant: Variant) -> float:
    """A white Lambertian body under light of radiance 1 from everywhere has radiance 1."""
    surface = Dielectric(eta=1.5, alpha=0.3, albedo=1.0, body="unpolarised")
    scene = Scene(shape=Sphere(), surface=surface, light=Uniform(), camera=Camera(resolution=16))
    truth = render_family([scene], Sampling(samples=16), variant).truth(scene)
    inside = truth.mask
    noise = truth.standard_error[inside][..., 0]
    off = truth.diffuse[inside][..., 0].mean() - 1.0
    # The scalar variant draws directions from the light, not from the body: its mean has noise.
    return float(abs(off) / (np.sqrt(np.sum(noise**2)) / noise.size + 1e-5))


def _brewster(variant: Variant) -> float:
    """A nearly smooth sphere polarises as Fresnel says, completely at Brewster's angle."""
    surface = Dielectric(eta=1.5, alpha=0.01, albedo=0.0, body="unpolarised")
    scene = Scene(shape=Sphere(), surface=surface, light=Uniform(), camera=Camera(resolution=32))
    truth = render_family([scene], Sampling(samples=64), variant).truth(scene)
    cosine = truth.normals[..., 2].astype(np.float64)
    inside = truth.mask & (cosine > np.cos(np.radians(65.0)))
    perpendicular, parallel = fresnel(cosine[inside], np.array([1.5]))
    law = (perpendicular - parallel) / (perpendicular + parallel)
    return float(np.abs(dolp(truth.specular)[inside][:, 0] - law).max())


def _malus(variant: Variant) -> float:
    """I(ϑ) of the Stokes vector is what Mitsuba's camera sees behind Mitsuba's own polariser."""
    surface = Dielectric(eta=1.5, alpha=0.3, albedo=0.0, body="unpolarised")
    light = Distant(incidence_deg=60, azimuth_deg=30)
    scene = Scene(shape=Sphere(), surface=surface, light=light, camera=Camera(resolution=16))
    truth = render_family([scene], Sampling(samples=256), variant).truth(scene)
    difference = truth.polarised(30.0)[..., 0] - plate_image(
        variant, scene, 0, 30.0, Sampling(samples=256)
    )
    return float(np.abs(difference[truth.mask]).max() / truth.image.max())


def _formulas(variant: Variant) -> float:
    """A spot of a sphere shows each pixel what the Torrance-Sparrow formulas say, nearly exactly.

    So small a spot is nearly flat, and its pixels have no noise: lost samples, half precision and
    interpolation between wrong nodes show. The camera is moved and rolled. One render takes two
    launches, one sums its samples in 64 bits.
    """
    sizes = ((TWO_LAUNCHES, 2), (8, MOST_IN_FLOAT32 + 2)) if variant.vectorised else ((8, 1024),)
    return max(_off_formulas(variant, side, samples) for side, samples in sizes)


def _off_formulas(variant: Variant, side: int, samples: int) -> float:
    """Largest difference of a pixel's normal, or a lobe over its peak, from the formulas."""
    camera = Camera(
        resolution=side, half_width=1e-3, roll_deg=35.0, azimuth_deg=40.0, elevation_deg=25.0
    )
    # 13 bands are more than nodes: they are interpolated. From here, masking hides no facet.
    bands = tuple(np.linspace(400.0, 700.0, 13).tolist())
    surface = Dielectric(material="pmma", alpha=0.3, albedo="red", body="unpolarised")
    light = Distant(incidence_deg=60, azimuth_deg=80)
    scene = Scene(shape=Sphere(), surface=surface, light=light, camera=camera, wavelengths_nm=bands)
    truth = render_family([scene], Sampling(samples=samples), variant).truth(scene)
    law = render_torrance_sparrow(scene)
    if not truth.mask.all():
        raise ValueError(f"expected the sphere in every pixel, found {truth.mask.mean():.3g}")
    pairs = ((truth.specular, law.specular), (truth.diffuse, law.diffuse))
    off = [float(np.abs(found - true).max() / true.max()) for found, true in pairs]
    return max(*off, float(np.abs(truth.normals - law.normals).max()))


def _replayed(variant: Variant) -> float:
    """A render by a kernel recorded for another light, surface and seed is that of a new kernel."""
    camera, shape = Camera(resolution=16), Torus(tilt_deg=30)

    def scene(change: float) -> Scene:
        how = Polariser(angle_deg=30 + change, degree=0.5 + 0.01 * change)
        light = Area(
            incidence_deg=40 + change,
            half_angle_deg=15 + change,
            radiance=1 + change,
            polarised=how,
        )
        surface = Dielectric(eta=1.4 + 0.01 * change, alpha=0.2 + 0.01 * change, albedo=0.5)
        return Scene(shape=shape, surface=surface, light=light, camera=camera)

    def image(change: int) -> AnyArray:
        sampling = Sampling(samples=64, seed=change)
        return render_family([scene(change)], sampling, variant).truth(scene(change)).stokes

    cached_stage.cache_clear()
    image(20)
    replayed = image(0)
    cached_stage.cache_clear()
    new = image(0)
    return float(np.abs(replayed - new).max() / new.max())


def _own_numbers(variant: Variant) -> float:
    """Pixels, halves of the samples, and seeds differ, as their random numbers do.

    On a flat face nothing else differs: where two share their numbers, they are equal.
    """
    surface = Dielectric(eta=1.5, alpha=0.3, albedo=0.5, body="unpolarised")
    scene = Scene(
        shape=Superquadric(e1=0.1, e2=0.1, stretch=(1, 1, 1)),
        surface=surface,
        light=Area(incidence_deg=40, azimuth_deg=70, half_angle_deg=30),
        camera=Camera(resolution=16, half_width=1e-3),
    )
    truths = [
        render_family([scene], Sampling(samples=16, seed=seed), variant).truth(scene)
        for seed in (1, 2)
    ]
    halves = np.concatenate(
        [
            np.concatenate([half.specular, half.diffuse[..., :1]], axis=-1).reshape(-1, 4)
            for truth in truths
            for half in truth.halves()
        ]
    ).astype(np.float64)
    scaled = (halves / halves.std(axis=0))[np.argsort(halves[:, 0])]
    gaps = np.abs(np.diff(scaled, axis=0)).max(axis=1)
    return float(np.mean(gaps < ALIKE))


def _repeated(variant: Variant) -> float:
    """Renders of several seeds spread as their standard errors say, and their halves as well.

    So do sums over rows and columns of pixels, whose errors are independent.
    """
    scene = SCENES["area light"]
    truths = [
        render_family([scene], Sampling(samples=64, seed=seed), variant).truth(scene)
        for seed in range(32 if variant.vectorised else 16)
    ]
    inside = truths[0].mask[..., None, None]

    def of_seeds(images: list[AnyArray]) -> AnyArray:
        return np.where(inside, np.stack(images), 0).astype(np.float64)

    stokes = of_seeds([truth.stokes for truth in truths])
    variance = of_seeds([truth.standard_error for truth in truths]) ** 2
    noise = of_seeds([truth.specular_noise + truth.diffuse_noise for truth in truths])
    found = [stokes.sum(axis=axis).var(axis=0, ddof=1).sum() for axis in ((), 1, 2)]
    ratios = np.array([*found, np.mean(noise**2, axis=0).sum()]) / variance.mean(axis=0).sum()
    return float(np.abs(np.log(np.maximum(ratios, 1e-30))).max())


LAWS: dict[str, tuple[str, float, Callable[[Variant], float]]] = {
    # In standard errors, and 1e-5 for the rounding of 32 bits.
    "furnace": ("σ from a white furnace", 5.0, _furnace),
    # A pixel sees 4° of zenith angles at 65°, where the law changes by 0.02 a degree. In a wrong
    # frame the difference is up to 1.
    "brewster": ("DoLP from Fresnel's", 0.05, _brewster),
    # Two renders of 256 samples: their noise is 4e-3 at most, a wrong sign of s2 gives 0.3.
    "malus": ("I(ϑ) over the peak", 0.03, _malus),
    # 3.3e-5 over 24 seeds, 8e-5 in the scalar variant: rounding, and how a pixel bends. Half
    # precision gives 5e-4, an index that is wrong by 0.003 gives 9e-3, a lost sample of two 0.5.
    "formulas": ("pixel from formulas, over the peak", 2e-4, _formulas),
    # It is 0 on LLVM; a sum in another order would be rounded in another way.
    "replayed kernel": ("of a new kernel, over the peak", 1e-5, _replayed),
    # Of 1024 independent draws of four components two in a row are hardly ever that near.
    "own random numbers": ("share of draws that another equals", 0.0, _own_numbers),
    # 32 seeds of 120 pixels: 0.09 in the mean of 24 tries, 0.19 at most. Errors that are off by √2
    # give 0.7, random numbers that pixels share by pairs 0.45, a seed that does not matter 69.
    "repeated render": ("ln of variance over that stated", 0.35, _repeated),
}
"""Laws by name: the unit of the deviation, its limit with the reason, and the measurement."""

OF_ARRAYS = frozenset({"malus", "replayed kernel"})
"""Laws that the scalar variant has no part in."""
