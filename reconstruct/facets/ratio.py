"""The polarisation ratio R(θ, σ, η) of rough surfaces and the specular degree of polarisation ρ."""

from __future__ import annotations

from typing import cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from malus.reconstruct.facets.breakpoints import Measure
from malus.reconstruct.facets.integrals import integrate_dolp
from malus.reconstruct.facets.scattered import interpolate
from malus.reconstruct.fresnel import EtaArray, checked_eta
from malus.scenes.core.arrays import AnyArray, BoolArray, Float64Array

__all__ = ["Measure", "polarisation_ratio", "specular_dolp"]

# Number of points from which building an interpolant takes less time than integrating at each.
_MANY = 2000


def _require(name: str, allowed: str, values: AnyArray, valid: BoolArray) -> None:
    """Raise ValueError for the first value that is not valid."""
    if not np.all(valid):
        raise ValueError(f"{name} must be {allowed}, got {values[~valid].flat[0]}")


def checked_zenith(zenith: ArrayLike) -> Float64Array:
    """Zenith angles as float64 in [0, π/2]; a float32 π/2, which is larger, counts as π/2."""
    unchecked = np.asarray(zenith)
    eps = np.finfo(unchecked.dtype).eps if unchecked.dtype.kind == "f" else 0.0
    angles = unchecked.astype(np.float64)
    valid = (angles >= 0.0) & (angles <= np.pi / 2 * (1.0 + eps))
    _require("zenith", "in [0, pi/2] radians", angles, valid)
    return np.minimum(angles, np.pi / 2)


def checked_sigma(sigma: ArrayLike) -> Float64Array:
    """Exponents σ as float64, finite and above 0."""
    exponents = np.asarray(sigma, dtype=np.float64)
    _require("sigma", "finite and > 0", exponents, np.isfinite(exponents) & (exponents > 0.0))
    return exponents


def checked_measure(measure: str) -> Measure:
    """The name of a measure; ValueError if there is none of that name."""
    names = get_args(Measure)
    if measure not in names:
        raise ValueError(f"measure must be one of {', '.join(names)}, got {measure!r}")
    return cast(Measure, measure)


def _interpolated(
    zenith: Float64Array, eta: EtaArray, sigma: Float64Array, measure: Measure, tolerance: float
) -> Float64Array:
    """ρ of many points from interpolants in √cos θ, n, k and ln σ, in which it is smooth.

    √cos θ, because ρ of `eq8` ends like cos θ ln cos θ at grazing incidence, and because the band
    where the horizon cuts into the facets, cos θ ~ 1/√σ, is wider there.
    """

    def integrate(points: Float64Array) -> Float64Array:
        cosine, n, k, log_sigma = np.square(points[:, 0]), points[:, 1], points[:, 2], points[:, 3]
        index = n + 1j * k if np.any(k) else n
        return integrate_dolp(np.arccos(cosine), index, np.exp(log_sigma), measure, tolerance)

    root = np.sqrt(np.maximum(np.cos(zenith), 0.0))
    points = np.stack([root, eta.real, eta.imag, np.log(sigma)], axis=-1)
    return np.where(zenith == 0.0, 0.0, interpolate(integrate, points, tolerance))


def specular_dolp(
    zenith: ArrayLike,
    eta: ArrayLike,
    sigma: ArrayLike,
    measure: Measure = "eq8",
    *,
    tolerance: float = 1e-8,
) -> Float64Array:
    """Degree of polarisation ρ = (I_⊥ − I_∥)/(I_⊥ + I_∥) of light reflected by a rough surface.

    Parameters
    ----------
    zenith : array, radians, in [0, pi/2]
        Angle between mean surface normal and viewer. float32 is computed in float64.
    eta : array, real or complex
        Relative index, > 0; metals n + ik with n > 0, k ≥ 0. At eta = 1, where nothing is
        reflected, the limit.
    sigma : array, > 0
        Exponent of the distribution exp(−σ r²) of facet slopes r, Equation 2: σ = 1/α² at
        Beckmann roughness α.
    measure : {"eq8", "visible", "shadowed", "shadowed_ggx"}
        Weight of a facet: Equation 8 as printed; times slope Jacobian and projected area; times
        Smith's shadowing of the mirrored direction as well. The last is that of GGX facets, whose
        slopes are distributed as (1 + σr²)⁻² instead of exp(−σr²).
    tolerance : float
        Largest error of ρ. Thousands of points are interpolated to this error from few integrals.

    Returns
    -------
    float64 array of the broadcast shape
        In [−1, 1]; positive is perpendicular to the plane of reflection. Negative for very rough
        surfaces.

    Raises
    ------
    ValueError
        An argument outside its range: the message names it, the range and the value.

    Notes
    -----
    Gu et al., "Reconstructing Polarisation Components from Unpolarised Images", Equations 2 to 8.

    Examples
    --------
    >>> round(float(specular_dolp(np.radians(50), 1.5, 10.0)), 8)
    0.80949744
    """
    name = checked_measure(measure)
    if not tolerance > 0.0:
        raise ValueError(f"tolerance must be > 0, got {tolerance}")
    angles, index, exponents = np.broadcast_arrays(
        checked_zenith(zenith), checked_eta(eta), checked_sigma(sigma)
    )
    compute = integrate_dolp if angles.size < _MANY else _interpolated
    rho = compute(angles.ravel(), index.ravel(), exponents.ravel(), name, tolerance)
    return rho.reshape(angles.shape)


def polarisation_ratio(
    zenith: ArrayLike,
    eta: ArrayLike,
    sigma: ArrayLike,
    measure: Measure = "eq8",
    *,
    tolerance: float = 1e-8,
) -> Float64Array:
    """Polarisation ratio R = I_∥/I_⊥ of light reflected by a rough surface, Equation 8.

    Parameters, measures and errors are those of `specular_dolp`, from which R = (1 − ρ)/(1 + ρ).
    `tolerance` is that of ρ.

    Parameters
    ----------
    zenith, eta, sigma, measure, tolerance
        As for `specular_dolp`.

    Returns
    -------
    ndarray
        Of the shape that zenith, eta and sigma broadcast to.

    Examples
    --------
    >>> round(float(polarisation_ratio(np.radians(50), 1.5, 10.0)), 8)
    0.10527926
    """
    rho = specular_dolp(zenith, eta, sigma, measure, tolerance=tolerance)
    return np.asarray((1.0 - rho) / (1.0 + rho))
