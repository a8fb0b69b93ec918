"""The ladder of knowledge: a method's inputs are replaced by estimates, one after another.

Every rung replaces one input more by what the chain for one ordinary image
(`malus.reconstruct.single_image.blind`) estimates without it, down to the picture alone.
Estimates come from the picture as rendered and are kept for the picture with a draw of the noise:
the noise of a rung is what the method itself makes of that draw.

A method that is a chain of its own climbs: it starts from the picture alone, and every rung gives
it one input more in place of its own estimate (`climbing`). The paper's chain with all of them is
`eq8`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from malus.bench.scoring.masked_pixels import MaskedPixels
from malus.bench.scoring.observe import observe
from malus.reconstruct import Inapplicable, Method, Observation
from malus.reconstruct.observation import INPUTS

EVERYTHING = "everything"
RUNGS: dict[str, frozenset[str]] = {
    "lobes estimated": frozenset({"specular", "diffuse"}),
    "normals estimated": frozenset({"normals"}),
    "index and roughness estimated": frozenset({"eta", "alpha", "distribution"}),
    "light estimated": frozenset({"light"}),
}
"""Inputs that become estimates at each rung, besides those of the rungs before."""

GIVEN_RUNGS: dict[str, frozenset[str]] = {
    "illuminant given": frozenset({"illuminant"}),
    "light given": frozenset({"light"}),
    "lobes given": frozenset({"specular", "diffuse"}),
    "normals given": frozenset({"normals"}),
    "index and roughness given": frozenset({"eta", "alpha"}),
}
"""Inputs that a chain is given at each rung, besides those of the rungs before."""


def climbing(method: Method) -> Iterator[tuple[str, Method]]:
    """The same method at every rung above the picture alone, with the needs that it has there.

    Only of a method with `optional` inputs; the last rung has all of them.

    Yields
    ------
    (name of the rung, Method)

    Examples
    --------
    >>> from malus.reconstruct import get_method
    >>> [name for name, _ in climbing(get_method("paper"))][-1], list(climbing(get_method("eq8")))
    ('index and roughness given', [])
    """
    given = method.needs
    for name, inputs in GIVEN_RUNGS.items():
        if inputs <= method.optional:
            given |= inputs
            yield name, replace(method, needs=given)


def rungs(pixels: MaskedPixels) -> Iterator[tuple[str, Observation | Inapplicable]]:
    """Observation at every rung below `EVERYTHING`, or why the chain estimates nothing.

    Yields
    ------
    (name of the rung, Observation as `MaskedPixels.observation` is, or the reason)

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=24))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> name, observation = next(rungs(MaskedPixels.of(truth)))
    >>> name, observation.alpha
    ('lobes estimated', 0.3)
    """
    estimated: frozenset[str] = frozenset()
    for name, inputs in RUNGS.items():
        estimated |= inputs
        try:
            yield name, _with_estimates(pixels, estimated)
        except Inapplicable as reason:
            yield name, reason


def _with_estimates(pixels: MaskedPixels, names: frozenset[str]) -> Observation:
    """The observation of the masked pixels, with estimates of the chain in place of `names`."""
    # With it comes SciPy's optimisation, which a run without the ladder needs not wait for.
    from malus.reconstruct.single_image.blind import run_chain

    truth, observation = pixels.truth, pixels.observation
    estimates = run_chain(observe(truth, INPUTS - names)).observation
    picture = truth.image[truth.mask]
    specular = estimates.require("specular")[truth.mask]
    fraction = np.divide(specular, picture, out=np.zeros_like(picture), where=picture > 0)
    specular = (observation.image * np.clip(fraction, 0.0, 1.0)).astype(observation.image.dtype)
    observation = replace(observation, specular=specular, diffuse=observation.image - specular)
    if "normals" in names:
        normals = estimates.require("normals")[truth.mask].astype(observation.image.dtype)
        observation = replace(observation, normals=np.stack([normals, normals]))
    others = names & {"eta", "alpha", "distribution", "light"}
    return replace(observation, **{name: getattr(estimates, name) for name in others})
