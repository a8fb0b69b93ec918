"""Rows of an observation as planes, with what several models of the lobes read computed once."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.observation import Image, Observation
from malus.scenes.polarisation import viewing_frame

Plane: TypeAlias = Image  # (height, width), or anything that broadcasts to it


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
