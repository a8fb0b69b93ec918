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
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.fresnel import smooth_dolp
from malus.reconstruct.observation import Image, Inapplicable, Observation
from malus.reconstruct.ratio import Measure
from malus.reconstruct.table import BodyTable, DolpTable
from malus.scenes.lights import Distant
from malus.scenes.polarisation import viewing_frame

Plane: TypeAlias = Image  # (height, width), or anything that broadcasts to it


class Polarisation(NamedTuple):
    """s1/s0 = degree · cos2 and s2/s0 = degree · sin2 of one lobe; each has one plane a band."""

    degree: Sequence[Plane]
    cos2: Sequence[Plane]
    sin2: Sequence[Plane]


@dataclass(frozen=True)
class Block:
    """Some rows of an observation as planes, with what several models read computed once.

    The planes hold numbers that one can calculate with: where a pixel is not `valid` they say
    that it is black and faces the viewer.
    """

    observation: Observation

    @functools.cached_property
    def dtype(self) -> np.dtype[Any]:
        """Precision of the result: float32, or float64 for float64 intensities."""
        return np.result_type(self.observation.require("specular"), np.float32)

    @functools.cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Pixels whose intensities are physical and whose normal, where given, is one."""
        lobes = [self.observation.require(name) for name in ("specular", "diffuse")]
        good = np.ones(self.observation.mask.shape, dtype=bool)
        most = np.finfo(self.dtype).max / 2  # the sum of both lobes must be a number as well
        for lobe in lobes:
            # NaN passes through both extremes and compares False.
            if lobe.size and not (lobe.min() >= 0 and lobe.max() <= most):
                good &= np.all((lobe >= 0) & (lobe <= most), axis=-1)
        if self.observation.normals is not None:
            good &= self._unit_normals
        if self.observation.view is not None:
            # A frame of three unit vectors: it shows z at full length.
            frame = viewing_frame(np.array([0.0, 0.0, 1.0]), self.observation.view)
            good &= np.abs(np.sum(np.square(frame), axis=-1) - 1.0) < 1e-3
        return good

    @functools.cached_property
    def _unit_normals(self) -> NDArray[np.bool_]:
        """Normals of length one that face the viewer."""
        x, y, z = self._raw_normal
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is no unit vector
            excess = x * x
            excess += y * y
            excess += z * z
            excess -= 1
        # float32 normals that were averaged and normalised again are unit to 1e-6
        good: NDArray[np.bool_] = np.abs(excess, out=excess) < 1e-3
        good &= z >= 0
        return good

    @functools.cached_property
    def _raw_normal(self) -> list[Plane]:
        normals, view = self.observation.require("normals"), self.observation.view
        if view is not None:
            normals = viewing_frame(normals, view)
        return [np.ascontiguousarray(normals[..., k], dtype=self.dtype) for k in range(3)]

    def to_frame(self, direction: NDArray[np.float64]) -> NDArray[np.float64]:
        """A direction (3,) of the image frame as the pixels see it, (height or 1, width or 1, 3).

        Where a pixel is not `valid`, as an orthographic camera sees it.
        """
        view = self.observation.view
        if view is None:
            return direction[None, None]
        seen = viewing_frame(direction, np.asarray(view, np.float64))
        return np.where(self.valid[..., None], seen, direction)

    @functools.cached_property
    def all_valid(self) -> bool:
        """Whether every pixel is."""
        return bool(self.valid.all())

    def lobe(self, name: str) -> list[Plane]:
        """Planes of the intensity "specular" or "diffuse"."""
        values = self.observation.require(name)
        planes = [
            np.ascontiguousarray(values[..., k], dtype=self.dtype) for k in range(values.shape[-1])
        ]
        return planes if self.all_valid else [self._filled(plane, 0) for plane in planes]

    @functools.cached_property
    def normal(self) -> tuple[Plane, Plane, Plane]:
        """Components of the normals in the frame that the pixel is seen in."""
        x, y, z = self._raw_normal
        if not self.all_valid:
            x, y, z = (
                self._filled(plane, to) for plane, to in zip((x, y, z), (0, 0, 1), strict=True)
            )
        return x, y, z

    def _filled(self, plane: Plane, value: float) -> Plane:
        return np.where(self.valid, plane, plane.dtype.type(value))

    @functools.cached_property
    def root_cosine(self) -> Plane:
        """√cos θ of the zenith angle, in which tables are read."""
        return np.sqrt(self.normal[2])

    @functools.cached_property
    def double_azimuth(self) -> tuple[Plane, Plane]:
        """(cos 2φ, sin 2φ) of the normals."""
        return double_azimuth(*self.normal[:2])


BlockModel = Callable[[Block], Polarisation]
LobeModel = Callable[[Observation], BlockModel]


def below_one(dtype: np.dtype[Any]) -> float:
    """The largest degree of polarisation that rounding cannot lift above one."""
    return 1.0 - 4.0 * float(np.finfo(dtype).eps)


def double_azimuth(x: Plane, y: Plane) -> tuple[Plane, Plane]:
    """(cos 2φ, sin 2φ) of the azimuth of (x, y) without trigonometry; (0, 0) at the origin.

    Shorter than one by a few roundings, so that no degree of polarisation exceeds one.

    Examples
    --------
    >>> [round(v.item(), 12) for v in double_azimuth(np.array(0.0), np.array(2.0))]
    [-1.0, 0.0]
    """
    dtype = np.result_type(x, y)
    x2, y2 = x * x, y * y
    # Where the squares underflow, both numerators are zero as well.
    inverse = dtype.type(below_one(dtype)) / (x2 + y2 + 16 * np.finfo(dtype).tiny)
    sine = x * y
    sine += sine
    return (x2 - y2) * inverse, sine * inverse


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
