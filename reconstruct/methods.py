"""The methods: each a declaration of what it needs over shared models of the lobes."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from malus.reconstruct import lobes
from malus.reconstruct.image import from_lobes
from malus.reconstruct.known_lights import known_lights
from malus.reconstruct.lobes import LobeModel
from malus.reconstruct.observation import Components, Observation
from malus.scenes.errors import InputError

LOBES = frozenset({"specular", "diffuse"})


@dataclass(frozen=True)
class Method:
    """A way to reconstruct polarisation from one unpolarised image.

    Attributes
    ----------
    name : str
    needs : frozenset of str
        Attributes of `Observation` that are filled in for it, besides image and mask.
    reconstruct : function of an Observation that returns Components
    summary : str
        One line for `malus list`.
    """

    name: str
    needs: frozenset[str]
    reconstruct: Callable[[Observation], Components]
    summary: str


def _unpolarised(observation: Observation) -> Components:
    nothing = np.zeros_like(observation.image)
    return Components(observation.image, nothing, nothing)


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
        _FACETS,
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
        _FACETS | {"light"},
        "facets weighted by the radiance that each mirrors from known lights",
    ),
}


def _methods() -> list[Method]:
    trivial = "the trivial guess: half of I at every angle"
    found = [Method("unpolarised", frozenset(), _unpolarised, trivial)]
    for name, (model, needs, summary) in _SPECULAR.items():
        plain = functools.partial(from_lobes, specular_model=model, body_model=None)
        mended = functools.partial(from_lobes, specular_model=model, body_model=lobes.body)
        found.append(Method(name, needs | LOBES, plain, summary))
        more = f"{summary}; body light polarised as it leaves"
        found.append(Method(f"{name}+body", needs | LOBES | _GEOMETRY, mended, more))
    return found


@functools.cache
def methods() -> dict[str, Method]:
    """Every method that malus brings, by name.

    Examples
    --------
    >>> sorted(methods())[0]
    'eq8'
    """
    return {method.name: method for method in _methods()}


def get_method(name: str) -> Method:
    """The method of that name.

    Raises
    ------
    InputError
        If there is none.

    Examples
    --------
    >>> get_method("eq8").needs == {"specular", "diffuse", "normals", "eta", "alpha"}
    True
    """
    known = methods()
    if name not in known:
        raise InputError(
            "method", f"one of {', '.join(known)}", name, "`malus list methods` shows them"
        )
    return known[name]
