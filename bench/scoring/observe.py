"""What a method is told of a truth: an Observation with the inputs that it needs, no more."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from malus.reconstruct import Observation
from malus.renderers.truth import Truth
from malus.scenes.core.errors import check_kind
from malus.scenes.core.registry import several


def _unless_nan(value: Any) -> Any:
    """The value, or None where any of it is NaN: not known."""
    return None if np.isnan(value).any() else value


_INPUTS: dict[str, Callable[[Truth], Any]] = {
    "specular": lambda truth: truth.specular[..., 0] if truth.scene.lobes_known else None,
    "diffuse": lambda truth: truth.diffuse[..., 0] if truth.scene.lobes_known else None,
    "normals": lambda truth: truth.normals,
    "eta": lambda truth: _unless_nan(truth.eta),
    "alpha": lambda truth: _unless_nan(truth.alpha),
    "distribution": lambda truth: truth.scene.distribution,
    "light": lambda truth: truth.scene.light_in_image,
    # Every light of `malus.scenes` has a flat spectrum.
    "illuminant": lambda truth: np.ones(len(truth.scene.wavelengths_nm)),
}


def observe(truth: Truth, needs: Iterable[str]) -> Observation:
    """The unpolarised picture of a truth with what `needs` names filled in, and nothing else.

    What nobody knows stays None: lobes, and maybe index and roughness, of a measured material.

    Parameters
    ----------
    truth : Truth
        What is known in full.
    needs : set or list of str
        Attributes of Observation: specular, diffuse, normals, eta, alpha, distribution, light,
        illuminant. With normals or light comes the direction to the camera, which gives them their
        meaning.

    Returns
    -------
    Observation
        What a method with these needs is given; its arrays are its own, not the truth's.

    Raises
    ------
    ValueError
        If a need is none of these, or `truth` is no Truth.

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
    check_kind("truth", truth, Truth, "`malus.render` makes one")
    named = frozenset(several(needs))
    told = Observation(image=truth.image, mask=truth.mask, **inputs(truth, named))
    return told.with_own_arrays()


def inputs(truth: Truth, needs: frozenset[str]) -> dict[str, Any]:
    """Inputs besides the picture, by the names of Observation's attributes.

    The wavelengths and those in `needs`; the direction to the camera with normals or light.
    """
    unknown = needs - _INPUTS.keys()
    if unknown:
        raise ValueError(f"needs: expected some of {sorted(_INPUTS)}, found {sorted(unknown)}")
    return {
        "wavelengths_nm": truth.scene.wavelengths_nm,
        "view_direction": truth.view_direction if needs & {"normals", "light"} else None,
        **{name: _INPUTS[name](truth) for name in needs},
    }
