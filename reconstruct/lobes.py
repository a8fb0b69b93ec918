"""How each lobe of the reflected light is polarised, pixel by pixel and band by band.

A lobe model is given an observation once and prepares what the whole image shares, such as
tables. What it returns is called with one block of the image after another and says how the lobe
is polarised there, in planes: one array (height, width) a band, contiguous in memory.
Specular light polarises perpendicular to the plane of reflection and light that left the body
parallel to the plane of N and V, so that with φ the azimuth of the plane (s1/s0, s2/s0) is

    specular: (−ρ cos 2φ, −ρ sin 2φ)        body: (+ρ_d cos 2φ, +ρ_d sin 2φ).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from malus.reconstruct.block import Block, Plane, below_one, double_azimuth
from malus.reconstruct.fresnel import smooth_dolp
from malus.reconstruct.observation import Inapplicable, Observation
from malus.reconstruct.ratio import Measure
from malus.reconstruct.table import BodyTable, DolpTable
from malus.scenes.lights import Distant


class Polarisation(NamedTuple):
    """s1/s0 = degree · cos2 and s2/s0 = degree · sin2 of one lobe; each has one plane a band."""

    degree: Sequence[Plane]
    cos2: Sequence[Plane]
    sin2: Sequence[Plane]


BlockModel = Callable[[Block], Polarisation]
LobeModel = Callable[[Observation], BlockModel]


def microfacets(measure: Measure) -> LobeModel:
    """The paper's model: ρ(θ, σ, η) of Equation 8 about the mean normal, for one measure."""

    def prepare(observation: Observation) -> BlockModel:
        observation.require("normals")
        sigma = one_alpha(observation) ** -2.0
        tables = [DolpTable(eta, sigma, measure) for eta in one_index(observation)]
        return functools.partial(_about_normals, tables=tables, sign=-1)

    return prepare


def body(observation: Observation) -> BlockModel:
    """Light that left the body: ρ_d from what the interface transmits at the zenith angle."""
    observation.require("normals")
    tables = [BodyTable(eta) for eta in one_index(observation)]
    return functools.partial(_about_normals, tables=tables, sign=1)


def _about_normals(
    block: Block, tables: Sequence[DolpTable | BodyTable], sign: int
) -> Polarisation:
    """± ρ of one table a band in the frame of the normals."""
    degree = [table.at_root(block.root_cosine) for table in tables]
    if sign < 0:
        for plane in degree:
            np.negative(plane, out=plane)
    return _in_frame(block, degree)


def _in_frame(block: Block, degree: Sequence[Plane]) -> Polarisation:
    cos2, sin2 = block.double_azimuth
    return Polarisation(degree, [cos2] * len(degree), [sin2] * len(degree))


def smooth(observation: Observation) -> BlockModel:
    """Wolff's smooth surface: Fresnel at the zenith angle, one mirror and no facets.

    Source: Wolff and Boult, "Constraining object features using a polarization reflectance
    model", IEEE TPAMI 13 (1991).
    """
    observation.require("normals")
    eta = one_index(observation)

    def model(block: Block) -> Polarisation:
        cosine = np.minimum(block.normal[2], 1)
        return _in_frame(block, [-smooth_dolp(cosine, n).astype(block.dtype) for n in eta])

    return model


def half_vector(observation: Observation) -> BlockModel:
    """Facets that mirror a distant light: M is the half vector H of light and viewer."""
    light = observation.require("light")
    if not isinstance(light, Distant):
        raise Inapplicable(f"needs a distant light, found {light.kind}")
    eta = np.array(one_index(observation))[:, None, None]

    def model(block: Block) -> Polarisation:
        half = block.to_frame(np.array(light.direction)) + np.array([0.0, 0.0, 1.0])
        half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-150)
        turned = double_azimuth(half[..., 0], half[..., 1])
        frame = [np.asarray(part, block.dtype) for part in turned]
        # Here too rounding must not lift a degree above one.
        rho = below_one(block.dtype) * smooth_dolp(np.clip(half[..., 2], 0.0, 1.0), eta)
        first, second = ([part] * len(rho) for part in frame)
        return Polarisation(list(-rho.astype(block.dtype)), first, second)

    return model


def one_index(observation: Observation) -> list[Any]:
    """The refractive index of every band; raises Inapplicable where it varies over the image."""
    eta = np.asarray(observation.require("eta"))
    if eta.ndim != 1:
        raise Inapplicable("needs one index a band")
    return list(eta.tolist())


def one_alpha(observation: Observation) -> float:
    """The roughness of the surface; raises Inapplicable where it varies over the image.

    Raises
    ------
    ValueError
        If it is not positive, or so small or large that its square is no number.
    """
    alpha = np.asarray(observation.require("alpha"), dtype=np.float64)
    if alpha.ndim != 0:
        raise Inapplicable("needs one roughness for the whole image")
    if not 1e-150 < alpha < 1e150:
        raise ValueError(f"alpha must be > 0 (1e-150 to 1e150), got {alpha}")
    return float(alpha)
