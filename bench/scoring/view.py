"""From a truth to what a method may see."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from malus.reconstruct import Observation
from malus.renderers.truth import Truth

_KNOWN: dict[str, Callable[[Truth], Any]] = {
    "specular": lambda truth: truth.specular[..., 0],
    "diffuse": lambda truth: truth.diffuse[..., 0],
    "normals": lambda truth: truth.normals,
    "eta": lambda truth: truth.eta,
    "alpha": lambda truth: truth.alpha,
    "light": lambda truth: truth.scene.light_in_image,
}

KNOWN = frozenset(_KNOWN)
"""All that a method can be told besides the picture."""


def observe(truth: Truth, needs: frozenset[str]) -> Observation:
    """The unpolarised picture of a truth with what `needs` names filled in, and nothing else.

    Parameters
    ----------
    truth : Truth
    needs : set of str
        Attributes of Observation: specular, diffuse, normals, eta, alpha, light. With normals or
        light comes the direction to the camera, which gives them their meaning.

    Raises
    ------
    ValueError
        If a need is none of these.

    Examples
    --------
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=8))
    >>> truth = render(scene, renderer="torrance-sparrow")
    >>> observe(truth, frozenset({"alpha"})).alpha
    0.3
    """
    unknown = needs - _KNOWN.keys()
    if unknown:
        raise ValueError(f"needs: expected some of {sorted(_KNOWN)}, found {sorted(unknown)}")
    return Observation(
        image=truth.image,
        mask=truth.mask,
        wavelengths_nm=truth.scene.wavelengths_nm,
        view=truth.view if needs & {"normals", "light"} else None,
        **{name: _KNOWN[name](truth) for name in needs},
    )
