"""The methods: each a declaration of what it needs over shared models of the lobes."""

from __future__ import annotations

import functools
import importlib
import importlib.metadata
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from malus.reconstruct import lobe_models as lobes
from malus.reconstruct.image import from_lobes
from malus.reconstruct.known_lights import known_lights
from malus.reconstruct.lobe_models import LobeModel
from malus.reconstruct.observation import Components, Observation
from malus.reconstruct.single_image.blind import BLIND
from malus.scenes.core.errors import InputError
from malus.scenes.core.validation import near

LOBES = frozenset({"specular", "diffuse"})
ENTRY_POINTS = "malus.methods"


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
    per_pixel : bool
        What it finds at a pixel follows from that pixel and from what all share, and threads may
        call it at once. It is then given the pixels of the mask alone, in rows that are no
        picture.
    """

    name: str
    needs: frozenset[str]
    reconstruct: Callable[[Observation], Components]
    summary: str
    per_pixel: bool = False


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


TRIVIAL = Method(
    "unpolarised",
    frozenset(),
    _unpolarised,
    "the trivial guess: half of I at every angle",
    per_pixel=True,
)


def _methods() -> list[Method]:
    found = [TRIVIAL]
    for name, (model, needs, summary) in _SPECULAR.items():
        plain = functools.partial(from_lobes, specular_model=model, diffuse_model=None)
        mended = functools.partial(from_lobes, specular_model=model, diffuse_model=lobes.body)
        found.append(Method(name, needs | LOBES, plain, summary, per_pixel=True))
        more = f"{summary}; body light polarised as it leaves"
        all_needs = needs | LOBES | _GEOMETRY
        found.append(Method(f"{name}+body", all_needs, mended, more, per_pixel=True))
    return found + [Method(*entry) for entry in BLIND]


@functools.cache
def methods() -> dict[str, Method]:
    """Every method that malus brings, and those of the entry-point group `malus.methods`.

    Raises
    ------
    InputError
        If an installed entry point does not load, or is no Method.

    Examples
    --------
    >>> "eq8" in methods()
    True
    """
    found = {method.name: method for method in _methods()}
    for entry in importlib.metadata.entry_points(group=ENTRY_POINTS):
        found[entry.name] = _loaded(f"entry point {entry.name}", entry.value)
    return found


def get_method(name: str) -> Method:
    """The method of that name, or the object `package.module:object`.

    Raises
    ------
    InputError
        If there is none, or the object is no Method.

    Examples
    --------
    >>> get_method("eq8").needs == {"specular", "diffuse", "normals", "eta", "alpha"}
    True
    >>> get_method("malus.reconstruct.methods:TRIVIAL").name
    'unpolarised'
    """
    if ":" in name:
        return _loaded(f"method {name}", name)
    known = methods()
    if name not in known:
        hint = near(name, known) or "`malus list methods` shows them; your own is module:object"
        raise InputError("method", f"one of {', '.join(known)}", name, hint)
    return known[name]


def _loaded(where: str, reference: str) -> Method:
    module, _, attribute = reference.partition(":")
    # What is asked for by name on the command line may lie in the folder that one stands in.
    here = os.getcwd()
    sys.path.insert(0, here)
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        hint = "check that it can be imported"
        raise InputError(where, "package.module:object", str(error), hint) from None
    finally:
        # What was imported may have put something before it.
        sys.path.remove(here)
    if not isinstance(found, Method):
        expected = "a malus.reconstruct.Method"
        raise InputError(where, expected, type(found).__name__, "see README, a method of your own")
    return found
