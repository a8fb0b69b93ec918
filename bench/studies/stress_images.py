"""Stress study: images with one extreme pixel, and faults of what methods make of them."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from malus.reconstruct import Components, Observation, get_method
from malus.scenes import Area, Distant
from malus.scenes.core.arrays import Float64Array

METHODS = tuple(
    f"{specular}{body}"
    for specular in ("eq8", "visible", "shadowed", "smooth", "half_vector", "lights")
    for body in ("", "+body")
)
DTYPES = ("float32", "float64")
_PIXEL = (2, 3)  # row and column of the pixel that is made extreme


class ImageCase(NamedTuple):
    """An extreme image: makes it from an ordinary one; `invalid` says whether the pixel is."""

    name: str
    make: Callable[[Observation], Observation]
    invalid: bool


def ordinary(dtype: str) -> Observation:
    """Observation of a cap of a sphere in three bands under a distant light, without extremes."""
    y, x = np.meshgrid(np.linspace(0.6, -0.6, 5), np.linspace(-0.7, 0.7, 7), indexing="ij")
    normals = np.stack([x, y, np.sqrt(1.0 - x * x - y * y)], axis=-1).astype(dtype)
    bands = np.array([1.0, 0.5, 0.25])
    specular = ((0.2 + y * y + np.abs(x))[..., None] * bands).astype(dtype)
    diffuse = ((0.5 + 0.3 * x)[..., None] * bands[::-1]).astype(dtype)
    return Observation(
        image=specular + diffuse,
        mask=np.ones(x.shape, dtype=bool),
        wavelengths_nm=(450.0, 550.0, 650.0),
        specular=specular,
        diffuse=diffuse,
        normals=normals,
        eta=np.array([1.52, 1.51, 1.50]),
        alpha=0.3,
        light=Distant(incidence_deg=60),
    )


def planted(name: str, value: float | str, *where: int) -> Callable[[Observation], Observation]:
    """Function that sets the pixel, or one of its bands, to a number or an extreme of the dtype.

    Extremes are "max", "bright" (an eighth of it) and "tiny", the smallest above 0.
    """

    def make(observation: Observation) -> Observation:
        values = getattr(observation, name).copy()
        limits = np.finfo(values.dtype)
        extremes = {"max": limits.max, "bright": limits.max / 8, "tiny": limits.smallest_subnormal}
        values[(*_PIXEL, *where)] = extremes[value] if isinstance(value, str) else value
        return replace(observation, **{name: values})

    return make


def _denormal(observation: Observation) -> Observation:
    tiny = np.finfo(observation.image.dtype).smallest_subnormal
    scale = np.arange(1.0, observation.image.size + 1.0).reshape(observation.image.shape)
    values = (scale * tiny).astype(observation.image.dtype)
    return replace(observation, image=values + values, specular=values, diffuse=values)


def _at_brewster(observation: Observation) -> Observation:
    """Specular light only, completely polarised, at many azimuths: rounding shows at DoLP 1."""
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
    mask[_PIXEL] = True
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
    """Extreme images of one surface under an orthographic camera."""
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


OF_ANY_LIGHT = frozenset({"lights", "lights+body"})
"""Methods that sum over directions of the light, of which a lamp as wide as this has many."""


def image_faults(case: ImageCase, dtype: str, method: str) -> list[str]:
    """Faults of a method's result for an extreme image; warnings and exceptions are faults."""
    observation = case.make(ordinary(dtype))
    if method in OF_ANY_LIGHT:
        observation = replace(observation, light=Area(incidence_deg=60, half_angle_deg=20))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            result = get_method(method).reconstruct(observation)
    except Warning as warning:
        return [f"{method}: warns {warning}"]
    except ValueError as error:
        return [f"{method}: raises {error}"]
    return [f"{method}: {fault}" for fault in _faults(result, observation, case.invalid)]


def _faults(result: Components, observation: Observation, invalid: bool) -> list[str]:
    """Faults of a result: not finite, unphysical, of another shape, wrongly flagged."""
    faults = []
    image, valid = result.image, result.valid
    stokes = np.asarray(result.stokes, dtype=np.float64)
    if not np.all(np.isfinite(stokes)):
        faults.append("not finite")
    faults += _outside(stokes, image.dtype)
    if image.dtype != observation.image.dtype or image.shape != observation.image.shape:
        faults.append("another shape or dtype than the image")
    expected = np.ones(observation.mask.shape, dtype=bool)
    if invalid:
        expected[_PIXEL] = False
    if valid is None or not np.array_equal(valid, expected):
        faults.append("valid does not flag the pixel, or flags others")
    elif np.any(stokes[~expected]):
        faults.append("an invalid pixel is not zero")
    return faults


def _outside(stokes: Float64Array, dtype: Any) -> list[str]:
    """Fault of DoLP outside [0, 1]; denormal numbers may be outside by one spacing."""
    spacing = float(np.finfo(dtype).smallest_subnormal)
    with np.errstate(invalid="ignore"):  # a fault of its own
        polarised = np.hypot(stokes[..., 1], stokes[..., 2])
        bad = (polarised > stokes[..., 0] + spacing) | (stokes[..., 0] < 0.0)
    return [f"DoLP outside [0, 1] in {np.count_nonzero(bad)} values"] if np.any(bad) else []
