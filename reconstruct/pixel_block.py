"""Rows of an observation as flat arrays of pixels that one can calculate with."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.fresnel import EtaArray, checked_eta, physical
from malus.reconstruct.observation import Image, Observation
from malus.scenes.polarisation import viewing_frame

ALPHA_LIMITS = (1e-150, 1e150)
"""Between which the square of a roughness is a number."""


@dataclass(frozen=True)
class Block:
    """Some rows of an observation, with what several models of the lobes read computed once.

    Where a pixel is not `valid`, it is black, faces the viewer and is of an ordinary material.
    """

    observation: Observation
    rows: slice

    @functools.cached_property
    def dtype(self) -> np.dtype[Any]:
        """Precision of the result: float32, or float64 for float64 intensities."""
        return np.result_type(self.observation.require("specular"), np.float32)

    @property
    def longest(self) -> float:
        """Length of (cos 2φ, sin 2φ): degrees of polarisation up to one stay so when rounded."""
        return below_one(self.dtype)

    @property
    def pixels(self) -> slice:
        """Where these pixels are in the flat image."""
        height, width = self.observation.mask.shape
        start, stop, _ = self.rows.indices(height)
        return slice(start * width, stop * width)

    def _flat(self, values: NDArray[Any]) -> NDArray[Any]:
        """(height, width, …) to (pixels, …) of these rows."""
        part = values[self.rows]
        return part.reshape(part.shape[0] * part.shape[1], *part.shape[2:])

    @functools.cached_property
    def mask(self) -> NDArray[np.bool_]:
        """The object's pixels, (pixels,)."""
        return self._flat(self.observation.mask)

    @functools.cached_property
    def _raw(self) -> dict[str, Image]:
        """What loops read, in order and in one precision; no normals are (0, 3)."""
        known, view = self.observation, self.observation.view_direction
        values = {name: self._flat(known.require(name)) for name in ("specular", "diffuse")}
        if known.normals is None:
            values["normals"] = np.empty((0, 3))
        else:
            values["normals"] = self._flat(known.normals)
            if view is not None:
                values["normals"] = viewing_frame(values["normals"], self._flat(view))
        return {name: np.require(value, self.dtype, ["C", "W"]) for name, value in values.items()}

    @functools.cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Pixels (pixels,) where everything that is known could be so."""
        from malus.reconstruct.kernels import accept

        good = np.empty(self.mask.shape, dtype=bool)
        most = self.dtype.type(np.finfo(self.dtype).max / 2)  # both lobes add up to a number
        accept(self._raw["specular"], self._raw["diffuse"], self._raw["normals"], most, good)
        known = self.observation
        if known.view_direction is not None:
            # A frame of three unit vectors shows the image's z axis at its full length.
            axis = viewing_frame(np.array([0.0, 0.0, 1.0]), self._flat(known.view_direction))
            good &= np.abs(np.sum(np.square(axis), axis=-1) - 1.0) < 1e-3
        if known.eta is not None and np.ndim(known.eta) > 1:
            good &= physical(self._flat(known.eta)).all(axis=-1)
        if known.alpha is not None and np.ndim(known.alpha) > 0:
            alpha = self._flat(np.asarray(known.alpha))
            good &= (alpha > ALPHA_LIMITS[0]) & (alpha < ALPHA_LIMITS[1])
        return good

    @functools.cached_property
    def all_valid(self) -> bool:
        """Whether every pixel is."""
        return bool(self.valid.all())

    def _filled(self, values: NDArray[Any], ordinary: Any) -> NDArray[Any]:
        if self.all_valid:
            return values
        valid = self.valid.reshape(-1, *[1] * (values.ndim - 1))
        return np.where(valid, values, np.asarray(ordinary, values.dtype))

    def lobe(self, name: str) -> Image:
        """Intensity "specular" or "diffuse", (pixels, bands)."""
        return self._filled(self._raw[name], 0.0)

    @functools.cached_property
    def normals(self) -> Image:
        """Normals in the frame that each pixel is seen in, (pixels, 3)."""
        return self._filled(self._raw["normals"], (0.0, 0.0, 1.0))

    @functools.cached_property
    def cosine(self) -> NDArray[np.float64]:
        """Cosine of the zenith angle, (pixels,) in [0, 1]."""
        return np.minimum(self.normals[:, 2].astype(np.float64), 1.0)

    @functools.cached_property
    def basis(self) -> NDArray[np.float64]:
        """Matrices (pixels, 3, 3), or one (1, 3, 3), from the image frame to that of the pixel."""
        image_frame = np.eye(3)[None]
        if self.observation.view_direction is None:
            return image_frame
        view = self._flat(self.observation.view_direction).astype(np.float64)
        axes = [viewing_frame(axis, view) for axis in image_frame[0]]
        return self._filled(np.stack(axes, axis=-1), image_frame)

    @functools.cached_property
    def eta(self) -> EtaArray:
        """Index (pixels, bands), or (1, bands) where it is the same everywhere."""
        shared = uniform_eta(self.observation)
        if shared is not None:
            return shared[None]
        return checked_eta(self._filled(self._flat(np.asarray(self.observation.eta)), 1.5))

    @functools.cached_property
    def alpha(self) -> NDArray[np.float64]:
        """Roughness (pixels,), or (1,) where it is the same everywhere."""
        shared = uniform_alpha(self.observation)
        if shared is not None:
            return np.array([shared])
        alpha = self._flat(np.asarray(self.observation.alpha, np.float64))
        return self._filled(alpha, 0.3)

    def double_azimuth(self, vectors: NDArray[Any]) -> NDArray[Any]:
        """(cos 2φ, sin 2φ) of vectors (…, 3) without trigonometry; (0, 0) along z."""
        x, y = np.asarray(vectors[..., 0], np.float64), np.asarray(vectors[..., 1], np.float64)
        inverse = self.longest / (x * x + y * y + 1e-300)
        return np.stack([(x * x - y * y) * inverse, 2.0 * x * y * inverse], axis=-1)


def below_one(dtype: np.dtype[Any]) -> float:
    """The largest degree of polarisation that rounding cannot lift above one."""
    return 1.0 - 4.0 * float(np.finfo(dtype).eps)


def uniform_eta(observation: Observation) -> EtaArray | None:
    """Index (bands,) of the whole image, or None where it is a map.

    Raises
    ------
    Inapplicable
        If it is not known.
    ValueError
        If it is no index.
    """
    eta = np.asarray(observation.require("eta"))
    return checked_eta(eta) if eta.ndim == 1 else None


def uniform_alpha(observation: Observation) -> float | None:
    """Roughness of the whole image, or None where it is a map.

    Raises
    ------
    Inapplicable
        If it is not known.
    ValueError
        If it is not positive, or so small or large that its square is no number.
    """
    alpha = np.asarray(observation.require("alpha"), dtype=np.float64)
    if alpha.ndim > 0:
        return None
    if not ALPHA_LIMITS[0] < alpha < ALPHA_LIMITS[1]:
        raise ValueError(f"alpha must be > 0 (1e-150 to 1e150), got {alpha}")
    return float(alpha)
