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
from malus.reconstruct.single_image.light_direction import estimate_direction, mean_direction
from malus.reconstruct.single_image.outline import outline_of
from malus.reconstruct.single_image.parameters import SurfaceParameters, fit_parameters
from malus.reconstruct.single_image.reduced import reduce
from malus.reconstruct.single_image.shading import BodyKind, diffuse_shading, specular_shading
from malus.reconstruct.single_image.shape import (
    GivenParameters,
    RecoveredShape,
    recover_shape,
)
from malus.reconstruct.single_image.value_range import finite_pixels
from malus.scenes.core.arrays import BoolArray, Float64Array, IndexArray, NumberArray
from malus.scenes.lights.lights import Distant
from malus.scenes.polarisation import image_frame, viewing_frame

_SAMPLE = 8_000
"""Pixels that parameters are fitted to, or up to twice as many: five numbers need no more."""


_STEEP = 1e-6
"""Distance of a line of sight from the image's y axis below which a pixel has no horizontal."""

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
    pixels, normals, views = _shaded(observation)
    but = ""
    try:
        direction = estimate_direction(pixels, normals, view_direction=views)
    except Inapplicable as reason:
        if refuse or not pixels.any():
            raise
        direction = estimate_direction(pixels, normals, refuse=False, view_direction=views)
        but = f", but {reason}"
    middle = _middle(observation)
    if observation.normals is None and middle is not None:
        direction = np.asarray(image_frame(direction, middle), np.float64)
    toward = direction[2] if middle is None else direction @ middle
    incidence = np.degrees(np.arccos(np.clip(toward, -1.0, 1.0)))
    return direction, None, (f"one distant light, estimated {incidence:.0f}° from the viewer{but}",)


def shape_of(
    observation: Observation,
    direction: Float64Array,
    given: GivenParameters,
    specular: Image | None,
    refuse: bool = True,
) -> RecoveredShape:
    """The shape that `recover_shape` finds of an object, through a perspective camera too.

    At an outline the line of sight grazes the surface, through any camera: normals are found
    relative to it, under the light as it falls for the pixel in the object's middle.
    """
    views, middle = observation.view_direction, _middle(observation)
    _, seen = _in_frames(direction, direction, middle)
    shape = recover_shape(observation.image, observation.mask, seen, given, specular, refuse=refuse)
    if views is None:
        return shape
    normals = np.where(observation.mask[..., None], image_frame(shape.normals, views), 0)
    return replace(shape, normals=normals.astype(shape.normals.dtype))


def _middle(observation: Observation) -> Float64Array | None:
    """Mean direction (3,) from the object to a perspective camera; None for an orthographic one."""
    if observation.view_direction is None:
        return None
    return mean_direction(observation.view_direction[observation.mask].astype(np.float64))


def _shaded(observation: Observation) -> tuple[Float64Array, Float64Array, Float64Array | None]:
    """Radiances (n,), normals (n, 3), those of the outline where none are given, and views (n, 3).

    Views are the directions to a perspective camera; of the outline's normals there are none.
    """
    if observation.normals is None:
        reduced = reduce(observation.image, observation.mask, None, 48)
        components = outline_of(reduced.mask).inflated()
        n_z = np.sqrt(np.clip(1.0 - (components**2).sum(axis=1), 0.0, None))
        return reduced.total, np.column_stack([components, n_z]), None
    chosen = _sample(observation, observation.normals)
    pixels = observation.image.reshape(-1, observation.image.shape[-1])[chosen]
    normals, views = _unit(observation.normals, chosen), _views(observation, chosen)
    return pixels.astype(np.float64).mean(axis=1), normals, views


def mean_or_none(value: float | NumberArray | None, mask: BoolArray) -> float | None:
    """Mean of a given value, or of a map on the mask; Inapplicable for an object of metal."""
    if value is None:
        return None
    given = np.asarray(value)
    if given.ndim > 1:
        if not mask.any():
            raise Inapplicable("the mask has no pixel")
        given = given[mask]
    if np.any(given.imag):
        raise Inapplicable("needs a dielectric, found a complex index")
    return float(given.real.mean())


def _sample(observation: Observation, normals: Image) -> IndexArray:
    """Flat indices (n,) of the pixels that have a normal and a line of sight, or of a sample."""
    length = np.linalg.norm(normals, axis=-1)
    usable = observation.mask & (length > 0.5) & np.isfinite(length)
    if observation.view_direction is not None:
        usable &= np.hypot(*np.moveaxis(observation.view_direction, -1, 0)[[0, 2]]) > _STEEP
    chosen = np.flatnonzero(usable)
    if not len(chosen):
        raise Inapplicable("no pixel of the mask has a normal")
    return chosen[:: max(1, len(chosen) // _SAMPLE)]


def _unit(vectors: Image, chosen: IndexArray) -> Float64Array:
    """Vectors (n, 3) at flat indices of an image, of length one."""
    flat = vectors.reshape(-1, 3)[chosen].astype(np.float64)
    return np.asarray(flat / np.linalg.norm(flat, axis=1, keepdims=True))


def _views(observation: Observation, chosen: IndexArray) -> Float64Array | None:
    """Unit vectors (n, 3) to a perspective camera; None for an orthographic one."""
    views = observation.view_direction
    return None if views is None else _unit(views, chosen)


def _in_frames(
    normals: Float64Array, direction: Float64Array, views: Float64Array | None
) -> tuple[Float64Array, Float64Array]:
    """Normals (n, 3), and the light's direction (3,), in the frame of each pixel."""
    if views is None:
        return normals, direction
    turned_normals, toward = viewing_frame(normals, views), viewing_frame(direction, views)
    return np.asarray(turned_normals, np.float64), np.asarray(toward, np.float64)


def parameters_of(
    observation: Observation, normals: Image, direction: Float64Array, given: GivenParameters
) -> SurfaceParameters:
    """Surface parameters for given normals, with the given body or that of smaller error."""
    chosen = _sample(observation, normals)
    pixels = observation.image.reshape(-1, observation.image.shape[-1])[chosen].astype(np.float64)
    seen = _in_frames(_unit(normals, chosen), direction, _views(observation, chosen))
    bodies = get_args(BodyKind) if given.body is None else (given.body,)
    fits = [
        fit_parameters(pixels, *seen, body, given.irradiance, given.eta, given.alpha)
        for body in bodies
    ]
    return min(fits, key=lambda fit: fit.error)


def specular_by_model(
    observation: Observation, normals: Image, direction: Float64Array, parameters: SurfaceParameters
) -> Image:
    """I_s (height, width, bands): the image times the specular share of the fitted model."""
    mask = observation.mask
    views = _views(observation, np.flatnonzero(mask))
    unit, seen = _in_frames(normals[mask].astype(np.float64), direction, views)
    specular = np.outer(specular_shading(unit, seen, parameters.alpha), parameters.level)
    white_diffuse = diffuse_shading(unit, seen, parameters.body, parameters.eta)
    total = specular + np.outer(white_diffuse, parameters.albedo)
    share = np.divide(specular, total, out=np.zeros_like(total), where=total > 0)
    result = np.zeros_like(observation.image)
    result[mask] = np.maximum(observation.image[mask], 0) * share
    return result
