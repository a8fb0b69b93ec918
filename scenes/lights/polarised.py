"""How the light from a direction is polarised: behind a polariser, or from a clear sky.

Behind a flat sheet polariser light oscillates across its absorbing axis, whatever the angle at
which it crosses the sheet.
Source: Korger et al., "The polarization properties of a tilted polarizer", Optics Express 21
(2013).

The light of a clear sky is taken for sunlight that air scattered once. It oscillates across the
plane of sun, sky and observer, and its degree at the angle γ from the sun is
δ sin²γ / (1 + cos²γ), with a largest degree δ below 1 for all that the single scattering leaves
out: haze, light scattered twice, light from the ground.
Source: Strutt (Lord Rayleigh), "On the light from the sky, its polarization and colour",
Philosophical Magazine 41 (1871); with a largest degree: Wilkie et al., "An analytical model for
skylight polarisation", Eurographics Symposium on Rendering (2004). Neutral points beside the sun
and its opposite, which come from light scattered twice, are not part of it: here both are in the
sun and opposite it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from malus.scenes.core.arrays import Float64Array
from malus.scenes.lights.lights import Area, Distant, Light, Sky, transmission_axis


@dataclass(frozen=True)
class Oscillation:
    """Light from the direction t oscillates along t × `axis`.

    Attributes
    ----------
    axis : (3,)
        Unit vector in the world: a polariser's absorbing axis, or the direction to the sun.
    degree : float
        Degree of polarisation; of `scattered` light the largest.
    scattered : bool
        Whether the degree falls from its largest as sin²γ / (1 + cos²γ), γ the angle to the axis.
    """

    axis: tuple[float, float, float]
    degree: float
    scattered: bool


def oscillation(light: Light) -> Oscillation | None:
    """How the light of one part of a light is polarised; None where it is not.

    Examples
    --------
    >>> oscillation(Sky(polarised={"degree": 0.7}, sun=False)).degree
    0.7
    """
    if isinstance(light, Distant | Area) and light.polarised:
        absorbing = np.cross(light.direction, transmission_axis(light))
        return Oscillation(_triple(absorbing), light.polarised.degree, scattered=False)
    if isinstance(light, Sky) and light.polarised:
        to_sun = light.rotation @ np.array(light.to_sun)
        return Oscillation(_triple(to_sun), light.polarised.degree, scattered=True)
    return None


def is_polarised(light: Light) -> bool:
    """Whether any of the light is polarised.

    Examples
    --------
    >>> is_polarised(Sky()), is_polarised(Sky(polarised={"degree": 0.7}))
    (False, True)
    """
    return isinstance(light, Distant | Area | Sky) and light.polarised is not None


def _triple(vector: Float64Array) -> tuple[float, float, float]:
    x, y, z = map(float, vector)
    return x, y, z
