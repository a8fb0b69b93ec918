"""Extreme pixels through the real methods: what must come out, and what is wrong if it does not."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct import Components, Observation, get_method
from malus.scenes import Distant

METHODS = tuple(
    f"{specular}{body}"
    for specular in ("eq8", "visible", "shadowed", "smooth", "half_vector", "lights")
    for body in ("", "+body")
)
DTYPES = ("float32", "float64")
_PLACE = (2, 3)  # the pixel that is made extreme


class ImageCase(NamedTuple):
    """One extreme: changes an observation in place or returns another; is that pixel invalid?"""

    name: str
    make: Callable[[Observation], Observation]
    invalid: bool


def ordinary(dtype: str, height: int = 5, width: int = 7) -> Observation:
    """A cap of a sphere in three bands under a distant light: nothing is wrong with it."""
    y, x = np.meshgrid(np.linspace(0.6, -0.6, height), np.linspace(-0.7, 0.7, width), indexing="ij")
    normals = np.stack([x, y, np.sqrt(1.0 - x * x - y * y)], axis=-1).astype(dtype)
    bands = np.array([1.0, 0.5, 0.25])
    specular = ((0.2 + y * y + np.abs(x))[..., None] * bands).astype(dtype)
    diffuse = ((0.5 + 0.3 * x)[..., None] * bands[::-1]).astype(dtype)
    return Observation(
        image=specular + diffuse,
        mask=np.ones((height, width), dtype=bool),
        wavelengths_nm=(450.0, 550.0, 650.0),
        specular=specular,
        diffuse=diffuse,
        normals=normals,
        eta=np.array([1.52, 1.51, 1.50]),
        alpha=0.3,
        light=Distant(incidence_deg=60),
    )


def planted(name: str, value: float | str, *where: int) -> Callable[[Observation], Observation]:
    """Set one pixel, or one of its bands, of an array to a value ("max", "tiny" of the dtype)."""

    def make(observation: Observation) -> Observation:
        values = getattr(observation, name).copy()
        limits = np.finfo(values.dtype)
        extremes = {"max": limits.max, "bright": limits.max / 8, "tiny": limits.smallest_subnormal}
        values[(*_PLACE, *where)] = extremes[value] if isinstance(value, str) else value
        return replace(observation, **{name: values})

    return make


def _denormal(observation: Observation) -> Observation:
    tiny = np.finfo(observation.image.dtype).smallest_subnormal
    scale = np.arange(1.0, observation.image.size + 1.0).reshape(observation.image.shape)
    values = (scale * tiny).astype(observation.image.dtype)
    return replace(observation, image=values + values, specular=values, diffuse=values)


def _at_brewster(observation: Observation) -> Observation:
    """Mirrored light only, completely polarised, at many azimuths: rounding shows at DoLP 1."""
    dtype = observation.image.dtype
    turn = np.linspace(0.0, 2.0 * np.pi, observation.mask.size).reshape(observation.mask.shape)
    brewster = np.arctan(1.5)
    flat = np.sin(brewster) * np.cos(turn), np.sin(brewster) * np.sin(turn)
    normals = np.stack([*flat, np.full_like(turn, np.cos(brewster))], axis=-1).astype(dtype)
    return replace(
        observation,
        image=observation.specular,  # type: ignore[arg-type]
        diffuse=np.zeros_like(observation.specular),
        normals=normals,
        eta=np.full(3, 1.5),
        alpha=1e-3,
        light=Distant(incidence_deg=float(np.degrees(2.0 * brewster))),
    )


def _masked(observation: Observation) -> Observation:
    mask = np.zeros_like(observation.mask)
    mask[_PLACE] = True
    return replace(observation, mask=mask)


def _emptied(observation: Observation) -> Observation:
    return replace(observation, mask=np.zeros_like(observation.mask))


def _cut(height: int, width: int) -> Callable[[Observation], Observation]:
    def make(observation: Observation) -> Observation:
        names = ("image", "mask", "specular", "diffuse", "normals")
        cut = {name: getattr(observation, name)[:height, :width] for name in names}
        return replace(observation, **cut)

    return make


def image_cases() -> list[ImageCase]:
    """Every extreme image of one surface under an orthographic camera."""
    cases = [
        ImageCase("ordinary pixels", lambda observation: observation, False),
        ImageCase("denormal intensities", _denormal, False),
        ImageCase("complete polarisation", _at_brewster, False),
        ImageCase("one-pixel mask", _masked, False),
        ImageCase("empty mask", _emptied, False),
        ImageCase("one-pixel image", _cut(1, 1), False),
        ImageCase("empty image", _cut(0, 0), False),
        ImageCase("normal straight at the viewer", planted("normals", (0, 0, 1)), False),  # type: ignore[arg-type]
        ImageCase("normal at the limb", planted("normals", (0.6, 0.8, 0)), False),  # type: ignore[arg-type]
        ImageCase("normal facing away", planted("normals", (0.6, 0, -0.8)), True),  # type: ignore[arg-type]
        ImageCase("zero normal", planted("normals", 0.0), True),
        ImageCase("normal of length two", planted("normals", (0, 0, 2)), True),  # type: ignore[arg-type]
        ImageCase("largest number in a normal", planted("normals", "max", 0), True),
        ImageCase("NaN in a normal", planted("normals", np.nan, 1), True),
        ImageCase("infinite normal", planted("normals", np.inf), True),
    ]
    for lobe in ("specular", "diffuse"):
        cases += [
            ImageCase(f"black {lobe}", planted(lobe, 0.0), False),
            ImageCase(f"saturated {lobe}", planted(lobe, "bright"), False),
            ImageCase(f"largest number, {lobe}", planted(lobe, "max"), True),
            ImageCase(f"smallest number, {lobe}", planted(lobe, "tiny", 1), False),
            ImageCase(f"negative {lobe}, one band", planted(lobe, -1e-3, 1), True),
            ImageCase(f"NaN {lobe}, one band", planted(lobe, np.nan, 2), True),
            ImageCase(f"infinite {lobe}", planted(lobe, np.inf), True),
            ImageCase(f"minus infinite {lobe}", planted(lobe, -np.inf, 0), True),
        ]
    return cases


def image_faults(case: ImageCase, dtype: str, method: str) -> list[str]:
    """What is wrong with a method's result for an extreme; warnings count as faults."""
    observation = case.make(ordinary(dtype))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = get_method(method).reconstruct(observation)
    except Warning as warning:
        return [f"{method}: warns {warning}"]
    except ValueError as error:
        return [f"{method}: raises {error}"]
    return [f"{method}: {fault}" for fault in _wrong(found, observation, case.invalid)]


def _wrong(found: Components, observation: Observation, invalid: bool) -> list[str]:
    faults = []
    stokes = np.asarray(found.stokes, dtype=np.float64)
    if not np.all(np.isfinite(stokes)):
        faults.append("not finite")
    faults += _outside(stokes, found.image.dtype)
    if found.image.dtype != observation.image.dtype or found.image.shape != observation.image.shape:
        faults.append("another shape or dtype than the image")
    expected = np.ones(observation.mask.shape, dtype=bool)
    if invalid:
        expected[_PLACE] = False
    if found.valid is None or not np.array_equal(found.valid, expected):
        faults.append("valid does not flag the pixel, or flags others")
    elif np.any(stokes[~expected]):
        faults.append("an invalid pixel is not zero")
    return faults


def _outside(stokes: NDArray[np.float64], dtype: Any) -> list[str]:
    """DoLP outside [0, 1]: denormal numbers may miss it by one spacing, all others by nothing."""
    spacing = float(np.finfo(dtype).smallest_subnormal)
    with np.errstate(invalid="ignore"):  # not finite is told elsewhere
        polarised = np.hypot(stokes[..., 1], stokes[..., 2])
        bad = (polarised > stokes[..., 0] + spacing) | (stokes[..., 0] < 0.0)
    return [f"DoLP outside [0, 1] in {np.count_nonzero(bad)} values"] if np.any(bad) else []
