"""Fresnel reflection of one smooth facet, accurate near index one and at grazing incidence too.

With c = cos γ, s = sin γ, δ = η² − 1 and q = √(c² + δ) (q = η cos of the refracted angle):

* r_⊥ = (c − q) / (c + q) = −δ / (c + q)², which no longer subtracts two nearly equal numbers;
* |r_∥| = |r_⊥| · |c q − s²| / |c q + s²|, because r_∥/r_⊥ = −cos(γ + γ') / cos(γ − γ');
* |c q + s²|² − |c q − s²|² = 4 s² c Re q, so F_⊥ − F_∥ is a product of positive factors.

All three hold for complex η = n + ik and beyond the critical angle, where q is imaginary.
The common factor |δ|² of both reflectances cancels from every ratio, so ratios stay defined
at η = 1, where nothing is reflected.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from malus.scenes.core.arrays import BoolArray, Float64Array

EtaArray = NDArray[Any]
"""Refractive index or its excess δ: float64, or complex128 for metals."""


def excess(eta: EtaArray) -> EtaArray:
    """δ = η² − 1 without cancellation near η = 1."""
    return (eta - 1.0) * (eta + 1.0)


def refracted(cos_incidence: Float64Array, delta: EtaArray) -> EtaArray:
    """q = √(cos²γ + δ): real, or complex beyond the critical angle and in metals."""
    square = cos_incidence * cos_incidence + delta
    if np.iscomplexobj(square) or square.size == 0 or float(square.min()) >= 0.0:
        return np.asarray(np.sqrt(square))
    return np.asarray(np.sqrt(square.astype(np.complex128)))


def _square_modulus(z: EtaArray) -> Float64Array:
    """|z|² of real or complex numbers."""
    return np.asarray(z.real * z.real + z.imag * z.imag if np.iscomplexobj(z) else z * z)


def _checked(cos_incidence: ArrayLike, eta: ArrayLike) -> tuple[Float64Array, EtaArray]:
    """Both arguments as arrays; ValueError if the cosine is outside [0, 1] or η unphysical."""
    cosine = np.asarray(cos_incidence, dtype=np.float64)
    if not np.all((cosine >= 0.0) & (cosine <= 1.0)):
        worst = cosine[~((cosine >= 0.0) & (cosine <= 1.0))].flat[0]
        raise ValueError(f"cos_incidence must lie in [0, 1], got {worst}")
    return cosine, checked_eta(eta)


def physical(eta: EtaArray) -> BoolArray:
    """True where an index is that of a body that does not amplify light: n > 0, k ≥ 0."""
    return np.asarray((np.abs(eta) < 1e100) & (eta.real > 0.0) & (eta.imag >= 0.0))


def checked_eta(eta: ArrayLike) -> EtaArray:
    """Relative index as float64, or complex128 where any is absorbing; ValueError if unphysical.

    >>> checked_eta(1.5 + 0j)
    array(1.5)
    """
    index = np.asarray(eta)
    index = index.astype(np.complex128 if np.iscomplexobj(index) else np.float64)
    good = physical(index)
    if not np.all(good):
        worst = index[~good].flat[0]
        raise ValueError(
            f"eta must be > 0 and below 1e100 (metals: n + ik with n > 0, k >= 0), got {worst}"
        )
    return np.asarray(index.real) if not np.any(index.imag) else index


def reflectances(cos_incidence: ArrayLike, eta: ArrayLike) -> tuple[Float64Array, Float64Array]:
    """Fresnel reflectances (F_⊥, F_∥) of a smooth surface.

    Parameters
    ----------
    cos_incidence : array in [0, 1]
        Cosine of the angle between normal and ray (the paper's γ for a facet).
    eta : array, real or complex
        Relative index, > 0. Below 1 the reflection is total beyond the critical angle.
        Metals are n + ik with k ≥ 0.

    Returns
    -------
    perpendicular, parallel : float64 arrays of the broadcast shape, in [0, 1]

    Raises
    ------
    ValueError
        Cosine outside [0, 1]; `eta` not finite or not positive; k negative.

    Notes
    -----
    J_⊥, J_∥ of Gu et al., "Reconstructing Polarisation Components from Unpolarised Images",
    Equation 4, are these times the incident irradiance.

    Examples
    --------
    >>> perpendicular, parallel = reflectances(1.0, 1.5)
    >>> round(float(perpendicular), 12), round(float(parallel), 12)
    (0.04, 0.04)
    """
    cosine, index = _checked(cos_incidence, eta)
    cosine, index = np.broadcast_arrays(cosine, index)
    delta = excess(index)
    q = refracted(cosine, delta)
    sine2 = (1.0 - cosine) * (1.0 + cosine)
    # c + q = 0 only where eta = 1 at exactly grazing incidence: nothing is reflected there.
    outgoing = np.where(cosine + q == 0.0, 1.0, cosine + q)
    perpendicular = (np.abs(delta) / _square_modulus(outgoing)) ** 2
    cq = cosine * q
    ratio = _square_modulus(cq - sine2) / _square_modulus(cq + sine2)
    # Rounding may take total reflection above one.
    perpendicular = np.minimum(perpendicular, 1.0)
    return np.asarray(perpendicular), np.asarray(perpendicular * ratio)


def smooth_dolp(cos_incidence: ArrayLike, eta: ArrayLike) -> Float64Array:
    """Degree of polarisation (F_⊥ − F_∥)/(F_⊥ + F_∥) of light reflected by a smooth surface.

    Defined at eta = 1 too, as the limit eta → 1. Arguments and errors as in `reflectances`.

    Examples
    --------
    At Brewster's angle, tan γ = eta, the reflection is completely polarised:

    >>> round(float(smooth_dolp(1 / np.sqrt(1 + 1.5**2), 1.5)), 12)
    1.0
    """
    cosine, index = _checked(cos_incidence, eta)
    q = refracted(cosine, excess(index))
    sine2 = (1.0 - cosine) * (1.0 + cosine)
    norm = cosine * cosine * _square_modulus(q) + sine2 * sine2
    # 0 only at γ = 0 with an index so small that its square underflows
    return np.asarray(2.0 * cosine * q.real * sine2 / np.maximum(norm, 1e-300))


def transmission_dolp(cos_incidence: ArrayLike, eta: ArrayLike) -> Float64Array:
    """Degree of polarisation ρ_d = (T_∥ − T_⊥)/(T_∥ + T_⊥) of diffuse light, T = 1 − F.

    Positive means parallel to the plane of normal and viewer. Arguments and errors as in
    `reflectances`; `cos_incidence` is the cosine of the angle outside the body.

    For real η, T_∥/T_⊥ = 1/cos²(γ − γ') gives ρ_d = sin²(γ − γ')/(1 + cos²(γ − γ')), written
    with sin(γ − γ') = s δ/(η (c + q)) so that it keeps all digits at η = 1 and at γ = 0. Where
    η < 1 reflects totally, nothing is transmitted; ρ_d is then its limit (1 − η²)/(1 + η²).

    Examples
    --------
    >>> round(float(transmission_dolp(0.5, 1.5)), 6)
    0.095941
    """
    cosine, index = _checked(cos_incidence, eta)
    cosine, index = np.broadcast_arrays(cosine, index)
    delta = excess(index)
    q = refracted(cosine, delta)
    sine2 = (1.0 - cosine) * (1.0 + cosine)
    outgoing = np.where(cosine + q == 0.0, 1.0, cosine + q)
    if np.iscomplexobj(index):
        return _metal_transmission_dolp(cosine, index, q)
    turned = sine2 * np.square(delta / np.abs(outgoing))
    norm = index * index + _square_modulus(cosine * q + sine2)
    return np.asarray(turned / np.maximum(norm, 1e-300))


def _metal_transmission_dolp(cosine: Float64Array, index: EtaArray, q: EtaArray) -> Float64Array:
    """ρ_d = (F_⊥ − F_∥)/(T_∥ + T_⊥) for complex η, with 4 cos γ divided out of both parts."""
    sine2 = (1.0 - cosine) * (1.0 + cosine)
    sum2 = np.where(cosine + q == 0.0, 1.0, _square_modulus(cosine + q))
    reflected = _square_modulus(excess(index)) / sum2**2
    numerator = q.real * sine2 * reflected / _square_modulus(cosine * q + sine2)
    eta2 = index * index
    parallel = (np.conj(eta2) * q).real / _square_modulus(eta2 * cosine + q)
    total = q.real / sum2 + parallel
    limit = np.abs(1.0 - eta2.real) / (1.0 + eta2.real)
    return np.asarray(np.where(total > 0.0, numerator / np.where(total > 0.0, total, 1.0), limit))
