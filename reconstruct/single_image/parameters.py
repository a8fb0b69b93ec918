"""Albedo, refractive index and roughness of one object from its picture and its normals.

With the normals given, the dichromatic microfacet model is linear in the albedo and in the specular
level, and roughness alone is searched for: variable projection. The level is irradiance times
Fresnel reflectance at the one angle at which a distant light is mirrored, so that it gives η if,
and only if, the irradiance is given. Through a perspective camera that angle varies a little; the
level is that of the mean direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import get_args

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from malus.reconstruct.single_image.shading import (
    ETA_RANGE,
    BodyKind,
    diffuse_shading,
    facet_reflectance,
    facet_reflectances,
    index_of,
    specular_shading,
    unit_direction,
)
from malus.scenes.core.arrays import Float64Array, FloatArray
from malus.scenes.core.errors import InputError

ALPHA_RANGE = (0.03, 0.9)
"""Roughnesses that are searched: smoother is a mirror, rougher shows no lobe."""
_STARTS = 7
"""Intervals of ln alpha whose ends are tried first: the error may have more than one minimum."""
_STARTING_ALPHAS = (0.1, 0.2, 0.4)
TYPICAL_ETA = 1.5
"""Index of most plastics, glass and dry organic matter: assumed where no irradiance is given."""


_LENGTH_SLACK = 1e-2
"""By how much the length of a normal may differ from 1: means over pixels do by less."""


@dataclass(frozen=True)
class SurfaceParameters:
    """Index, roughness and albedo of a surface, as far as one picture tells them.

    Attributes
    ----------
    eta : float
        Refractive index.
    eta_known : bool
        False where the index was assumed rather than given or measured.
    alpha : float
        Beckmann roughness.
    body : 'unpolarised' or 'polarised'
        Which of the two bodies was fitted.
    albedo, level : (bands,) arrays
        Weights of `diffuse_shading` and `specular_shading`: irradiance times albedo, and irradiance
        times Fresnel reflectance, in units of the image times sr.
    error : float
        Root mean square residual over the largest value of the image.
    notes : tuple of str
        What was assumed, and what failed.

    Examples
    --------
    >>> facing = np.array([[0.0, 0.0, 1.0]])
    >>> fit = fit_parameters(np.ones((1, 1)), facing, facing[0], "unpolarised", alpha=0.3)
    >>> fit.eta_known, fit.notes[0]
    (False, 'eta is assumed (1.5): the irradiance is not known')
    """

    eta: float
    eta_known: bool
    alpha: float
    body: BodyKind
    albedo: Float64Array
    level: Float64Array
    error: float
    notes: tuple[str, ...] = ()


def fit_parameters(
    pixels: Float64Array,
    normals: Float64Array,
    direction: Float64Array,
    body: BodyKind,
    irradiance: float | None = None,
    eta: float | None = None,
    alpha: float | None = None,
) -> SurfaceParameters:
    """Fit roughness, index and albedo of a surface to an object's pixels, whose normals are given.

    Parameters
    ----------
    pixels : (n, bands) radiances under one distant light
    normals : (n, 3) unit normals in the image frame: x right, y up, z towards the viewer
    direction : (3,) vector towards the light, in the image frame
        Or one for each pixel, (n, 3): through a perspective camera normals and directions are given
        in the frame of each pixel, whose z points to the camera.
    body : 'unpolarised' or 'polarised'
        Lambertian, or diffuse light that crosses the surface twice.
    irradiance : float, optional
        Of the light, W m⁻² nm⁻¹ for radiances in W m⁻² sr⁻¹ nm⁻¹. Without it η cannot be measured
        and 1.5 is assumed.
    eta, alpha : float, optional
        Index and Beckmann roughness, where they are given: they are kept.

    Returns
    -------
    SurfaceParameters
        What fits best, and the error that is left.

    Raises
    ------
    Inapplicable
        If the light shines from exactly behind the object.
    InputError
        For arrays that do not belong together, no pixels or some that are not finite, normals that
        are none, an unknown body, or a given value that is not above 0.

    Notes
    -----
    The model is that of `malus.reconstruct.single_image.shading`; the fit is a variable projection
    (Golub and Pereyra, SIAM J. Numerical Analysis 10, 1973), after Huynh and Robles-Kelly,
    "Simultaneous photometric invariance and shape recovery", ICCV (2009).

    Examples
    --------
    >>> from malus.reconstruct.single_image.shading import diffuse_shading, specular_shading
    >>> theta = np.linspace(0, 1.4, 400)
    >>> n = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=-1)
    >>> light = np.array([0.0, 0.0, 1.0])
    >>> diffuse = 0.5 * diffuse_shading(n, light, "unpolarised")
    >>> pixels = diffuse + 0.04 * specular_shading(n, light, 0.2)
    >>> fit = fit_parameters(pixels[:, None], n, light, "unpolarised", irradiance=1.0)
    >>> round(fit.eta, 3), round(fit.alpha, 3)
    (1.5, 0.2)
    """
    pixels, normals = np.asarray(pixels), np.asarray(normals)
    _check(pixels, normals, body)
    check_positive(irradiance=irradiance, eta=eta, alpha=alpha)
    direction, middle = _directions(direction, len(pixels))
    index = eta if eta is not None else TYPICAL_ETA
    roughness = alpha
    if body == "polarised" and eta is None and irradiance is not None:
        index = _index(pixels, normals, direction, irradiance, alpha)
    shading = diffuse_shading(normals, direction, body, index)
    brightness = facet_reflectances(direction, index) / facet_reflectance(middle, index)
    if roughness is None:
        roughness = _roughness(pixels, normals, direction, shading, brightness)
    specular = brightness * specular_shading(normals, direction, roughness)
    (albedo, level), error = _weights(pixels, shading, specular)
    if body == "unpolarised" and eta is None and irradiance is not None:
        index = index_of(middle, float(level.mean()) / irradiance)
    peak = max(float(pixels.max()), np.finfo(np.float64).tiny)
    eta_known = eta is not None or irradiance is not None
    found = (index if eta is None else None), (roughness if alpha is None else None)
    notes = _notes(eta_known, *found, level)
    return SurfaceParameters(index, eta_known, roughness, body, albedo, level, error / peak, notes)


def _directions(direction: Float64Array, count: int) -> tuple[Float64Array, Float64Array]:
    """Unit vectors (3,), or (n, 3) for as many pixels, towards the light, and their mean (3,)."""
    directions = np.asarray(direction, dtype=np.float64)
    if directions.shape != (count, 3):
        one = unit_direction(directions)
        return one, one
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    return directions / lengths, unit_direction((directions / lengths).mean(axis=0))


def _check(pixels: Float64Array, normals: Float64Array, body: str) -> None:
    """Raise InputError for what are no pixels, no normals of them, or no body."""
    check_body(body)
    if pixels.ndim != 2 or normals.shape != (len(pixels), 3):
        found = f"{pixels.shape} and {normals.shape}"
        hint = "pixels of one band are pixels[:, None]"
        raise InputError("pixels, normals", "shapes (n, bands) and (n, 3)", found, hint)
    check_finite(pixels)
    lengths = np.linalg.norm(normals, axis=1)
    if not np.abs(lengths - 1).max() < _LENGTH_SLACK:
        found = f"lengths from {lengths.min():.4g} to {lengths.max():.4g}"
        raise InputError("normals", "unit vectors", found, "divide them by their lengths")


def check_finite(pixels: Float64Array) -> None:
    """Raise InputError for no pixels, or for some that are not finite.

    Examples
    --------
    >>> check_finite(np.ones((4, 3)))
    """
    finite = int(np.isfinite(pixels).all(axis=tuple(range(1, pixels.ndim))).sum())
    if finite < len(pixels) or not len(pixels):
        found = f"{len(pixels) - finite} of {len(pixels)} that are not"
        raise InputError("pixels", "at least one, all finite", found, "leave those out")


def check_body(body: str) -> None:
    """Raise InputError for a body that is neither unpolarised nor polarised.

    Examples
    --------
    >>> check_body("polarised")
    """
    if body not in get_args(BodyKind):
        expected = f"one of {', '.join(get_args(BodyKind))}"
        raise InputError("body", expected, str(body), "choose one of them")


def check_positive(**given: float | None) -> None:
    """Raise InputError for a given value, by its name, that is not above 0 or not finite.

    Examples
    --------
    >>> check_positive(alpha=0.3, eta=None)
    """
    for name, value in given.items():
        if value is not None and not 0 < value < math.inf:
            expected, hint = "a finite number above 0", "correct it, or leave it out"
            raise InputError(name, expected, str(value), hint)


def _index(
    pixels: Float64Array,
    normals: Float64Array,
    direction: Float64Array,
    irradiance: float,
    alpha: float | None,
) -> float:
    """Index of a polarised body, which shapes the diffuse light and sets the specular level.

    η and ln alpha are searched together; the level follows from η.
    """

    def cost(x: Float64Array) -> float:
        eta, roughness = float(x[0]), alpha if alpha is not None else float(np.exp(x[1]))
        diffuse = diffuse_shading(normals, direction, "polarised", eta)
        level = irradiance * facet_reflectances(direction, eta)
        rest = pixels - (level * specular_shading(normals, direction, roughness))[:, None]
        albedo = np.maximum(diffuse @ rest, 0) / max(float(diffuse @ diffuse), 1e-300)
        return float(np.sqrt(np.mean((rest - np.outer(diffuse, albedo)) ** 2)))

    bounds = [ETA_RANGE, tuple(np.log(ALPHA_RANGE))]
    starts = [np.array([TYPICAL_ETA, np.log(a)]) for a in _STARTING_ALPHAS]
    minimum = minimize(
        cost, min(starts, key=cost), method="Nelder-Mead", bounds=bounds, options={"xatol": 1e-3}
    )
    return float(minimum.x[0])


def _roughness(
    pixels: Float64Array,
    normals: Float64Array,
    direction: Float64Array,
    diffuse: Float64Array,
    brightness: Float64Array,
) -> float:
    """Roughness of least residual: a bounded search around the best of several values."""

    def cost(log_alpha: float) -> float:
        specular = brightness * specular_shading(normals, direction, float(np.exp(log_alpha)))
        return _weights(pixels, diffuse, specular)[1]

    edges = np.log(np.geomspace(ALPHA_RANGE[0], ALPHA_RANGE[1], _STARTS + 1))
    values = [cost(edge) for edge in edges]
    best = int(np.argmin(values))
    low, high = edges[max(best - 1, 0)], edges[min(best + 1, _STARTS)]
    minimum = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": 1e-4})
    log_alpha = minimum.x if float(minimum.fun) <= values[best] else edges[best]
    return float(np.exp(log_alpha))


def _weights(
    pixels: Float64Array, diffuse: Float64Array, specular: Float64Array
) -> tuple[Float64Array, float]:
    """Non-negative weights (2, bands) of both shadings and the root mean square residual.

    There are two unknowns: where the unconstrained solution has a negative one, one weight of the
    best solution is zero.
    """
    dd, ss, ds = diffuse @ diffuse, specular @ specular, diffuse @ specular
    right = np.stack([diffuse @ pixels, specular @ pixels])
    determinant = dd * ss - ds * ds
    if determinant > 1e-12 * dd * ss:
        free = np.stack([ss * right[0] - ds * right[1], dd * right[1] - ds * right[0]])
        free /= determinant
    else:
        free = np.full_like(right, -1.0)
    positive = np.maximum(right, 0)  # a picture with noise below zero may have others
    alone = [positive[0] / max(dd, 1e-300), positive[1] / max(ss, 1e-300)]
    gains = [alone[0] * right[0], alone[1] * right[1]]
    single = np.where(gains[0] >= gains[1], [alone[0], 0 * alone[1]], [0 * alone[0], alone[1]])
    weights = np.where(np.all(free >= 0, axis=0), free, single)
    residual = pixels - np.outer(diffuse, weights[0]) - np.outer(specular, weights[1])
    return weights, float(np.sqrt(np.mean(residual**2)))


def _notes(
    eta_known: bool, eta: float | None, alpha: float | None, level: FloatArray
) -> tuple[str, ...]:
    """What was assumed and what failed, in words; index and roughness are None where given."""
    notes = []
    if not eta_known:
        notes.append(f"eta is assumed ({TYPICAL_ETA:g}): the irradiance is not known")
    elif eta in ETA_RANGE:
        notes.append(
            f"eta ran into its bound {eta:g}: the level of specular light is not plausible"
        )
    if alpha is not None and min(alpha / ALPHA_RANGE[0], ALPHA_RANGE[1] / alpha) < 1.01:
        notes.append(f"alpha ran into its bound {alpha:.2g}")
    if not np.any(level > 0):
        notes.append("the shape explains the picture best without specular light")
    return tuple(notes)
