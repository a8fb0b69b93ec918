"""How each lobe of the reflected light is polarised, pixel by pixel and band by band.

A lobe model is given an observation once and prepares what the whole image shares, such as
tables. Specular light polarises perpendicular to the plane of reflection and light that left the
body parallel to the plane of N and V, so that with φ the azimuth of the plane (s1/s0, s2/s0) is

    specular: (−ρ cos 2φ, −ρ sin 2φ)        body: (+ρ_d cos 2φ, +ρ_d sin 2φ).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.facets.maps import mapped_dolp
from malus.reconstruct.facets.ratio import Measure
from malus.reconstruct.facets.table import BodyTable, DolpTable, SmoothTable, Table
from malus.reconstruct.fresnel import smooth_dolp, transmission_dolp
from malus.reconstruct.observation import Image, Inapplicable, Observation
from malus.reconstruct.pixel_block import Block, uniform_alpha, uniform_eta
from malus.scenes.lights.lights import Distant

Degree = Callable[[Block], NDArray[Any]]  # ρ, (pixels or 1, bands)
Ratio = Callable[[Block], Image]  # s1/s0 and s2/s0 in the pixel's frame, (pixels or 1, bands, 2)


class AboutNormals(NamedTuple):
    """s1/s0 at azimuth 0, everywhere the same function of the zenith angle.

    `grids` has one array a band: its values on even steps of √cos θ from 0 to 1.
    """

    grids: Sequence[NDArray[np.float64]]


Lobe = AboutNormals | Ratio
LobeModel = Callable[[Observation], Lobe]


def microfacets(measure: Measure) -> LobeModel:
    """The paper's model: ρ(θ, σ, η) of Equation 8 about the mean normal, for one measure."""

    def prepare(observation: Observation) -> Lobe:
        observation.require("normals")
        eta, alpha = uniform_eta(observation), uniform_alpha(observation)
        if eta is None or alpha is None:
            return _pixelwise(mapped_dolp(observation, measure), -1)
        return _tabulated([DolpTable(index, alpha**-2.0, measure) for index in eta], -1)

    return prepare


def body(observation: Observation) -> Lobe:
    """Light that left the body: ρ_d from what the interface transmits at the zenith angle."""
    return _from_index(observation, BodyTable, transmission_dolp, 1)


def smooth(observation: Observation) -> Lobe:
    """Wolff's smooth surface: Fresnel at the zenith angle, one mirror and no facets.

    Source: Wolff and Boult, "Constraining object features using a polarization reflectance
    model", IEEE TPAMI 13 (1991).
    """
    return _from_index(observation, SmoothTable, smooth_dolp, -1)


def _from_index(
    observation: Observation,
    table: Callable[[complex], Table],
    degree: Callable[..., NDArray[np.float64]],
    sign: int,
) -> Lobe:
    """What zenith angle and index decide: tabulated where there is one index a band."""
    observation.require("normals")
    eta = uniform_eta(observation)
    if eta is None:
        return _pixelwise(lambda block: degree(block.cosine[:, None], block.eta), sign)
    return _tabulated([table(index) for index in eta], sign)


def _tabulated(tables: Sequence[Table], sign: int) -> Lobe:
    grids = [sign * table.grid for table in tables if table.grid is not None]
    if len(grids) == len(tables):
        return AboutNormals(grids)
    # Nearly smooth at a critical angle: no even grid is fine enough.
    return _pixelwise(
        lambda block: np.stack([table(block.cosine) for table in tables], axis=-1), sign
    )


def _pixelwise(degree: Degree, sign: int) -> Ratio:
    """± ρ in the plane of normal and viewer."""

    def ratio(block: Block) -> Image:
        frame = block.double_azimuth(block.normals)
        polarised: Image = sign * degree(block)[:, :, None] * frame[:, None, :]
        return polarised.astype(block.dtype)

    return ratio


def half_vector(observation: Observation) -> Lobe:
    """Facets that mirror a distant light: M is the half vector H of light and viewer."""
    light = observation.require("light")
    if not isinstance(light, Distant):
        raise Inapplicable(f"needs a distant light, found {light.kind}")
    uniform_eta(observation)  # refuses what is none before any work

    def ratio(block: Block) -> Image:
        half = block.basis @ np.array(light.direction) + np.array([0.0, 0.0, 1.0])
        half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-150)
        rho = smooth_dolp(np.clip(half[:, 2:], 0.0, 1.0), block.eta)
        frame = block.double_azimuth(half)
        polarised: Image = -rho[:, :, None] * frame[:, None, :]
        return polarised.astype(block.dtype)

    return ratio
