"""Radiance of a rough dielectric under one distant light: the dichromatic microfacet model.

Per unit irradiance of the light,

    I = a · diffuse(N) + F(γ, η) · specular(N),    specular = D(N·H) G1(N·L) G1(N·V) / (4 N·V),

with albedo a, Beckmann's D and the rational G1 of Walter et al., "Microfacet models for refraction
through rough surfaces", EGSR (2007). The viewer is on +z: H, and with it Fresnel's F, is the same
at every pixel. Through a perspective camera that holds in the frame of each pixel, in which the
direction of the light is another one. The body is Lambertian ('unpolarised'), or its light crosses
the interface twice ('polarised').
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from malus.reconstruct.fresnel import reflectances
from malus.reconstruct.observation import Inapplicable
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError

BodyKind = Literal["unpolarised", "polarised"]
"""Whether light that scatters inside the body leaves it unpolarised or as Fresnel transmits it."""

ETA_RANGE = (1.05, 3.0)
"""Range of dielectrics' indices that a specular level may be explained with."""


def unit_direction(direction: ArrayLike) -> Float64Array:
    """The unit vector (3,) of a direction.

    Raises
    ------
    InputError
        For what is no direction.

    Examples
    --------
    >>> unit_direction([0, 0, 5]).tolist()
    [0.0, 0.0, 1.0]
    """
    vector = np.asarray(direction, dtype=np.float64)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else math.nan
    if not 1e-6 < length < math.inf:
        expected, hint = "a vector (3,) that is not zero", "correct it"
        raise InputError("direction", expected, f"{vector.tolist()}", hint)
    return vector if abs(length - 1.0) < 1e-12 else vector / length


def half_vector(direction: Float64Array) -> Float64Array:
    """Unit vector halfway between the light (..., 3) and the viewer (0, 0, 1).

    Raises
    ------
    Inapplicable
        If the light shines from exactly behind the object.

    Examples
    --------
    >>> half_vector(np.array([0.0, 0.0, 1.0])).tolist()
    [0.0, 0.0, 1.0]
    """
    half = direction + np.array([0.0, 0.0, 1.0])
    length = np.asarray(np.linalg.norm(half, axis=-1 if half.ndim > 1 else None))[..., None]
    if length.min(initial=1.0) < 1e-6:
        raise Inapplicable("the light is exactly behind the object")
    return np.asarray(half / length)


def _cosine(normals: Float64Array, direction: Float64Array) -> Float64Array:
    """Cosine (...) between normals (..., 3) and one direction (3,), or one each (..., 3)."""
    each = direction.ndim > 1
    return np.asarray(np.sum(normals * direction, axis=-1) if each else normals @ direction)


def diffuse_shading(
    normals: Float64Array, direction: Float64Array, kind: BodyKind, eta: float = 1.5
) -> Float64Array:
    """Diffuse radiance (...) of a white body per unit irradiance, 1/sr.

    Parameters
    ----------
    normals : (..., 3) unit normals, the viewer on +z
    direction : (3,) unit vector towards the light, or (..., 3), one for each normal
    kind : 'unpolarised' (Lambertian) or 'polarised' (transmitted twice by the interface)
    eta : float
        Index of the interface; only used for a polarised body.

    Examples
    --------
    >>> facing = np.array([0.0, 0.0, 1.0])
    >>> round(float(diffuse_shading(facing, facing, "unpolarised")) * math.pi, 6)
    1.0
    """
    n_l = np.clip(_cosine(normals, direction), 0.0, 1.0)
    if kind == "unpolarised":
        return np.asarray(n_l / math.pi)
    n_v = np.clip(normals[..., 2], 0.0, 1.0)
    return np.asarray(n_l / math.pi * _transmitted(n_l, eta) * _transmitted(n_v, eta))


def specular_shading(normals: Float64Array, direction: Float64Array, alpha: float) -> Float64Array:
    """Specular radiance (...) of facets with reflectance 1 per unit irradiance, 1/sr.

    Parameters
    ----------
    normals : (..., 3) unit normals, the viewer on +z
    direction : (3,) unit vector towards the light, or (..., 3), one for each normal
    alpha : float
        Beckmann roughness.

    Examples
    --------
    >>> facing = np.array([0.0, 0.0, 1.0])
    >>> round(float(specular_shading(facing, facing, 0.5)) * math.pi, 6)
    1.0
    """
    half = half_vector(direction)
    n_h = np.maximum(_cosine(normals, half), 1e-6)
    n_l = np.clip(_cosine(normals, direction), 0.0, 1.0)
    n_v = np.clip(normals[..., 2], 0.0, 1.0)
    squared = np.minimum(n_h * n_h, 1.0)
    tan2 = (1.0 - squared) / squared
    facets = np.exp(-tan2 / alpha**2) / (math.pi * alpha**2 * squared**2)
    return np.asarray(facets * _unmasked(n_l, alpha) * _unmasked_over_cosine(n_v, alpha) / 4.0)


def facet_reflectance(direction: Float64Array, eta: float) -> float:
    """Fresnel reflectance (F_⊥ + F_∥)/2 of the facets that mirror the light to the viewer.

    Examples
    --------
    >>> round(facet_reflectance(np.array([0.0, 0.0, 1.0]), 1.5), 12)
    0.04
    """
    return float(facet_reflectances(direction, eta))


def facet_reflectances(directions: Float64Array, eta: float) -> Float64Array:
    """The same (...) for several directions (..., 3).

    Examples
    --------
    >>> facet_reflectances(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]), 1.5).round(4).tolist()
    [0.04, 0.0502]
    """
    perpendicular, parallel = reflectances(half_vector(directions)[..., 2], eta)
    return np.asarray(0.5 * (perpendicular + parallel))


def index_of(direction: Float64Array, reflectance: float) -> float:
    """Index η from the reflectance of the facets, clipped to `ETA_RANGE`.

    The inverse of `facet_reflectance`.

    Examples
    --------
    >>> round(index_of(np.array([0.0, 0.0, 1.0]), 0.04), 9)
    1.5
    """
    low, high = (facet_reflectance(direction, eta) for eta in ETA_RANGE)
    if reflectance <= low:
        return ETA_RANGE[0]
    if reflectance >= high:
        return ETA_RANGE[1]
    root = brentq(lambda eta: facet_reflectance(direction, eta) - reflectance, *ETA_RANGE)
    return float(root)


def _transmitted(cosine: Float64Array, eta: float) -> Float64Array:
    """Fresnel transmittance of unpolarised light at the cosine of its angle outside."""
    perpendicular, parallel = reflectances(cosine, eta)
    return np.asarray(1.0 - 0.5 * (perpendicular + parallel))


def _unmasked(cosine: Float64Array, alpha: float) -> Float64Array:
    """Smith's G1 of a direction, from a = 1/(alpha tan θ): rational up to a = 1.6, then 1."""
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 1e-300))
    a = np.minimum(cosine / (alpha * sine), 1.6)
    rational = (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a)
    return np.asarray(np.where(a < 1.6, rational, 1.0))


def _unmasked_over_cosine(cosine: Float64Array, alpha: float) -> Float64Array:
    """G1(cos θ) / cos θ, finite at the rim, where it tends to 3.535 / alpha."""
    floor = np.maximum(cosine, 1e-6)
    return _unmasked(floor, alpha) / floor
