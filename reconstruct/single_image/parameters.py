"""Albedo, refractive index and roughness of one object from its picture and its normals.

With the normals known, the dichromatic microfacet model is linear in the albedo and in the level
of mirrored light, and roughness alone is searched for: variable projection. The level is
irradiance times Fresnel reflectance at the one angle at which a distant light is mirrored, so that
it gives η if, and only if, the irradiance is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from malus.reconstruct.single_image.shading import (
    ETA_RANGE,
    BodyKind,
    diffuse_shading,
    facet_reflectance,
    index_of,
    specular_shading,
)

Floats = NDArray[np.float64]

ALPHA_RANGE = (0.03, 0.9)
"""Roughnesses that are searched: smoother is a mirror, rougher shows no lobe."""
_STARTS = 7
"""Intervals of ln alpha, each searched on its own: the error may have more than one minimum."""
_STARTING_ALPHAS = (0.1, 0.2, 0.4)
TYPICAL_ETA = 1.5
"""Index of most plastics, glass and dry organic matter, for want of an irradiance."""


@dataclass(frozen=True)
class Parameters:
    """What a surface is made of, as far as one picture tells.

    Attributes
    ----------
    eta : float
        Refractive index; `eta_known` is False where it was assumed rather than measured.
    alpha : float
        Beckmann roughness.
    body : 'unpolarised' or 'polarised'
    albedo, level : (bands,) arrays
        Weights of `body_shading` and `mirrored_shading`: irradiance times albedo, and irradiance
        times Fresnel reflectance, in units of the image.
    error : float
        Root mean square residual over the largest value of the image.
    notes : tuple of str
        What was assumed, and what failed.
    """

    eta: float
    eta_known: bool
    alpha: float
    body: BodyKind
    albedo: Floats
    level: Floats
    error: float
    notes: tuple[str, ...] = ()


def fit_parameters(
    pixels: Floats,
    normals: Floats,
    direction: Floats,
    body: BodyKind,
    irradiance: float | None = None,
    eta: float | None = None,
    alpha: float | None = None,
) -> Parameters:
    """Fit the model to an object's pixels.

    Parameters
    ----------
    pixels : (n, bands) radiances
    normals : (n, 3) unit normals in the image frame
    direction : (3,) unit vector towards the light
    body : 'unpolarised' or 'polarised'
    irradiance : float, optional
        Of the light, W m⁻² nm⁻¹ for radiances in W m⁻² sr⁻¹ nm⁻¹. Without it η cannot be measured.
    eta, alpha : float, optional
        Where they are known they are kept.

    Examples
    --------
    >>> theta = np.linspace(0, 1.4, 400)
    >>> n = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=-1)
    >>> light = np.array([0.0, 0.0, 1.0])
    >>> seen = 0.5 * body_shading(n, light, "unpolarised") + 0.04 * mirrored_shading(n, light, 0.2)
    >>> found = fit_parameters(seen[:, None], n, light, "unpolarised", irradiance=1.0)
    >>> round(found.eta, 3), round(found.alpha, 3)
    (1.5, 0.2)
    """
    index = eta if eta is not None else TYPICAL_ETA
    roughness = alpha
    if body == "polarised" and eta is None and irradiance is not None:
        index = _index(pixels, normals, direction, irradiance, alpha)
    shading = diffuse_shading(normals, direction, body, index)
    if roughness is None:
        roughness = _roughness(pixels, normals, direction, shading)
    weights, error = _weights(pixels, shading, specular_shading(normals, direction, roughness))
    if body == "unpolarised" and eta is None and irradiance is not None:
        index = index_of(direction, float(weights[1].mean()) / irradiance)
    peak = max(float(pixels.max()), np.finfo(np.float64).tiny)
    known = eta is not None or irradiance is not None
    notes = _notes(known, index, roughness, weights[1])
    return Parameters(index, known, roughness, body, weights[0], weights[1], error / peak, notes)


def _index(
    pixels: Floats, normals: Floats, direction: Floats, irradiance: float, alpha: float | None
) -> float:
    """η of a polarised body, where it shapes the body's light and sets the level of the mirrored.

    The level is tied to η, so that both say the same; η and ln alpha are searched together.
    """

    def cost(x: Floats) -> float:
        eta, roughness = float(x[0]), alpha if alpha is not None else float(np.exp(x[1]))
        body = diffuse_shading(normals, direction, "polarised", eta)
        level = irradiance * facet_reflectance(direction, eta)
        rest = pixels - level * specular_shading(normals, direction, roughness)[:, None]
        albedo = np.maximum(body @ rest, 0) / max(float(body @ body), 1e-300)
        return float(np.sqrt(np.mean((rest - np.outer(body, albedo)) ** 2)))

    bounds = [ETA_RANGE, tuple(np.log(ALPHA_RANGE))]
    starts = [np.array([TYPICAL_ETA, np.log(a)]) for a in _STARTING_ALPHAS]
    found = minimize(
        cost, min(starts, key=cost), method="Nelder-Mead", bounds=bounds, options={"xatol": 1e-3}
    )
    return float(found.x[0])


def _roughness(pixels: Floats, normals: Floats, direction: Floats, shading: Floats) -> float:
    """The alpha of least residual: a bounded search in each of several intervals of ln alpha."""

    def cost(log_alpha: float) -> float:
        mirrored = specular_shading(normals, direction, float(np.exp(log_alpha)))
        return _weights(pixels, shading, mirrored)[1]

    edges = np.log(np.geomspace(ALPHA_RANGE[0], ALPHA_RANGE[1], _STARTS + 1))
    values = [cost(edge) for edge in edges]
    best = int(np.argmin(values))
    low, high = edges[max(best - 1, 0)], edges[min(best + 1, _STARTS)]
    found = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-4})
    winner = found.x if float(found.fun) <= values[best] else edges[best]
    return float(np.exp(winner))


def _weights(pixels: Floats, body: Floats, mirrored: Floats) -> tuple[Floats, float]:
    """Non-negative weights (2, bands) of both shadings and the root mean square residual.

    Two unknowns: where the free solution is negative, the best one has one weight zero.
    """
    bb, mm, bm = body @ body, mirrored @ mirrored, body @ mirrored
    right = np.stack([body @ pixels, mirrored @ pixels])
    determinant = bb * mm - bm * bm
    if determinant > 1e-12 * bb * mm:
        free = np.stack([mm * right[0] - bm * right[1], bb * right[1] - bm * right[0]])
        free /= determinant
    else:
        free = np.full_like(right, -1.0)
    alone = [right[0] / max(bb, 1e-300), right[1] / max(mm, 1e-300)]
    gains = [alone[0] * right[0], alone[1] * right[1]]
    one = np.where(gains[0] >= gains[1], [alone[0], 0 * alone[1]], [0 * alone[0], alone[1]])
    weights = np.where(np.all(free >= 0, axis=0), free, one)
    residual = pixels - np.outer(body, weights[0]) - np.outer(mirrored, weights[1])
    return weights, float(np.sqrt(np.mean(residual**2)))


def _notes(known: bool, eta: float, alpha: float, level: NDArray[Any]) -> tuple[str, ...]:
    found = []
    if not known:
        found.append(f"eta is assumed ({TYPICAL_ETA:g}): the irradiance is not known")
    elif eta in ETA_RANGE:
        found.append(
            f"eta ran into its bound {eta:g}: the level of mirrored light is not plausible"
        )
    if min(alpha / ALPHA_RANGE[0], ALPHA_RANGE[1] / alpha) < 1.01:
        found.append(f"alpha ran into its bound {alpha:.2g}")
    if not np.any(level > 0):
        found.append("no mirrored light was found")
    return tuple(found)
