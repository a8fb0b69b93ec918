"""A clear sky by day: Hosek and Wilkie's model, and its sun.

Source: Hosek and Wilkie, "An analytic model for full spectral sky-dome radiance", ACM TOG 31
(2012), and "Adding a solar-radiance function to the Hosek-Wilkie skylight model", IEEE CG&A 33
(2013), as in Mitsuba's `sunsky`. `data/sky.npz` holds the authors' coefficients from
Mitsuba's data files, for a ground of reflectance 0.3 (copyright 2012-2013 Lukas Hosek and
Alexander Wilkie, `data/sky_licence.txt`). Below the horizon it is dark. The model says nothing of
polarisation: that of a `polarised` sky is in `malus.scenes.lights.polarised`.
"""

from __future__ import annotations

import functools
import math
from importlib import resources

import numpy as np

from malus.scenes.core.arrays import Float64Array
from malus.scenes.lights.lights import Distant, Light, Sky, rotated, turned

STEP_NM, FIRST_NM = 40.0, 400.0
"""Step and first wavelength of the tables."""
SUN_ELEVATIONS_DEG = (2.0, 88.0)
"""Range of elevations over which the sun's irradiance is tabulated in equal steps."""


def parts(light: Light) -> tuple[Light, ...]:
    """The lights whose sum is `light`: a sky and its sun, which is parallel light.

    Its disc of 0.27° radius is narrower than any lobe of the roughnesses here.

    Examples
    --------
    >>> [part.kind for part in parts(Sky(sun_elevation_deg=30))]
    ['sky', 'distant']
    """
    if isinstance(light, Sky) and light.sun:
        return light.model_copy(update={"sun": False}), sun(light)
    return (light,)


def radiance(sky: Sky, toward: Float64Array) -> Float64Array:
    """Radiance (...) of the sky without its sun at unit vectors (..., 3).

    In W m⁻² sr⁻¹ nm⁻¹; zero below the horizon. The vectors are in the sky's own axes, before it is
    turned.

    Examples
    --------
    >>> up, down = radiance(Sky(), np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]))
    >>> bool(up > 0.02), float(down)
    (True, 0.0)
    """
    to_sun = np.array(sky.to_sun)
    above = toward[..., 1] > 0
    cos_zenith = np.where(above, toward[..., 1], 1.0)
    cos_gamma = np.clip(toward @ to_sun, -1.0, 1.0)
    gamma = np.arccos(cos_gamma)
    total = np.zeros(above.shape)
    for band, weight in _bands(sky.wavelength_nm):
        (a, b, c, d, e, f, g, h, i), scale = _coefficients(sky, band)
        glow = (1 + cos_gamma**2) / (1 + i * i - 2 * i * cos_gamma) ** 1.5
        horizon = 1 + a * np.exp(b / (cos_zenith + 0.01))
        around = c + d * np.exp(e * gamma) + f * cos_gamma**2 + g * glow + h * np.sqrt(cos_zenith)
        total += weight * scale * horizon * around
    return np.where(above, np.maximum(total, 0.0), 0.0)


def sun(sky: Sky) -> Distant:
    """The sun of a sky, turned with it; its irradiance is in W m⁻² nm⁻¹.

    Examples
    --------
    >>> 0.5 < sun(Sky(sun_elevation_deg=45)).irradiance < 1.5
    True
    """
    table = _at_turbidity(_data()["sun"], sky.turbidity)
    elevations = np.linspace(*SUN_ELEVATIONS_DEG, len(table))
    irradiance = sum(
        weight * np.interp(sky.sun_elevation_deg, elevations, table[:, band])
        for band, weight in _bands(sky.wavelength_nm)
    )
    light: Light = Distant.towards(sky.to_sun, float(irradiance))
    if sky.tilt_deg or sky.heading_deg:
        light = rotated(light, sky.rotation)
    else:
        light = turned(light, sky.turn_deg)
    assert isinstance(light, Distant)
    return light


@functools.cache
def _data() -> dict[str, Float64Array]:
    entry = resources.files("malus.scenes") / "data" / "sky.npz"
    with entry.open("rb") as file, np.load(file) as stored:
        return {name: stored[name].astype(np.float64) for name in stored.files}


def _bands(wavelength_nm: float) -> tuple[tuple[int, float], ...]:
    """Columns of the two tabulated wavelengths beside one, and their linear weights."""
    column = (wavelength_nm - FIRST_NM) / STEP_NM
    low = min(int(column), len(_data()["sun"][0, 0]) - 2)
    return (low, 1.0 - (column - low)), (low + 1, column - low)


def _at_turbidity(table: Float64Array, turbidity: float) -> Float64Array:
    """Row of a table at a turbidity, linear between the tabulated 1, 2, ..., 10."""
    low = min(int(turbidity) - 1, len(table) - 2)
    weight = turbidity - 1 - low
    result: Float64Array = (1.0 - weight) * table[low] + weight * table[low + 1]
    return result


def _coefficients(sky: Sky, band: int) -> tuple[Float64Array, float]:
    """Coefficients (9,) of the model's Equation 8 and mean radiance, by a Bézier in elevation."""
    x = (sky.sun_elevation_deg / 90.0) ** (1 / 3)
    bezier = np.array([math.comb(5, k) * x**k * (1 - x) ** (5 - k) for k in range(6)])
    shape = _at_turbidity(_data()["shape"][:, :, band], sky.turbidity)
    scale = _at_turbidity(_data()["radiance"][:, :, band], sky.turbidity)
    return bezier @ shape, float(bezier @ scale)
