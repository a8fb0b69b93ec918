"""Dispersion formulas n(λ) of the refractiveindex.info database.

Each takes wavelengths in micrometres and the database's coefficients in its order, and returns the
refractive index in the same shape: NaN where the formula has no real index. In the formulas c are
the coefficients, and i in the pairs (c[i], c[i+1]) is odd.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from malus.scenes.core.arrays import Float64Array

Coefficients = tuple[float, ...]


def _pairs(coefficients: Coefficients) -> Iterator[tuple[float, float]]:
    return zip(coefficients[1::2], coefficients[2::2], strict=True)


def sellmeier_squared_poles(
    wavelength_um: Float64Array, coefficients: Coefficients
) -> Float64Array:
    """Formula 1: n² = 1 + c[0] + Σ c[i] L² / (L² − c[i+1]²), L the wavelength in µm."""
    square = wavelength_um**2
    terms = (a * square / (square - pole**2) for a, pole in _pairs(coefficients))
    return np.sqrt(sum(terms, 1.0 + coefficients[0]))


def sellmeier_direct_poles(wavelength_um: Float64Array, coefficients: Coefficients) -> Float64Array:
    """Formula 2: n² = 1 + c[0] + Σ c[i] L² / (L² − c[i+1]), L the wavelength in µm."""
    square = wavelength_um**2
    terms = (a * square / (square - pole) for a, pole in _pairs(coefficients))
    return np.sqrt(sum(terms, 1.0 + coefficients[0]))


def cauchy(wavelength_um: Float64Array, coefficients: Coefficients) -> Float64Array:
    """Formula 5: n = c[0] + Σ c[i] L^c[i+1], L the wavelength in µm.

    Examples
    --------
    >>> float(cauchy(np.array(0.5), (1.5, 0.01, -2.0)))
    1.54
    """
    terms = (a * wavelength_um**power for a, power in _pairs(coefficients))
    return np.asarray(sum(terms, coefficients[0]), dtype=np.float64)


def polynomial_in_n_squared(
    wavelength_um: Float64Array, coefficients: Coefficients
) -> Float64Array:
    """Formula 3: n² = c[0] + Σ c[i] L^c[i+1], L the wavelength in µm."""
    return np.sqrt(cauchy(wavelength_um, coefficients))


FORMULAS: dict[str, Callable[[Float64Array, Coefficients], Float64Array]] = {
    "sellmeier_squared_poles": sellmeier_squared_poles,
    "sellmeier_direct_poles": sellmeier_direct_poles,
    "polynomial_in_n_squared": polynomial_in_n_squared,
    "cauchy": cauchy,
}
