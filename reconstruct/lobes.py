"""How each lobe of the reflected light is polarised, pixel by pixel and band by band.

A lobe model returns the pair (s1/s0, s2/s0) of its lobe. Specular light polarises perpendicular
to the plane of reflection and light that left the body parallel to the plane of N and V, so that
with φ the azimuth of the plane

    specular: (−ρ cos 2φ, −ρ sin 2φ)        body: (+ρ_d cos 2φ, +ρ_d sin 2φ).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.fresnel import smooth_dolp, transmission_dolp
from malus.reconstruct.observation import Image, Inapplicable, Observation
from malus.reconstruct.ratio import Measure
from malus.reconstruct.table import DolpTable
from malus.scenes.lights import Distant

Polarisation = tuple[Image, Image]
LobeModel = Callable[[Observation], Polarisation]


def double_azimuth(x: Image, y: Image) -> Polarisation:
    """(cos 2φ, sin 2φ) of the azimuth of (x, y) without trigonometry; (0, 0) at the origin.

    Examples
    --------
    >>> [v.item() for v in double_azimuth(np.array(0.0), np.array(2.0))]
    [-1.0, 0.0]
    """
    squared = x * x + y * y
    inverse = np.divide(1, squared, out=np.zeros_like(squared), where=squared > 0)
    return (x * x - y * y) * inverse, 2 * x * y * inverse


def microfacets(measure: Measure) -> LobeModel:
    """The paper's model: ρ(θ, σ, η) of Equation 8 about the mean normal, for one measure."""

    def model(observation: Observation) -> Polarisation:
        normals = observation.require("normals")
        cos_zenith = _cos_zenith(normals)
        cos2, sin2 = double_azimuth(normals[..., 0], normals[..., 1])
        tables = [DolpTable(eta, observation.sigma, measure) for eta in _one_index(observation)]
        rho = np.stack([table(cos_zenith) for table in tables], axis=-1)
        return -rho * cos2[..., None], -rho * sin2[..., None]

    return model


def smooth(observation: Observation) -> Polarisation:
    """Wolff's smooth surface: Fresnel at the zenith angle, one mirror and no facets.

    Source: Wolff and Boult, "Constraining object features using a polarization reflectance
    model", IEEE TPAMI 13 (1991).
    """
    normals = observation.require("normals")
    cos2, sin2 = double_azimuth(normals[..., 0], normals[..., 1])
    cosine = _cos_zenith(normals)[..., None]
    eta = np.asarray(observation.require("eta"))
    rho = smooth_dolp(cosine, eta).astype(observation.image.dtype)
    return -rho * cos2[..., None], -rho * sin2[..., None]


def half_vector(observation: Observation) -> Polarisation:
    """Facets that mirror a distant light: M is the half vector H of light and viewer."""
    light = observation.require("light")
    if not isinstance(light, Distant):
        raise Inapplicable(f"needs a distant light, found {light.kind}")
    toward = np.array(light.direction)
    half = toward + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    cos2, sin2 = double_azimuth(half[0], half[1])
    rho = smooth_dolp(half[2], observation.require("eta"))
    dtype = observation.image.dtype
    return (-rho * cos2).astype(dtype), (-rho * sin2).astype(dtype)


def body(observation: Observation) -> Polarisation:
    """Light that left the body: ρ_d from what the interface transmits at the zenith angle."""
    normals = observation.require("normals")
    cos2, sin2 = double_azimuth(normals[..., 0], normals[..., 1])
    eta = np.asarray(observation.require("eta"))
    cosine = _cos_zenith(normals)[..., None]
    rho = transmission_dolp(cosine, eta).astype(observation.image.dtype)
    return rho * cos2[..., None], rho * sin2[..., None]


def _cos_zenith(normals: Image) -> Image:
    return np.clip(normals[..., 2], 0, 1)


def _one_index(observation: Observation) -> list[float]:
    eta: NDArray[Any] = np.asarray(observation.require("eta"))
    if eta.ndim != 1:
        raise Inapplicable("needs one index a band")
    return [float(value) for value in eta]
