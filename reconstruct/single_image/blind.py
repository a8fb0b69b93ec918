"""The whole chain from one ordinary picture: light, separation, shape, parameters, polarisation.

What is not given is estimated. The order is that of the paper's pipeline; the physics at its end is
the best known for one distant light: mirrored light is polarised by the facets that mirror it, at
the half vector, and light of the body by the interface that it crossed, if its shading says that it
crossed one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct import lobe_models as lobes
from malus.reconstruct.image import from_lobes
from malus.reconstruct.observation import Components, Image, Inapplicable, Observation
from malus.reconstruct.single_image.convergence import Convergence
from malus.reconstruct.single_image.illuminant import specular_tint
from malus.reconstruct.single_image.light_direction import estimate_direction
from malus.reconstruct.single_image.outline import outline_of
from malus.reconstruct.single_image.parameters import Parameters, fit_parameters
from malus.reconstruct.single_image.reduced import reduce
from malus.reconstruct.single_image.separation import separate
from malus.reconstruct.single_image.shading import BodyKind, diffuse_shading, specular_shading
from malus.reconstruct.single_image.shape import Known, recover_shape
from malus.scenes.lights.lights import Distant

Floats = NDArray[np.float64]

_SAMPLE = 8_000
"""Pixels that parameters are fitted to: five numbers need no more."""


@dataclass(frozen=True)
class Chain:
    """What the chain found on its way, for those who want to know why.

    Attributes
    ----------
    observation : Observation
        The picture with everything filled in that was estimated.
    body : 'unpolarised' or 'polarised'
    components : Components
    convergence : Convergence or None
        How the search for a shape ended; None where the normals were given.
    statements : tuple of str
        What was assumed, found, or failed, stage by stage.
    """

    observation: Observation
    body: BodyKind
    components: Components
    convergence: Convergence | None
    statements: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Why not to believe it, in words; empty where nothing speaks against it."""
        return self.convergence.warnings if self.convergence else ()


def blind(observation: Observation) -> Components:
    """Polarisation components from one picture and its mask; a light and normals if they are known.

    Raises
    ------
    Inapplicable
        If a stage fails: dark or grey where it must not be, no outline, another light than one
        distant one, a metal, or no shape that explains the picture.

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=32))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> seen = Observation(image=truth.image, mask=truth.mask, light=scene.light)
    >>> blind(seen).i_max.shape
    (32, 32, 1)
    """
    return run_chain(observation).components


def run_chain(
    observation: Observation, calibrated: bool = True, separation: str = "ratio"
) -> Chain:
    """The same as `blind`, with everything that was found on the way; raises the same.

    Radiances of an ordinary photograph have no unit: `calibrated` is False where the irradiance
    of a given light says nothing about them, and then η must be given or is assumed. `separation`
    names one of `SEPARATIONS`.
    """
    _require_light(observation)
    specular, statements = _by_colour(observation, separation)
    direction, irradiance, said = _light(observation)
    irradiance = irradiance if calibrated else None
    known = Known(irradiance, _mean_or_none(observation.eta), _mean_or_none(observation.alpha))
    if observation.normals is None:
        shape = recover_shape(observation.image, observation.mask, direction, known, specular)
        normals, parameters, convergence = shape.normals, shape.parameters, shape.convergence
        said = (*said, convergence.statement)
    else:
        normals, convergence = observation.normals, None
        parameters = _parameters(observation, normals, direction, known)
    body = f"body taken for {parameters.body}"
    statements = (*statements, *said, body, *parameters.notes)
    if specular is None:
        specular = _by_model(observation, normals, direction, parameters)
    filled = replace(
        observation,
        specular=specular,
        diffuse=np.where(observation.mask[..., None], observation.image, 0) - specular,
        normals=normals,
        eta=np.full(observation.image.shape[-1], parameters.eta),
        alpha=parameters.alpha,
        light=Distant.towards(direction, math.pi if irradiance is None else irradiance),
    )
    components = _polarised(filled, parameters.body)
    if convergence is not None:
        components = replace(components, converged=convergence.converged)
    return Chain(filled, parameters.body, components, convergence, statements)


def _require_light(observation: Observation) -> None:
    light = observation.light
    if light is not None and not isinstance(light, Distant):
        raise Inapplicable(
            f"needs one distant light or none given, found {light.kind}: shading tells no shape"
        )


def _by_colour(observation: Observation, separation: str) -> tuple[Image | None, tuple[str, ...]]:
    """I_s by colour where the picture has any, otherwise None and the reason."""
    bands = observation.wavelengths_nm
    tint = specular_tint(bands) if bands is not None and len(bands) > 1 else None
    try:
        parts = separate(observation.image, observation.mask, method=separation, tint=tint)
    except Inapplicable as reason:
        return None, (f"separated by the fitted model, not by colour: {reason}",)
    return parts.specular, ("separated by colour, under white light",)


def _light(observation: Observation) -> tuple[Floats, float | None, tuple[str, ...]]:
    """Direction, irradiance if it is known, and what was assumed."""
    light = observation.light
    if isinstance(light, Distant):
        return np.array(light.direction), light.irradiance, ()
    if observation.normals is None:
        reduced = reduce(observation.image, observation.mask, None, 48)
        components = outline_of(reduced.mask).inflated()
        n_z = np.sqrt(np.clip(1.0 - (components**2).sum(axis=1), 0.0, None))
        direction = estimate_direction(reduced.total, np.column_stack([components, n_z]))
    else:
        pixels, normals = _sampled(observation, observation.normals)
        direction = estimate_direction(pixels.mean(axis=1), normals)
    incidence = np.degrees(np.arccos(np.clip(direction[2], -1.0, 1.0)))
    return direction, None, (f"one distant light, estimated {incidence:.0f}° from the viewer",)


def _mean_or_none(value: float | NDArray[np.inexact[Any]] | None) -> float | None:
    if value is None:
        return None
    if np.iscomplexobj(value):
        raise Inapplicable("needs a dielectric, found a complex index")
    return float(np.mean(value))


def _sampled(observation: Observation, normals: Image) -> tuple[Floats, Floats]:
    """Radiances (n, bands) and unit normals (n, 3) of at most `_SAMPLE` of the object's pixels."""
    length = np.linalg.norm(normals, axis=-1)
    chosen = np.flatnonzero(observation.mask & (length > 0.5))
    chosen = chosen[:: max(1, len(chosen) // _SAMPLE)]
    if not len(chosen):
        raise Inapplicable("no pixel of the mask has a normal")
    pixels = observation.image.reshape(-1, observation.image.shape[-1])[chosen]
    unit = normals.reshape(-1, 3)[chosen].astype(np.float64)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return pixels.astype(np.float64), unit


def _parameters(
    observation: Observation, normals: Image, direction: Floats, known: Known
) -> Parameters:
    """Parameters for given normals; the kind of body is the one that leaves less unexplained."""
    pixels, unit = _sampled(observation, normals)
    fits = [
        fit_parameters(pixels, unit, direction, body, known.irradiance, known.eta, known.alpha)
        for body in get_args(BodyKind)
    ]
    return min(fits, key=lambda fit: fit.error)


def _by_model(
    observation: Observation, normals: Image, direction: Floats, found: Parameters
) -> Image:
    """I_s as the fitted model's share of mirrored light in what was seen."""
    mask = observation.mask
    unit = normals[mask].astype(np.float64)
    mirrored = np.outer(specular_shading(unit, direction, found.alpha), found.level)
    body = np.outer(diffuse_shading(unit, direction, found.body, found.eta), found.albedo)
    total = mirrored + body
    share = np.divide(mirrored, total, out=np.zeros_like(total), where=total > 0)
    specular = np.zeros_like(observation.image)
    specular[mask] = np.maximum(observation.image[mask], 0) * share
    return specular


def _polarised(filled: Observation, body: BodyKind) -> Components:
    """Both lobes polarised on the mask, by the half vector and by the interface; else as seen."""
    found = from_lobes(filled, lobes.half_vector, lobes.body if body == "polarised" else None)
    inside = filled.mask[..., None]
    return Components(
        filled.image, np.where(inside, found.s1, 0), np.where(inside, found.s2, 0), found.valid
    )


BLIND: tuple[tuple[str, frozenset[str], Callable[[Observation], Components], str], ...] = (
    ("blind", frozenset(), blind, "everything from one picture and the object's mask"),
    ("blind-light", frozenset({"light"}), blind, "blind, but the distant light is known"),
    (
        "blind-normals",
        frozenset({"light", "normals"}),
        blind,
        "blind, but the distant light and the normals are known",
    ),
)
"""Name, needs, function and summary of each declaration in `malus.reconstruct.methods`."""
