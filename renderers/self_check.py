"""Compare small renders of every kind of scene with stored values and with laws of optics.

The stored values are means over `RUNS` seeds on the LLVM variant, with their standard deviations.
A render of any variant must agree with them within its noise, in every region of the image and in
all together. A mistake in the stored values themselves would show in `self_check_laws`: a white
furnace, the Torrance-Sparrow formulas, Fresnel's polarisation up to Brewster's angle, and Mitsuba's
own polariser before the camera.
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

from malus.renderers.self_check_laws import LAWS, OF_ARRAYS
from malus.renderers.self_check_scenes import SCENES, SHORT, region_means, rendered
from malus.renderers.variant import Variant
from malus.scenes import Scene
from malus.scenes.core.arrays import AnyArray, Float64Array
from malus.scenes.lights.polarised import is_polarised

_TINY = np.finfo(np.float64).tiny

REFERENCE = "self_check.json"
RUNS = 64
"""Number of seeds of which a stored value is the mean."""

LARGEST = 6.0
"""Deviation, in standard errors, of the worst of some hundred values: 2e-9 each for Gaussian noise.
Light by rare paths has longer tails, faults seen so far were above 50."""

LARGEST_GAIN = 5.0
"""The same of the worst gain: these are fewer, and sums of many values have no long tails."""

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
        if (short and name not in SHORT) or (name in OF_ARRAYS and not variant.vectorised):
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
    """Largest deviation of a lobe, in a region or in all together, from the stored values."""
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
    rounding = ROUNDING * largest
    # As many times that of the stored values as the noise of all regions of a lobe is.
    of_lobe, stored_one = (np.sum(part**2, axis=(1, 2, 3)) for part in (noise, spread))
    times = np.sqrt(np.where(stored_one > 0, of_lobe / np.maximum(stored_one, _TINY), 1.0))
    own = np.maximum(own, spread * times[:, None, None, None])
    of_regions = np.abs(values - mean) / _error(spread, own, rounding)
    together = np.maximum(_in_groups(mean**2), _TINY)
    # Rounding may be alike in all regions.
    rms = np.sqrt(together / _in_groups(np.ones_like(mean)))
    of_all = np.array(stored["gain spread"])
    error = _error(of_all, of_all * times[:, None, None], rounding / rms)
    of_gains = np.abs(gains(values - mean, mean)) / error
    return float(max(of_regions.max(), of_gains.max() * LARGEST / LARGEST_GAIN))


def _error(spread: Float64Array, own: Float64Array, rounding: AnyArray | float) -> Float64Array:
    """Standard error of the difference of one render from the mean of `RUNS`."""
    return np.sqrt(np.maximum(spread, own) ** 2 + spread**2 / RUNS + np.square(rounding))


def gains(values: Float64Array, mean: Float64Array) -> Float64Array:
    """Factors of s0, and of its polarisation, by which all regions together differ from a mean.

    A fault that changes every region by little stands out here, and in none of them.

    Parameters
    ----------
    values, mean : (lobes, regions, bands, components)

    Returns
    -------
    (lobes, 2, bands) : those that fit best; 0 where there is no light

    Examples
    --------
    >>> mean = np.full((1, 5, 1, 3), 2.0)
    >>> gains(1.01 * mean, mean).round(6).tolist()
    [[[1.01], [1.01]]]
    """
    return _in_groups(values * mean) / np.maximum(_in_groups(mean**2), _TINY)


def _in_groups(values: Float64Array) -> Float64Array:
    """Sums (lobes, 2, bands) over regions, of s0 and of all other components."""
    s0, others = values[..., :1], values[..., 1:]
    return np.stack([part.sum(axis=(1, 3)) for part in (s0, others)], axis=1)


def works(variant: Variant) -> bool:
    """Whether a variant passes the short form of `self_check`."""
    return all(check.passed for check in self_check(variant, short=True))


if __name__ == "__main__":
    import sys

    on_trial = Variant(sys.argv[1], "on trial", sys.argv[2] or None)
    sys.exit(0 if works(on_trial) else 1)
