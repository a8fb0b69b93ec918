"""What a renderer hands over: both lobes of one family at the nodes in η, on compact pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

HALVES = 2
"""Independent halves of the samples; what they disagree by is the Monte Carlo noise."""


@dataclass(frozen=True)
class Lobes:
    """Stokes samples of the pixels that the object touches.

    K nodes in η for the specular lobe, B for the diffuse lobe (1 where it does not depend on η),
    P pixels.
    Where a held-out index was rendered too, to measure the interpolation, it comes last.

    Attributes
    ----------
    specular : (2, K, P, 3)
        Mean Stokes vector of each of two independent halves of the samples.
    diffuse : (2, B, P, 3)
        The same for the diffuse lobe at albedo 1.
    pixels : (P,)
        Flat indices into the image, row by row from the top.
    normals : (P, 3)
        Unit mean shading normals in world coordinates.
    covered : (P,) bool
        Whether every sample of the pixel hit the object.
    specular_variance, diffuse_variance, covariance : (K, P, 3), (B, P, 3), (K, P, 3) or None
        Variances of the mean of all samples, and the covariance of both lobes, where asked for.
    copy_seconds : float
        Time that passed between the last kernel and these arrays: copies from the device, and
        means of the sums.
    """

    specular: Floats
    diffuse: Floats
    pixels: NDArray[np.int64]
    normals: Floats
    covered: NDArray[np.bool_]
    specular_variance: Floats | None = None
    diffuse_variance: Floats | None = None
    covariance: Floats | None = None
    copy_seconds: float = 0.0


@dataclass(frozen=True)
class Layout:
    """Channels of sums over samples: normal, specular and diffuse nodes, and maybe products."""

    specular: int
    diffuse: int
    errors: bool

    @property
    def counts(self) -> list[int]:
        """Triples of channels in each part."""
        products = [self.specular, self.diffuse, self.specular] if self.errors else []
        return [1, self.specular, self.diffuse, *products]

    @property
    def places(self) -> list[tuple[int, int, int]]:
        """Of every triple: how many come in parts before its own, its part's count, its number."""
        starts = np.cumsum([0, *self.counts]).tolist()
        parts = zip(starts, self.counts, strict=False)
        return [(before, count, node) for before, count in parts for node in range(count)]

    @property
    def channels(self) -> int:
        """All channels."""
        return 3 * sum(self.counts)

    def split(self, sums: Floats) -> list[Floats]:
        """The parts (2, count, pixels, 3) of sums that lie one after the other, as views."""
        ends = HALVES * 3 * np.cumsum(self.counts) * (sums.size // (HALVES * self.channels))
        parts = zip(np.split(sums, ends[:-1]), self.counts, strict=True)
        return [part.reshape(HALVES, count, -1, 3) for part, count in parts]


def lobes_from_sums(
    blocks: Sequence[Floats],
    layout: Layout,
    samples: int,
    pixels: NDArray[np.int64],
    covered: NDArray[np.bool_],
) -> Lobes:
    """Means and variances from sums over the samples of each half.

    Parameters
    ----------
    blocks : flat arrays
        Of some pixels each, part after part (normal, Stokes vectors of the specular and of
        the diffuse nodes, and where the layout has them their squares and the products of both
        lobes), each part (2, count, pixels, 3). They are divided in place.
    samples : int
        Samples of a half.
    """
    split = [layout.split(block) for block in blocks]
    for block in blocks:
        block /= np.float32(samples)
    normal, mirrored, scattered, *products = (
        parts[0] if len(parts) == 1 else np.concatenate(parts, axis=2)
        for parts in zip(*split, strict=True)
    )
    lobes = Lobes(
        specular=mirrored,
        diffuse=scattered,
        pixels=pixels,
        normals=unit(normal.mean(axis=(0, 1))),
        covered=covered,
    )
    return _with_variances(lobes, products, HALVES * samples) if products else lobes


def _with_variances(lobes: Lobes, products: list[Floats], samples: int) -> Lobes:
    mirrored, scattered, both = (product.mean(axis=0) for product in products)
    mean_specular, mean_diffuse = lobes.specular.mean(axis=0), lobes.diffuse.mean(axis=0)
    scale = np.float32(1.0 / (samples - 1))
    return replace(
        lobes,
        # Rounding can leave a tiny negative variance where all samples are equal.
        specular_variance=np.maximum(mirrored - mean_specular**2, 0) * scale,
        diffuse_variance=np.maximum(scattered - mean_diffuse**2, 0) * scale,
        covariance=(both - mean_specular * mean_diffuse) * scale,
    )


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) of length 1; zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
