"""The paper's pipeline for one ordinary picture, stage by stage as it is printed (Section IV).

Gu, Huynh and Robles-Kelly, "Reconstructing Polarisation Components from Unpolarised Images". What
the paper leaves open is decided here, once:

* Illuminant. "A method such as Gray World [23]": the mean of every band over the whole picture, for
  the assumption is about the scene, not about the object; one colour for a picture.
* I_d and I_s. The maximum chromaticity-intensity space [18] (`paper`) or partial differential
  equations in SUV space (`paper-mallick`, the paper's [19]), on the picture divided by that
  colour, which both methods take for known. A picture that is grey then cannot be separated by
  colour: its lobes are the shares of the dichromatic model that the next stage fits.
* Normals, η and σ "from a single image [17]": `recover_shape`, which stands for the method of Huynh
  and Robles-Kelly (2009). It takes the body for Lambertian, as the paper does, and one distant
  light, whose direction is estimated. There is one η and one σ = 1/α² for an object and all its
  bands, and η is assumed (1.5) where nobody tells the light's irradiance, without which no picture
  shows it. The paper's chain refuses no picture: the best light and the best smooth shape are used
  also where they do not explain it, and a warning says so.
* R. Equation 8 as printed (measure dr dφ), over the facets that the viewer sees.
* I_max, I_min. Equations 7 and 9 to 12; diffuse light is unpolarised.
* ψ. The azimuth of the normal.
* Off the mask nothing is estimated: light there is left unpolarised. Several objects in one picture
  are estimated one by one.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from malus.reconstruct.lobe_models import microfacets
from malus.reconstruct.observation import Components, Image, Inapplicable, Observation
from malus.reconstruct.single_image.blind import ChainResult
from malus.reconstruct.single_image.chain_stages import (
    light_of,
    mean_or_none,
    parameters_of,
    polarised_on_mask,
    shape_of,
    specular_by_model,
    with_gaps,
    without_gaps,
)
from malus.reconstruct.single_image.convergence import Convergence
from malus.reconstruct.single_image.illuminant import gray_world
from malus.reconstruct.single_image.parameters import SurfaceParameters
from malus.reconstruct.single_image.separation import SEPARATIONS, check_separation, separate
from malus.reconstruct.single_image.shape import GivenParameters
from malus.scenes.core.arrays import Float64Array, NumberArray
from malus.scenes.core.errors import InputError, check_kind
from malus.scenes.lights.lights import Distant, Light

STAGES = frozenset({"illuminant", "specular", "diffuse", "normals", "eta", "alpha", "light"})
"""Attributes of an Observation that replace the estimates of a stage where they are given."""

TAN, MALLICK = "chromaticity", "suv"
"""The paper's separations, its references 18 and 19, by the names of `separations`."""


def run_paper(
    observation: Observation, separation: str = TAN, calibrated: bool = True
) -> ChainResult:
    """Run the paper's chain from one picture to its polarisation, and tell what each stage found.

    Parameters
    ----------
    observation : Observation
        `image` (height, width, bands) in linear radiance, and `mask`. Of `illuminant`, `specular`
        and `diffuse`, `normals`, `eta`, `alpha` and `light`, those that are given replace the stage
        that estimates them; of a `light`, one distant one.
    separation : str
        One of `separations()`: the paper's are 'chromaticity' (Tan et al.) and 'suv' (Mallick et
        al.).
    calibrated : bool
        False where the irradiance of a given light says nothing about the values of the image.

    Returns
    -------
    ChainResult
        Images are (height, width, bands), normals (height, width, 3); `statements` tell what was
        found.

    Raises
    ------
    Inapplicable
        If a stage has nothing to work on: a dark picture, no outline, no pixel with a normal.
    InputError
        If there is no such separation, or `illuminant` has values that are not above 0.

    Notes
    -----
    The stages of Section IV, Equations 7 to 12; the text at the top of
    `malus.reconstruct.single_image.paper` says what the paper leaves open and how it is decided.

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=80), camera=Camera(resolution=24))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> result = run_paper(Observation(truth.image, truth.mask))
    >>> result.statements[1].split(":")[0]
    'separated by the fitted model, not by colour'
    """
    check_separation(separation, "separation")
    check_kind("observation", observation, Observation, "give malus.Observation(image, mask)")
    colour, about_colour = _illuminant(observation)
    observation, finite = without_gaps(observation)
    specular, about_lobes = _lobes(observation, colour, separation)
    balanced = replace(
        observation,
        image=np.maximum(observation.image, 0) / colour,
        light=observation.light if isinstance(observation.light, Distant) else None,
    )
    geometry = _geometry(balanced, None if specular is None else specular / colour, calibrated)
    if specular is None:
        specular = geometry.specular(observation)
    diffuse = np.where(observation.mask[..., None], observation.image, 0) - specular
    filled = replace(
        observation,
        specular=specular,
        diffuse=diffuse if observation.diffuse is None else observation.diffuse,
        normals=geometry.normals,
        eta=geometry.eta,
        alpha=geometry.alpha,
        light=geometry.light,
        illuminant=colour,
    )
    filled = with_gaps(filled, finite)
    found = (_share(filled), *geometry.statements)
    components = polarised_on_mask(filled, microfacets("eq8"), None, finite)  # Equations 8 to 12
    if geometry.convergence is not None:
        components = replace(components, converged=geometry.convergence.converged)
    statements = (*about_colour, *about_lobes, *found)
    return ChainResult(filled, "unpolarised", components, geometry.convergence, statements)


def paper(observation: Observation, separation: str = TAN) -> Components:
    """Polarisation components by the paper's own chain, from one picture and its mask.

    Parameters
    ----------
    observation, separation
        As for `run_paper`, which also tells what each stage found.

    Returns
    -------
    Components
        (height, width, bands), in the unit of the image.

    Raises
    ------
    Inapplicable, InputError
        As `run_paper` does.

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=80), camera=Camera(resolution=24))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> paper(Observation(truth.image, truth.mask)).i_max.shape
    (24, 24, 1)
    """
    return run_paper(observation, separation).components


class _Geometry(NamedTuple):
    """Normals, index, roughness and light of one object; `fit` is None where all were given."""

    normals: Image
    eta: NumberArray
    alpha: float | Image
    light: Light | None
    fit: SurfaceParameters | None = None
    convergence: Convergence | None = None
    statements: tuple[str, ...] = ()

    def specular(self, observation: Observation) -> Image:
        """I_s as the share of specular light in the fitted model."""
        assert self.fit is not None
        assert isinstance(self.light, Distant)
        direction = np.array(self.light.direction)
        return specular_by_model(observation, self.normals, direction, self.fit)


def _illuminant(observation: Observation) -> tuple[Float64Array, tuple[str, ...]]:
    """Colour (bands,) of the light, mean 1, and how it is known, in words."""
    if observation.illuminant is not None:
        given = np.asarray(observation.illuminant, dtype=np.float64)
        if not np.all(np.isfinite(given) & (given > 0)):
            hint = "give the light's colour by band, in any unit"
            raise InputError("illuminant", "values above 0", f"{given.tolist()}", hint)
        return given / given.mean(), ("light's colour as given",)
    colour, assumption = gray_world(observation.image)
    values = " ".join(f"{value:.2f}" for value in colour)
    return colour, (f"light's colour by Gray World {values}: {assumption}",)


def _lobes(
    observation: Observation, colour: Float64Array, separation: str
) -> tuple[Image | None, tuple[str, ...]]:
    """I_s (height, width, bands), or None for a grey picture; how it was found, in words."""
    if observation.specular is not None:
        return observation.specular, ("lobes as given",)
    try:
        parts = separate(observation.image, observation.mask, colour, separation)
    except Inapplicable as reason:
        return None, (f"separated by the fitted model, not by colour: {reason}",)
    return parts.specular, (f"separated by colour: {SEPARATIONS[separation].summary}",)


def _geometry(balanced: Observation, specular: Image | None, calibrated: bool) -> _Geometry:
    """Stage [17] on a picture under white light: what is not given is estimated."""
    normals, eta, alpha = balanced.normals, balanced.eta, balanced.alpha
    if normals is not None and eta is not None and alpha is not None and specular is not None:
        return _Geometry(normals, eta, alpha, balanced.light)
    direction, irradiance, about_light = light_of(balanced, refuse=False)
    irradiance = irradiance if calibrated else None
    mean_eta, mean_alpha = (mean_or_none(value, balanced.mask) for value in (eta, alpha))
    given = GivenParameters(irradiance, mean_eta, mean_alpha, "unpolarised")
    convergence, about_shape = None, ("normals as given",)
    if normals is None:
        shape = shape_of(balanced, direction, given, specular, refuse=False)
        normals, fit, convergence = shape.normals, shape.parameters, shape.convergence
        about_shape = (convergence.statement,)
    else:
        fit = parameters_of(balanced, normals, direction, given)
    about_surface = f"eta {fit.eta:.2f}, alpha {fit.alpha:.2f}"
    return _Geometry(
        normals,
        np.full(balanced.image.shape[-1], fit.eta) if eta is None else eta,
        fit.alpha if alpha is None else alpha,
        Distant.towards(direction, math.pi if irradiance is None else irradiance),
        fit,
        convergence,
        (*about_light, *about_shape, about_surface, *fit.notes),
    )


def _share(filled: Observation) -> str:
    """Specular light of the object as a share of all of its light, in words."""
    inside = filled.mask
    specular, total = (
        float(np.nansum(light[inside])) for light in (filled.require("specular"), filled.image)
    )
    return f"specular light is {specular / total if total > 0 else 0.0:.1%} of the object's"


PAPER_SEPARATIONS = {"paper": TAN, "paper-mallick": MALLICK}
"""The separation that each method of this module uses."""

PAPER_METHODS: tuple[tuple[str, frozenset[str], Callable[[Observation], Components], str], ...] = (
    ("paper", frozenset(), paper, "the paper's whole chain, lobes by Tan et al., Equation 8"),
    (
        "paper-mallick",
        frozenset(),
        functools.partial(paper, separation=MALLICK),
        "the same with the lobes by Mallick et al.",
    ),
)
"""Name, needs, function and summary of each method; `malus.reconstruct.methods` declares them."""
