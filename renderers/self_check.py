"""Compare small renders of every kind of scene with stored values and with laws of optics.

The stored values are means over `RUNS` seeds on the LLVM variant, with their standard deviations.
A render of any variant must agree with them within its noise. A mistake in
the stored values themselves would show in the laws: a white furnace, Fresnel's polarisation up to
Brewster's angle, and Mitsuba's own polariser before the camera.
"""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np

from malus.renderers.comparison.plain_mitsuba import plate_image
from malus.renderers.families.family import render_family
from malus.renderers.self_check_scenes import SCENES, SHORT, sampling_of
from malus.renderers.torrance_sparrow import fresnel
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant
from malus.scenes import Camera, Dielectric, Distant, Sampling, Scene, Sphere, Uniform
from malus.scenes.core.arrays import AnyArray, BoolArray, Float64Array
from malus.scenes.lights.polarised import is_polarised
from malus.scenes.polarisation import dolp

REFERENCE = "self_check.json"
RUNS = 64
"""Number of seeds of which a stored value is the mean."""

REGIONS = 4
"""Regions a side of the image that values are means over."""

LARGEST = 6.0
"""Deviation, in standard errors, of the worst of some hundred values: 2e-9 each for Gaussian noise.
Light by rare paths has longer tails, faults seen so far were above 50."""

MOST_NOISE = 0.05
"""Largest noise of a region's mean, over the largest value: more would hide faults."""

MOST_DIFFERING = 5
"""Pixels of 256 whose corners may be hit or missed by rounding."""

ROUNDING = 2e-5
"""Largest difference, over the largest value, of sums of 32 bits in another order."""


@dataclass(frozen=True)
class Check:
    """Outcome of one comparison with stored values or a law.

    Attributes
    ----------
    name : str
    what : str
        What was compared.
    deviation, limit : float
        The largest deviation and what is allowed, in the unit that `what` names; NaN where an
        error stopped the check.
    seconds : float
    passed : bool
    why : str
        The error that stopped it, or nothing.
    """

    name: str
    what: str
    deviation: float
    limit: float
    seconds: float
    passed: bool
    why: str = ""


def self_check(variant: Variant, short: bool = False) -> Iterator[Check]:
    """Render small scenes of every kind on a variant and compare them with stored values and laws.

    Parameters
    ----------
    variant : Variant
    short : bool
        Only the few scenes that found every fault so far, in seconds.

    Yields
    ------
    Check, one after the other; an exception of a render is a check that failed.
    """
    stored = json.loads(resources.files("malus.renderers").joinpath(REFERENCE).read_text("utf-8"))
    for name, scene in SCENES.items():
        if (short and name not in SHORT) or not (variant.vectorised or is_plain(scene)):
            continue
        compare = functools.partial(_deviation, variant, scene, stored[name])
        yield _checked(name, "σ from stored values", LARGEST, compare)
    for name, (what, limit, law) in LAWS.items():
        if (short and name not in SHORT) or (name == "malus" and not variant.vectorised):
            continue
        yield _checked(name, what, limit, functools.partial(law, variant))


def is_plain(scene: Scene) -> bool:
    """Whether the scalar variant can render a scene: one object, one surface, unpolarised light."""
    plain_light = not is_polarised(scene.light)
    return plain_light and not scene.surroundings and scene.surface.kind != "patterned"


def _checked(name: str, what: str, limit: float, compare: Callable[[], float]) -> Check:
    started = time.perf_counter()
    try:
        deviation, why = compare(), ""
    except Exception as error:  # drivers may raise anything: that is a failed check
        deviation, why = float("nan"), f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - started
    return Check(name, what, deviation, limit, seconds, deviation <= limit, why)


def _deviation(variant: Variant, scene: Scene, stored: Mapping[str, Any]) -> float:
    """Largest deviation of a region's Stokes vector of a lobe from the stored one."""
    truth = rendered(variant, scene, seed=1)
    mean, spread = (np.array(stored[key]) for key in ("mean", "spread"))
    covered = np.array([[digit == "1" for digit in row] for row in stored["covered"]])
    differing = int((covered != truth.mask).sum())
    if differing > MOST_DIFFERING:
        raise ValueError(f"expected the stored mask, found {differing} other pixels")
    # A ray through a corner may just hit or miss an edge: the same pixels, whatever this mask says.
    values, noise = region_means(truth, covered)
    largest = np.abs(mean).max()
    # A variant may draw its samples in another way: its own noise, as of all regions.
    own = np.sqrt(np.mean(noise**2, axis=1, keepdims=True))
    if not own.max() < MOST_NOISE * largest:
        share = own.max() / largest
        raise ValueError(f"expected noise below {MOST_NOISE:g} of the light, found {share:.2g}")
    error = np.sqrt(np.maximum(spread, own) ** 2 + spread**2 / RUNS + (ROUNDING * largest) ** 2)
    return float(np.abs((values - mean) / error).max())


def rendered(variant: Variant, scene: Scene, seed: int) -> Truth:
    """The truth of a scene of `SCENES` with the samples that its values were stored for."""
    sampling = sampling_of(scene).model_copy(update={"seed": seed})
    return render_family([scene], sampling, variant).truth(scene)


def region_means(truth: Truth, covered: BoolArray) -> tuple[Float64Array, Float64Array]:
    """Means of both lobes, and of their noise, over the regions of an image that are `covered`.

    Returns
    -------
    values, noise : (2, regions, bands, 3) arrays, of 4 components where there is an s3
    """
    values = _lobes(truth.specular, truth.diffuse, truth.s3)
    noise = _lobes(truth.specular_noise, truth.diffuse_noise, truth.s3_noise)
    side = covered.shape[0] // REGIONS
    means = []
    for row in range(REGIONS):
        for column in range(REGIONS):
            window = np.s_[row * side : (row + 1) * side, column * side : (column + 1) * side]
            inside = covered[window]
            if inside.mean() >= 0.5:
                means.append([_mean(array, window, inside) for array in (values, noise)])
    result = np.moveaxis(np.array(means), 0, 2)
    return result[0], result[1]


def _lobes(specular: AnyArray, diffuse: AnyArray, s3: AnyArray | None) -> Float64Array:
    """Both lobes (2, height, width, bands, 3 or 4); s3 is part of the specular one."""
    lobes = np.stack([specular, diffuse]).astype(np.float64)
    if s3 is None:
        return lobes
    return np.concatenate([lobes, np.stack([s3, np.zeros_like(s3)])[..., None]], axis=-1)


def _mean(array: AnyArray, window: Any, inside: AnyArray) -> Float64Array:
    return np.asarray(array[(slice(None), *window)][:, inside].mean(axis=1))


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


def _repeated(variant: Variant) -> float:
    """Renders of several seeds spread as far as their standard errors say."""
    truths = [rendered(variant, SCENES["area light"], seed) for seed in range(8)]
    inside = truths[0].mask
    images = np.stack([truth.stokes[inside] for truth in truths]).astype(np.float64)
    errors = np.stack([truth.standard_error[inside] for truth in truths]).astype(np.float64)
    spread = images.var(axis=0, ddof=1).sum() / np.square(errors).mean(axis=0).sum()
    return float(abs(np.log(max(spread, 1e-30))))


LAWS: dict[str, tuple[str, float, Callable[[Variant], float]]] = {
    # In standard errors, and 1e-5 for the rounding of 32 bits.
    "furnace": ("σ from a white furnace", 5.0, _furnace),
    # A pixel sees 4° of zenith angles at 65°, where the law changes by 0.02 a degree. In a wrong
    # frame the difference is up to 1.
    "brewster": ("DoLP from Fresnel's", 0.05, _brewster),
    # Two renders of 256 samples: their noise is 4e-3 at most, a wrong sign of s2 gives 0.3.
    "malus": ("I(ϑ) over the peak", 0.03, _malus),
    # Eight seeds of 120 pixels: 0.04 in the mean of 30 tries, 0.16 at most. Where errors are off
    # by √2 it is 0.7, and where the seed does not matter 69.
    "repeated render": ("ln of variance over that stated", 0.35, _repeated),
}
"""Laws by name: the unit of the deviation, its limit with the reason, and the measurement."""


def works(variant: Variant) -> bool:
    """Whether a variant passes the short form of `self_check`."""
    return all(check.passed for check in self_check(variant, short=True))


if __name__ == "__main__":
    import sys

    on_trial = Variant(sys.argv[1], "on trial", sys.argv[2] or None)
    sys.exit(0 if works(on_trial) else 1)
