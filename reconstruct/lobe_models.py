"""How each lobe of the reflected light is polarised, pixel by pixel and band by band.

A lobe model is given an observation once and prepares what the whole image shares, such as
tables. Specular light is polarised perpendicular to the plane of reflection, diffuse light parallel
to the plane of N and V. With φ the azimuth of the plane, (s1/s0, s2/s0) is

    specular: (−ρ cos 2φ, −ρ sin 2φ)        diffuse: (+ρ_d cos 2φ, +ρ_d sin 2φ).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from malus.reconstruct.facets.maps import mapped_dolp
from malus.reconstruct.facets.ratio import Measure
from malus.reconstruct.facets.table import (
    DiffuseTable,
    DolpTable,
    SmoothTable,
    Table,
    specular_columns,
)
from malus.reconstruct.fresnel import smooth_dolp, transmission_dolp
from malus.reconstruct.observation import Image, Inapplicable, Observation
from malus.reconstruct.pixel_block import Block, uniform_alpha, uniform_eta
from malus.scenes.core.arrays import AnyArray, Float64Array
from malus.scenes.lights.lights import Distant

DolpFunction = Callable[[Block], AnyArray]
"""Degree of polarisation ρ (pixels or 1, bands) of the pixels of a block."""

StokesRatios = Callable[[Block], Image]
"""s1/s0 and s2/s0 (pixels or 1, bands, 2) of the pixels of a block, in the frame of each."""


class ZenithTables(NamedTuple):
    """Polarisation about the normal that depends on the zenith angle alone.

    `columns` (steps + 1, bands) are s1/s0 at azimuth 0, on even steps of √cos θ from 0 to 1, over
    `sign`.
    """

    columns: Float64Array
    sign: int


Lobe = ZenithTables | StokesRatios
LobeModel = Callable[[Observation], Lobe]


def microfacets(asked: Measure) -> LobeModel:
    """The paper's model: ρ(θ, σ, η) of Equation 8 about the mean normal, for one measure.

    Facets have Gaussian slopes, unless `shadowed` is told of GGX facets.
    """

    def prepare(observation: Observation) -> Lobe:
        told_ggx = asked == "shadowed" and observation.distribution == "ggx"
        measure: Measure = "shadowed_ggx" if told_ggx else asked
        observation.require("normals")
        eta, alpha = uniform_eta(observation), uniform_alpha(observation)
        if eta is None or alpha is None:
            return _pixelwise(mapped_dolp(observation, measure), -1)
        columns = specular_columns(eta, alpha**-2.0, measure)
        if columns is not None:
            return ZenithTables(columns, -1)
        return _tabulated([DolpTable(index, alpha**-2.0, measure) for index in eta], -1)

    return prepare


def diffuse(observation: Observation) -> Lobe:
    """Diffuse light polarised as it leaves the body: ρ_d from Fresnel's transmittances at θ."""
    return _from_index(observation, DiffuseTable, transmission_dolp, 1)


def smooth(observation: Observation) -> Lobe:
    """Specular light of a smooth surface: Fresnel's reflectances at the zenith angle, no facets.

    Source: Wolff and Boult, "Constraining object features using a polarization reflectance
    model", IEEE TPAMI 13 (1991).
    """
    return _from_index(observation, SmoothTable, smooth_dolp, -1)


def _from_index(
    observation: Observation,
    table: Callable[[complex], Table],
    dolp: Callable[..., Float64Array],
    sign: int,
) -> Lobe:
    """A lobe that zenith angle and index decide: tabulated where there is one index a band."""
    observation.require("normals")
    eta = uniform_eta(observation)
    if eta is None:
        return _pixelwise(lambda block: dolp(block.cosine[:, None], block.eta), sign)
    return _tabulated([table(index) for index in eta], sign)


def _tabulated(tables: Sequence[Table], sign: int) -> Lobe:
    """A lobe from one table a band; `sign` +1 is parallel to the plane of normal and viewer."""
    grids = [table.grid for table in tables if table.grid is not None]
    if len(grids) == len(tables):
        steps = max(grid.size for grid in grids)
        return ZenithTables(np.stack([on_steps(grid, steps) for grid in grids], axis=-1), sign)
    # Of nearly smooth surfaces near a critical angle no even grid is fine enough.
    return _pixelwise(
        lambda block: np.stack([table(block.cosine) for table in tables], axis=-1), sign
    )


def on_steps(columns: Float64Array, steps: int) -> Float64Array:
    """Values (steps, …) on straight lines between those of a coarser even grid."""
    if len(columns) == steps:
        return columns
    old, new = np.linspace(0.0, 1.0, len(columns)), np.linspace(0.0, 1.0, steps)
    flat = columns.reshape(len(columns), -1)
    fine = np.stack([np.interp(new, old, column) for column in flat.T], axis=-1)
    return fine.reshape(steps, *columns.shape[1:])


def _pixelwise(dolp: DolpFunction, sign: int) -> StokesRatios:
    """A lobe computed pixel by pixel; `sign` +1 is parallel to the plane of normal and viewer."""

    def ratios(block: Block) -> Image:
        frame = block.double_azimuth(block.normals)
        polarised: Image = sign * dolp(block)[:, :, None] * frame[:, None, :]
        return polarised.astype(block.dtype)

    return ratios


def half_vector(observation: Observation) -> Lobe:
    """Specular light of a distant light: its facets' normal M is the half vector H."""
    light = observation.require("light")
    if not isinstance(light, Distant):
        raise Inapplicable(f"needs a distant light, found {light.kind}")
    uniform_eta(observation)  # raises where η is missing or unphysical, before any work

    def ratios(block: Block) -> Image:
        half = block.basis @ np.array(light.direction) + np.array([0.0, 0.0, 1.0])
        half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-150)
        rho = smooth_dolp(np.clip(half[:, 2:], 0.0, 1.0), block.eta)
        frame = block.double_azimuth(half)
        polarised: Image = -rho[:, :, None] * frame[:, None, :]
        return polarised.astype(block.dtype)

    return ratios
