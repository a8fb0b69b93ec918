"""The methods that malus brings: a specular model each, with and without polarised diffuse light.

Importing this module imports all lobe models, which takes long: `methods` does so when a method is
first asked for. Methods that look at the picture as a whole import scipy too, and only then.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator

from malus.reconstruct import lobe_models as lobes
from malus.reconstruct.image import from_lobes
from malus.reconstruct.known_lights import known_lights
from malus.reconstruct.lobe_models import LobeModel
from malus.reconstruct.observation import Components, Observation

Reconstruction = Callable[[Observation], Components]

_LOBES = frozenset({"specular", "diffuse"})
_GEOMETRY = frozenset({"normals", "eta"})
_FACETS = _GEOMETRY | {"alpha"}

_SPECULAR: dict[str, tuple[LobeModel, frozenset[str], str]] = {
    "eq8": (lobes.microfacets("eq8"), _FACETS, "the paper's model, Equation 8 as printed"),
    "visible": (
        lobes.microfacets("visible"),
        _FACETS,
        "Equation 8 with Gaussian slopes weighted by projected facet area",
    ),
    "shadowed": (
        lobes.microfacets("shadowed"),
        _FACETS | {"distribution"},
        "visible facets under uniform light, shadowed by their neighbours",
    ),
    "smooth": (lobes.smooth, _GEOMETRY, "Wolff's smooth surface: Fresnel at the zenith angle"),
    "half_vector": (
        lobes.half_vector,
        frozenset({"eta", "light"}),
        "Fresnel at the half vector of a known distant light",
    ),
    "lights": (
        known_lights,
        _FACETS | {"distribution", "light"},
        "facets weighted by the radiance that each mirrors from known lights",
    ),
}
"""Model of the specular lobe, what it needs, and one line about it."""


def per_pixel_methods() -> Iterator[tuple[str, frozenset[str], Reconstruction, str]]:
    """Name, needs, function and summary of each method that works pixel by pixel."""
    for name, (model, needs, summary) in _SPECULAR.items():
        unpolarised_body = functools.partial(from_lobes, specular_model=model, diffuse_model=None)
        yield name, needs | _LOBES, unpolarised_body, summary
        polarised_body = functools.partial(
            from_lobes, specular_model=model, diffuse_model=lobes.diffuse
        )
        needs_with_body = needs | _LOBES | _GEOMETRY
        summary_with_body = f"{summary}; body light polarised as it leaves"
        yield f"{name}+body", needs_with_body, polarised_body, summary_with_body


def whole_picture_methods() -> Iterator[
    tuple[str, frozenset[str], Reconstruction, str, frozenset[str]]
]:
    """Name, needs, function, summary and replaceable stages of methods that see whole pictures."""
    from malus.reconstruct.learned.net import NET_METHODS
    from malus.reconstruct.single_image.blind import BLIND_METHODS
    from malus.reconstruct.single_image.paper import PAPER_METHODS, STAGES

    for entry in (*BLIND_METHODS, *NET_METHODS):
        yield *entry, frozenset()
    for entry in PAPER_METHODS:
        yield *entry, STAGES
