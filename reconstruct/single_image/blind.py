"""The whole chain from one ordinary picture: light, separation, shape, parameters, polarisation.

What is not given is estimated. The order is that of the paper's pipeline; the physics at its end is
the best known for one distant light: specular light is polarised by the facets that mirror it, at
the half vector, and diffuse light by the surface that it crossed, if its shading shows that it
crossed one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from malus.reconstruct import lobe_models as lobes
from malus.reconstruct.observation import Components, Image, Inapplicable, Observation
from malus.reconstruct.single_image.chain_stages import (
    light_of,
    mean_or_none,
    parameters_of,
    polarised_on_mask,
    require_distant,
    shape_of,
    specular_by_model,
    with_gaps,
    without_gaps,
)
from malus.reconstruct.single_image.convergence import Convergence
from malus.reconstruct.single_image.illuminant import specular_tint
from malus.reconstruct.single_image.separation import check_separation, separate
from malus.reconstruct.single_image.shading import BodyKind
from malus.reconstruct.single_image.shape import GivenParameters
from malus.scenes import polarisation
from malus.scenes.core.arrays import BoolArray
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.errors import check_kind
from malus.scenes.lights.lights import Distant


@dataclass(frozen=True)
class ChainResult:
    """Everything that `run_chain` estimated from one picture.

    Attributes
    ----------
    observation : Observation
        The picture with lobes, normals, eta, alpha and light filled in as estimated.
    body : 'unpolarised' or 'polarised'
        What the surface's body was taken for.
    components : Components
        The polarisation components, (height, width, bands).
    convergence : Convergence or None
        How the search for a shape ended; None where the normals were given.
    statements : tuple of str
        What was assumed, found, or failed, stage by stage.

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=16))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> result = run_chain(Observation(truth.image, truth.mask, normals=truth.normals,
    ...                                light=scene.light))
    >>> result.convergence is None, result.statements[-1], result.warnings
    (True, 'body taken for unpolarised', ())
    """

    __repr__ = brief_repr

    observation: Observation
    body: BodyKind
    components: Components
    convergence: Convergence | None
    statements: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the estimate, in words; empty where there are none."""
        return self.convergence.warnings if self.convergence else ()


def blind(observation: Observation) -> Components:
    """Polarisation components from one picture and its mask, and light and normals if given.

    Parameters
    ----------
    observation : Observation
        `image` (height, width, bands) in linear radiance under white light, and `mask`. A distant
        `light` in the image frame, `normals`, `eta` and `alpha` are used where they are given, and
        estimated where they are not; `eta` only with the irradiance of a given light, and taken
        for 1.5 without.

    Returns
    -------
    Components
        (height, width, bands), in the unit of the image.

    Raises
    ------
    Inapplicable
        If a stage fails: dark or grey where it must not be, no outline, another light than one
        distant one, a metal, or no shape that explains the picture.

    Notes
    -----
    The pipeline of Gu et al., "Reconstructing Polarisation Components from Unpolarised Images",
    up to Equations 11 and 12; for polarisation see `malus.reconstruct.lobe_models`.

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=32))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> observation = Observation(image=truth.image, mask=truth.mask, light=scene.light)
    >>> blind(observation).i_max.shape
    (32, 32, 1)
    """
    return run_chain(observation).components


def run_chain(
    observation: Observation, calibrated: bool = True, separation: str = "ratio"
) -> ChainResult:
    """Estimate polarisation, and all that it follows from, from one picture.

    Lobes, light, normals, index, roughness and kind of body come with the components of `blind`.

    Parameters
    ----------
    observation : Observation
        As for `blind`.
    calibrated : bool
        False where the irradiance of a given light (W m⁻² nm⁻¹) says nothing about the radiances of
        the image, as in an ordinary photograph, whose values have no unit. η must then be given, or
        is assumed.
    separation : str
        How the lobes are separated by colour: one of `separations()`.

    Returns
    -------
    ChainResult
        Images are (height, width, bands), normals (height, width, 3).

    Raises
    ------
    Inapplicable
        As `blind` does.
    InputError
        If there is no such separation.

    Notes
    -----
    Stages and sources: `separate`, `estimate_direction` (Brooks and Horn 1985), `recover_shape`
    (Huynh and Robles-Kelly 2009), `fit_parameters`.

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=32))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> result = run_chain(Observation(truth.image, truth.mask, normals=truth.normals,
    ...                                light=scene.light))
    >>> round(float(result.observation.eta.mean()), 2), result.body
    (1.5, 'unpolarised')
    """
    check_separation(separation, "separation")
    check_kind("observation", observation, Observation, "give malus.Observation(image, mask)")
    require_distant(observation)
    observation, finite = without_gaps(observation)
    specular, separation_statements = _by_colour(observation, separation)
    direction, irradiance, shape_statements = light_of(observation)
    irradiance = irradiance if calibrated else None
    eta, alpha = (mean_or_none(v, observation.mask) for v in (observation.eta, observation.alpha))
    given = GivenParameters(irradiance, eta, alpha)
    if observation.normals is None:
        shape = shape_of(observation, direction, given, specular)
        normals, parameters, convergence = shape.normals, shape.parameters, shape.convergence
        shape_statements = (*shape_statements, convergence.statement)
    else:
        normals, convergence = observation.normals, None
        parameters = parameters_of(observation, normals, direction, given)
    body = f"body taken for {parameters.body}"
    statements = (*separation_statements, *shape_statements, body, *parameters.notes)
    if specular is None:
        specular = specular_by_model(observation, normals, direction, parameters)
    filled = replace(
        observation,
        specular=specular,
        diffuse=np.where(observation.mask[..., None], observation.image, 0) - specular,
        normals=normals,
        eta=np.full(len(parameters.albedo), parameters.eta) if eta is None else observation.eta,
        alpha=parameters.alpha if alpha is None else observation.alpha,
        light=Distant.towards(direction, math.pi if irradiance is None else irradiance),
    )
    filled = with_gaps(filled, finite)
    diffuse_model = lobes.diffuse if parameters.body == "polarised" else None
    components = polarised_on_mask(filled, lobes.half_vector, diffuse_model, finite)
    if convergence is not None:
        components = _with_convergence(components, convergence, observation.mask)
    return ChainResult(filled, parameters.body, components, convergence, statements)


def _by_colour(observation: Observation, separation: str) -> tuple[Image | None, tuple[str, ...]]:
    """I_s separated by colour, or None where the picture is grey; how, in words."""
    bands = observation.wavelengths_nm
    tint = specular_tint(bands) if bands is not None and len(bands) > 1 else None
    try:
        parts = separate(observation.image, observation.mask, method=separation, tint=tint)
    except Inapplicable as reason:
        return None, (f"separated by the fitted model, not by colour: {reason}",)
    return parts.specular, ("separated by colour, under white light",)


def _with_convergence(
    components: Components, convergence: Convergence, mask: BoolArray
) -> Components:
    """The components with what the search for a shape says of their error."""
    stated = convergence.deviation(polarisation.dolp(components.stokes))
    deviation = np.where(mask[..., None], stated, 0)
    return replace(components, converged=convergence.converged, deviation=deviation)


BLIND_METHODS: tuple[tuple[str, frozenset[str], Callable[[Observation], Components], str], ...] = (
    ("blind", frozenset(), blind, "everything from one picture and the object's mask"),
    ("blind-light", frozenset({"light"}), blind, "blind, but the distant light is known"),
    (
        "blind-normals",
        frozenset({"light", "normals"}),
        blind,
        "blind, but the distant light and the normals are known",
    ),
)
"""Name, needs, function and summary of each method; `malus.reconstruct.methods` declares them."""
