"""Stages that chains from one picture share: its light, surface parameters, and lobes by a model.

A chain is `malus.reconstruct.single_image.blind` or `malus.reconstruct.single_image.paper`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import numpy as np
from scipy import ndimage

from malus.reconstruct.image import from_lobes
from malus.reconstruct.lobe_models import LobeModel
from malus.reconstruct.observation import Components, Image, Inapplicable, Observation
from malus.reconstruct.single_image.light_direction import estimate_direction
from malus.reconstruct.single_image.outline import outline_of
from malus.reconstruct.single_image.parameters import SurfaceParameters, fit_parameters
from malus.reconstruct.single_image.reduced import reduce
from malus.reconstruct.single_image.shading import BodyKind, diffuse_shading, specular_shading
from malus.reconstruct.single_image.shape import GivenParameters
from malus.reconstruct.single_image.value_range import finite_pixels
from malus.scenes.core.arrays import BoolArray, Float64Array, NumberArray
from malus.scenes.lights.lights import Distant

_SAMPLE = 8_000
"""Pixels that parameters are fitted to, or up to twice as many: five numbers need no more."""


_LIGHTS = ("image", "specular", "diffuse")


def without_gaps(observation: Observation) -> tuple[Observation, BoolArray]:
    """The observation with images of finite floats, and where all were finite (height, width).

    A pixel that is not finite takes the values of the nearest one of the object that is, for the
    stages that look at the whole object: a hole in the mask would pass for an outline. `with_gaps`
    takes them away again.

    Raises
    ------
    Inapplicable
        If no pixel of the object is finite.
    """
    mask = observation.mask
    given = {name: getattr(observation, name) for name in _LIGHTS}
    lights: dict[str, Any] = {
        name: np.asarray(light, np.result_type(light.dtype, np.float32))
        for name, light in given.items()
        if light is not None
    }
    finite = np.all([finite_pixels(light, mask) for light in lights.values()], axis=0)
    if not finite.all():
        known = mask & finite
        if mask.any() and not known.any():
            raise Inapplicable("no pixel of the object is finite")
        nearest = ndimage.distance_transform_edt(
            ~known, return_distances=False, return_indices=True
        )
        for name, light in lights.items():
            near = np.where(mask[..., None], light[tuple(nearest)], 0)
            lights[name] = np.where(finite[..., None], light, near)
    return replace(observation, **lights), finite


def with_gaps(filled: Observation, finite: BoolArray) -> Observation:
    """The observation with zeros in its images where they were not finite (height, width)."""
    if finite.all():
        return filled
    lights: dict[str, Any] = {
        name: np.where(finite[..., None], filled.require(name), 0) for name in _LIGHTS
    }
    return replace(filled, **lights)


def polarised_on_mask(
    filled: Observation,
    specular_model: LobeModel,
    diffuse_model: LobeModel | None,
    finite: BoolArray,
) -> Components:
    """Components of both lobes on the mask; off it the image is unpolarised.

    What was not `finite` (height, width) is not valid.
    """
    polarised = from_lobes(filled, specular_model, diffuse_model)
    assert polarised.valid is not None
    inside = filled.mask[..., None]
    s1, s2 = (np.where(inside, values, 0) for values in (polarised.s1, polarised.s2))
    return Components(filled.image, s1, s2, polarised.valid & finite)


def require_distant(observation: Observation) -> None:
    """Raise Inapplicable for a given light that is not one distant one."""
    light = observation.light
    if light is not None and not isinstance(light, Distant):
        raise Inapplicable(
            f"needs one distant light or none given, found {light.kind}: shading tells no shape"
        )


def light_of(
    observation: Observation, refuse: bool = True
) -> tuple[Float64Array, float | None, tuple[str, ...]]:
    """Direction (3,) of the light, its irradiance if given, and what was assumed, in words.

    Without `refuse` the best direction is taken, and told of, where none explains the shading.
    """
    light = observation.light
    if isinstance(light, Distant):
        return np.array(light.direction), light.irradiance, ()
    pixels, normals = _shaded(observation)
    but = ""
    try:
        direction = estimate_direction(pixels, normals)
    except Inapplicable as reason:
        if refuse or not pixels.any():
            raise
        direction, but = estimate_direction(pixels, normals, refuse=False), f", but {reason}"
    incidence = np.degrees(np.arccos(np.clip(direction[2], -1.0, 1.0)))
    return direction, None, (f"one distant light, estimated {incidence:.0f}° from the viewer{but}",)


def _shaded(observation: Observation) -> tuple[Float64Array, Float64Array]:
    """Radiances (n,) and normals (n, 3), those of the outline where none are given."""
    if observation.normals is None:
        reduced = reduce(observation.image, observation.mask, None, 48)
        components = outline_of(reduced.mask).inflated()
        n_z = np.sqrt(np.clip(1.0 - (components**2).sum(axis=1), 0.0, None))
        return reduced.total, np.column_stack([components, n_z])
    pixels, normals = _sampled(observation, observation.normals)
    return pixels.mean(axis=1), normals


def mean_or_none(value: float | NumberArray | None, mask: BoolArray) -> float | None:
    """Mean of a given value, or of a map on the mask; Inapplicable for complex indices."""
    if value is None:
        return None
    if np.iscomplexobj(value):
        raise Inapplicable("needs a dielectric, found a complex index")
    given = np.asarray(value)
    if given.ndim < 2:
        return float(given.mean())
    if not mask.any():
        raise Inapplicable("the mask has no pixel")
    return float(given[mask].mean())


def _sampled(observation: Observation, normals: Image) -> tuple[Float64Array, Float64Array]:
    """Radiances (n, bands) and unit normals (n, 3) of the object's pixels, or of a sample."""
    length = np.linalg.norm(normals, axis=-1)
    chosen = np.flatnonzero(observation.mask & (length > 0.5) & np.isfinite(length))
    chosen = chosen[:: max(1, len(chosen) // _SAMPLE)]
    if not len(chosen):
        raise Inapplicable("no pixel of the mask has a normal")
    pixels = observation.image.reshape(-1, observation.image.shape[-1])[chosen]
    unit = normals.reshape(-1, 3)[chosen].astype(np.float64)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return pixels.astype(np.float64), unit


def parameters_of(
    observation: Observation, normals: Image, direction: Float64Array, given: GivenParameters
) -> SurfaceParameters:
    """Surface parameters for given normals, with the given body or that of smaller error."""
    pixels, unit = _sampled(observation, normals)
    bodies = get_args(BodyKind) if given.body is None else (given.body,)
    fits = [
        fit_parameters(pixels, unit, direction, body, given.irradiance, given.eta, given.alpha)
        for body in bodies
    ]
    return min(fits, key=lambda fit: fit.error)


def specular_by_model(
    observation: Observation, normals: Image, direction: Float64Array, parameters: SurfaceParameters
) -> Image:
    """I_s (height, width, bands): the image times the specular share of the fitted model."""
    mask = observation.mask
    unit = normals[mask].astype(np.float64)
    specular = np.outer(specular_shading(unit, direction, parameters.alpha), parameters.level)
    white_diffuse = diffuse_shading(unit, direction, parameters.body, parameters.eta)
    total = specular + np.outer(white_diffuse, parameters.albedo)
    share = np.divide(specular, total, out=np.zeros_like(total), where=total > 0)
    result = np.zeros_like(observation.image)
    result[mask] = np.maximum(observation.image[mask], 0) * share
    return result
