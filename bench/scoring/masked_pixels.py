"""The pixels in the mask of a truth, as methods are given them when they are scored.

A method is given the pixels in two rows: as rendered, and with one draw of their Monte Carlo noise
added. What it makes of both says how much of its error is noise.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.bench.scoring.observe import inputs, observe
from malus.bench.scoring.pixel_kernels import gather
from malus.reconstruct import Components, Method, Observation
from malus.reconstruct.observation import INPUTS
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class MaskedPixels:
    """The pixels in the mask of a truth, with everything that a method may be told about them.

    Attributes
    ----------
    truth : Truth
    indices : (pixels,)
        Flat indices of the mask's pixels.
    observation : Observation
        A picture of (2, pixels): as rendered, and with one draw of the noise added.
    true, draw : (2, pixels, bands)
        s1 and s2 of the truth, and of the draw of its noise.
    """

    truth: Truth
    indices: NDArray[np.intp]
    observation: Observation
    true: FloatArray
    draw: FloatArray

    @classmethod
    def of(cls, truth: Truth) -> MaskedPixels:
        """Gather the pixels in the mask of a truth."""
        indices = np.flatnonzero(truth.mask)
        bands = truth.specular.shape[2]
        dtype = truth.specular.dtype
        specular, diffuse, image, true, draw = (
            np.empty((2, len(indices), bands), dtype) for _ in range(5)
        )
        gather(
            indices,
            (_flat(truth.specular), _flat(truth.specular_noise)),
            (_flat(truth.diffuse), _flat(truth.diffuse_noise)),
            (specular, diffuse, image),
            (true, draw),
        )
        others = inputs(truth, INPUTS - {"specular", "diffuse"})
        observation = Observation(
            image=image,
            mask=np.ones((2, len(indices)), dtype=bool),
            specular=specular if truth.scene.lobes_known else None,
            diffuse=diffuse if truth.scene.lobes_known else None,
            **{name: two_rows(value, indices, truth.mask.shape) for name, value in others.items()},
        )
        return cls(truth, indices, observation, true, draw)

    def estimate(self, method: Method, observation: Observation | None = None) -> Components:
        """Estimate of a method for both rows, (2, pixels, bands).

        Another `observation` than that of the truth may be given to a method that works pixel by
        pixel. Any other method is given whole pictures, and the pixels are taken from its results;
        what it tells of them besides is that of the picture as rendered, in one row.
        """
        if method.per_pixel:
            withheld: dict[str, Any] = dict.fromkeys(INPUTS - method.needs)
            return method.reconstruct(replace(observation or self.observation, **withheld))
        results = [
            method.reconstruct(observe(truth, method.needs)) for truth in (self.truth, self._half)
        ]
        image, s1, s2 = (
            self._rows([getattr(result, name) for result in results]) for name in _STOKES
        )
        told = results[0]
        valid = None if told.valid is None else told.valid.reshape(1, -1)[:, self.indices]
        deviation = None if told.deviation is None else self._rows([told.deviation])
        return Components(image, s1, s2, valid, told.converged, deviation)

    def stokes_of(self, estimate: Components) -> tuple[FloatArray, FloatArray]:
        """Estimated Stokes vectors (pixels, bands, 3), and what the draw changes in their errors.

        The draw changes the estimate and the truth: what both change by alike is no error.
        """
        both = np.stack([getattr(estimate, name) for name in _STOKES], axis=-1)
        image, draw = self.observation.image, self.draw
        drawn = np.stack([image[1] - image[0], *draw], axis=-1)
        return both[0], np.subtract(both[1], both[0], dtype=np.float64) - drawn

    @functools.cached_property
    def as_rendered(self) -> BoolArray:
        """Mask (2, pixels) of the first row alone: the pixels without the draw of the noise."""
        return self.observation.mask & np.array([[True], [False]])

    @functools.cached_property
    def _half(self) -> Truth:
        """The truth with the draw of its noise added: from an independent half of the samples."""
        return self.truth.halves()[0]

    def _rows(self, images: list[Any]) -> FloatArray:
        """The mask's pixels of whole images, as rows (images, pixels, bands)."""
        bands = self.true.shape[2]
        return np.stack([image.reshape(-1, bands)[self.indices] for image in images])


_STOKES = ("image", "s1", "s2")


def _flat(stokes: FloatArray) -> FloatArray:
    """Stokes vectors (height, width, bands, 3) with all pixels on one axis."""
    return stokes.reshape(-1, *stokes.shape[2:])


def two_rows(value: Any, indices: NDArray[np.intp], shape: tuple[int, ...]) -> Any:
    """Values of an image at `indices`, repeated in two rows; values that are no image unchanged."""
    if np.shape(value)[:2] != shape:
        return value
    values = value.reshape(-1, *value.shape[2:]).take(indices, axis=0)
    return np.stack([values, values])
