"""A truth as methods see it when they are scored: only the mask's pixels, twice.

The second row of the picture is the first plus one draw of its Monte Carlo noise. What a method
makes of both says how much of its error is noise.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.bench.scoring.observe import KNOWN, observe, told
from malus.bench.scoring.pixel_kernels import gather
from malus.reconstruct import Components, Method, Observation
from malus.renderers.truth import Truth

Image = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class MaskedPixels:
    """The mask's pixels of a truth, and everything that a method may be told about them.

    Attributes
    ----------
    truth : Truth
    pixels : (pixels,)
        Flat indices of the mask.
    known : Observation
        A picture of (2, pixels): as rendered, and with one draw of the noise added.
    true, draw : (2, pixels, bands)
        s1 and s2 of the truth and of the draw.
    """

    truth: Truth
    pixels: NDArray[np.intp]
    known: Observation
    true: Image
    draw: Image

    @classmethod
    def of(cls, truth: Truth) -> MaskedPixels:
        """The sight of a truth."""
        pixels = np.flatnonzero(truth.mask)
        bands = truth.specular.shape[2]
        dtype = truth.specular.dtype
        specular, diffuse, image, true, draw = (
            np.empty((2, len(pixels), bands), dtype) for _ in range(5)
        )
        gather(
            pixels,
            (_flat(truth.specular), _flat(truth.specular_noise)),
            (_flat(truth.diffuse), _flat(truth.diffuse_noise)),
            (specular, diffuse, image),
            (true, draw),
        )
        rest = told(truth, KNOWN - {"specular", "diffuse"})
        known = Observation(
            image=image,
            mask=np.ones((2, len(pixels)), dtype=bool),
            specular=specular if truth.scene.lobes_known else None,
            diffuse=diffuse if truth.scene.lobes_known else None,
            **{name: _twice(value, pixels, truth.mask.shape) for name, value in rest.items()},
        )
        return cls(truth, pixels, known, true, draw)

    def estimate(self, method: Method, known: Observation | None = None) -> Components:
        """What a method makes of both rows, (2, pixels, bands); of whole pictures if it must.

        A method that needs no picture may be told another thing than what is `known`.
        """
        if method.per_pixel:
            unknown: dict[str, Any] = dict.fromkeys(KNOWN - method.needs)
            return method.reconstruct(replace(known or self.known, **unknown))
        whole, half = (observe(truth, method.needs) for truth in (self.truth, self._half))
        pair = [method.reconstruct(seen) for seen in (whole, half)]
        image, s1, s2 = (self._picked(getattr(found, name) for found in pair) for name in _STOKES)
        told = [found.valid for found in pair if found.valid is not None]
        valid = np.stack([flags.ravel()[self.pixels] for flags in told]) if told else None
        return Components(image, s1, s2, valid, pair[0].converged)

    @functools.cached_property
    def as_rendered(self) -> NDArray[np.bool_]:
        """The first row of `known`, as a mask (2, pixels)."""
        return self.known.mask & np.array([[True], [False]])

    @functools.cached_property
    def _half(self) -> Truth:
        return self.truth.halves()[0]

    def _picked(self, images: Any) -> Image:
        bands = self.true.shape[2]
        return np.stack([image.reshape(-1, bands)[self.pixels] for image in images])


_STOKES = ("image", "s1", "s2")


def _flat(stokes: Image) -> Image:
    return stokes.reshape(-1, *stokes.shape[2:])


def _twice(value: Any, pixels: NDArray[np.intp], shape: tuple[int, ...]) -> Any:
    """What is known a pixel, at `pixels` and in two rows; what is known as a whole, as it is."""
    if np.shape(value)[:2] != shape:
        return value
    chosen = value.reshape(-1, *value.shape[2:]).take(pixels, axis=0)
    return np.stack([chosen, chosen])
