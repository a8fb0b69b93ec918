"""Rows of an observation as flat arrays of pixels; invalid pixels are replaced by ordinary ones."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from malus.reconstruct.fresnel import EtaArray, checked_eta, physical
from malus.reconstruct.observation import Image, Observation
from malus.scenes.core.arrays import AnyArray, BoolArray, Float64Array
from malus.scenes.polarisation import viewing_frame

ALPHA_LIMITS = (1e-150, 1e150)
"""Range of roughnesses whose square is a number."""


@dataclass(frozen=True)
class Block:
    """Some rows of an observation; quantities that several lobe models need are computed once.

    A pixel that is not `valid` is replaced: black, facing the viewer, of an ordinary material.
    """

    observation: Observation
    rows: slice

    @functools.cached_property
    def dtype(self) -> np.dtype[Any]:
        """Precision of the result: float32, or float64 for float64 intensities."""
        return np.result_type(self.observation.require("specular"), np.float32)

    @property
    def frame_length(self) -> float:
        """Length of (cos 2φ, sin 2φ), so little below 1 that no rounded degree exceeds 1."""
        return below_one(self.dtype)

    @property
    def pixels(self) -> slice:
        """Indices of these pixels in the flat image."""
        height, width = self.observation.mask.shape
        start, stop, _ = self.rows.indices(height)
        return slice(start * width, stop * width)

    def _flat(self, values: AnyArray) -> AnyArray:
        """These rows of an image (height, width, …) as (pixels, …)."""
        part = values[self.rows]
        return part.reshape(part.shape[0] * part.shape[1], *part.shape[2:])

    @functools.cached_property
    def mask(self) -> BoolArray:
        """The object's pixels, (pixels,)."""
        return self._flat(self.observation.mask)

    @functools.cached_property
    def _unchecked(self) -> dict[str, Image]:
        """Lobes (pixels, bands) and normals (pixels, 3) as given, contiguous and of one dtype.

        Normals that are not given are (0, 3).
        """
        given = self.observation
        values = {name: self._flat(given.require(name)) for name in ("specular", "diffuse")}
        if given.normals is None:
            values["normals"] = np.empty((0, 3))
        else:
            values["normals"] = self._flat(given.normals)
            if given.view_direction is not None:
                directions = self._flat(given.view_direction)
                values["normals"] = viewing_frame(values["normals"], directions)
        return {name: np.require(value, self.dtype, ["C", "W"]) for name, value in values.items()}

    @functools.cached_property
    def valid(self) -> BoolArray:
        """Pixels whose inputs are physically valid, (pixels,) bool."""
        from malus.reconstruct.kernels import mark_valid_pixels

        given, unchecked = self.observation, self._unchecked
        valid = np.empty(self.mask.shape, dtype=bool)
        largest = self.dtype.type(np.finfo(self.dtype).max / 2)  # both lobes add up to a number
        mark_valid_pixels(
            unchecked["specular"], unchecked["diffuse"], unchecked["normals"], largest, valid
        )
        if given.view_direction is not None:
            # A frame of three unit vectors shows the image's z axis at its full length.
            axis = viewing_frame(np.array([0.0, 0.0, 1.0]), self._flat(given.view_direction))
            valid &= np.abs(np.sum(np.square(axis), axis=-1) - 1.0) < 1e-3
        if given.eta is not None and np.ndim(given.eta) > 1:
            valid &= physical(self._flat(given.eta)).all(axis=-1)
        if given.alpha is not None and np.ndim(given.alpha) > 0:
            alpha = self._flat(np.asarray(given.alpha))
            valid &= (alpha > ALPHA_LIMITS[0]) & (alpha < ALPHA_LIMITS[1])
        return valid

    @functools.cached_property
    def all_valid(self) -> bool:
        """Whether every pixel is valid."""
        return bool(self.valid.all())

    def _filled(self, values: AnyArray, ordinary: Any) -> AnyArray:
        """Values (pixels, …) with an ordinary value at the pixels that are not valid."""
        if self.all_valid:
            return values
        valid = self.valid.reshape(-1, *[1] * (values.ndim - 1))
        return np.where(valid, values, np.asarray(ordinary, values.dtype))

    def lobe(self, name: str) -> Image:
        """Intensity of the lobe "specular" or "diffuse", (pixels, bands)."""
        return self._filled(self._unchecked[name], 0.0)

    @functools.cached_property
    def normals(self) -> Image:
        """Normals (pixels, 3) in the frame of each pixel, whose z points to the camera."""
        normals = self._filled(self._unchecked["normals"], (0.0, 0.0, 1.0))
        behind = normals[:, 2] < 0  # by rounding only
        if behind.any():
            normals = normals.copy()
            normals[behind, 2] = 0
        return normals

    @functools.cached_property
    def cosine(self) -> Float64Array:
        """Cosine of the zenith angle, (pixels,) in [0, 1]."""
        return np.minimum(self.normals[:, 2].astype(np.float64), 1.0)

    @functools.cached_property
    def basis(self) -> Float64Array:
        """Matrices (pixels, 3, 3), or one (1, 3, 3), from the image frame to that of the pixel."""
        image_frame = np.eye(3)[None]
        if self.observation.view_direction is None:
            return image_frame
        directions = self._flat(self.observation.view_direction).astype(np.float64)
        axes = [viewing_frame(axis, directions) for axis in image_frame[0]]
        return self._filled(np.stack(axes, axis=-1), image_frame)

    @functools.cached_property
    def eta(self) -> EtaArray:
        """Index (pixels, bands), or (1, bands) where it is the same everywhere."""
        shared = uniform_eta(self.observation)
        if shared is not None:
            return shared[None]
        return checked_eta(self._filled(self._flat(np.asarray(self.observation.eta)), 1.5))

    @functools.cached_property
    def alpha(self) -> Float64Array:
        """Roughness (pixels,), or (1,) where it is the same everywhere."""
        shared = uniform_alpha(self.observation)
        if shared is not None:
            return np.array([shared])
        alpha = self._flat(np.asarray(self.observation.alpha, np.float64))
        return self._filled(alpha, 0.3)

    def double_azimuth(self, vectors: AnyArray) -> AnyArray:
        """(cos 2φ, sin 2φ), shape (…, 2), of vectors (…, 3) at azimuth φ; (0, 0) along z."""
        x, y = np.asarray(vectors[..., 0], np.float64), np.asarray(vectors[..., 1], np.float64)
        inverse = self.frame_length / (x * x + y * y + 1e-300)
        return np.stack([(x * x - y * y) * inverse, 2.0 * x * y * inverse], axis=-1)


def below_one(dtype: np.dtype[Any]) -> float:
    """Largest degree of polarisation that rounding to this dtype cannot lift above one."""
    return 1.0 - 4.0 * float(np.finfo(dtype).eps)


def uniform_eta(observation: Observation) -> EtaArray | None:
    """Index (bands,) of the whole image, or None where it is a map.

    Raises
    ------
    Inapplicable
        If it is not given.
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
        If it is not given.
    ValueError
        If it is not positive, or so small or large that its square is no number.
    """
    alpha = np.asarray(observation.require("alpha"), dtype=np.float64)
    if alpha.ndim > 0:
        return None
    if not ALPHA_LIMITS[0] < alpha < ALPHA_LIMITS[1]:
        raise ValueError(f"alpha must be > 0 (1e-150 to 1e150), got {alpha}")
    return float(alpha)
