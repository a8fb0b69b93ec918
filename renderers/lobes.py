"""What a renderer hands over: both lobes of one family at the nodes in η, on compact pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

HALVES = 2
"""Independent halves of the samples; what they disagree by is the Monte Carlo noise."""


@dataclass(frozen=True)
class Lobes:
    """Stokes samples of the pixels that the object touches.

    K nodes in η for the interface, B for the body (1 where it does not depend on η), P pixels.
    Where a held-out index was rendered too, to measure the interpolation, it comes last.

    Attributes
    ----------
    specular : (2, K, P, 3)
        Mean Stokes vector of each of two independent halves of the samples.
    body : (2, B, P, 3)
        The same for the body at albedo 1.
    pixels : (P,)
        Flat indices into the image, row by row from the top.
    normals : (P, 3)
        Unit mean shading normals in world coordinates.
    covered : (P,) bool
        Whether every sample of the pixel hit the object.
    specular_variance, body_variance, covariance : (K, P, 3), (B, P, 3), (K, P, 3) or None
        Variances of the mean of all samples, and the covariance of both lobes, where asked for.
    """

    specular: Floats
    body: Floats
    pixels: NDArray[np.int64]
    normals: Floats
    covered: NDArray[np.bool_]
    specular_variance: Floats | None = None
    body_variance: Floats | None = None
    covariance: Floats | None = None


@dataclass(frozen=True)
class Layout:
    """Channels of sums over samples: normal, interface and body nodes, and maybe products."""

    interface: int
    body: int
    errors: bool

    @property
    def counts(self) -> list[int]:
        """Triples of channels in each part."""
        products = [self.interface, self.body, self.interface] if self.errors else []
        return [1, self.interface, self.body, *products]

    @property
    def channels(self) -> int:
        """All channels."""
        return 3 * sum(self.counts)


def lobes_from_sums(
    sums: Floats,
    layout: Layout,
    samples: int,
    pixels: NDArray[np.int64],
    covered: NDArray[np.bool_],
) -> Lobes:
    """Means and variances from sums over the samples of each half.

    Parameters
    ----------
    sums : (channels, 2, P)
        Normal, Stokes vectors of the interface's and the body's nodes, and where the layout has
        them their squares and the products of both lobes.
    samples : int
        Samples of a half.
    """
    parts = np.split(sums, 3 * np.cumsum(layout.counts)[:-1])
    # (count * 3, halves, pixels) -> (halves, count, pixels, 3), means over the half's samples
    normal, mirrored, scattered, *products = (
        np.ascontiguousarray(part.reshape(count, 3, HALVES, -1).transpose(2, 0, 3, 1))
        / np.float32(samples)
        for part, count in zip(parts, layout.counts, strict=True)
    )
    lobes = Lobes(
        specular=mirrored,
        body=scattered,
        pixels=pixels,
        normals=unit(normal.mean(axis=(0, 1))),
        covered=covered,
    )
    return _with_variances(lobes, products, HALVES * samples) if products else lobes


def _with_variances(lobes: Lobes, products: list[Floats], samples: int) -> Lobes:
    mirrored, scattered, both = (product.mean(axis=0) for product in products)
    mean_mirrored, mean_scattered = lobes.specular.mean(axis=0), lobes.body.mean(axis=0)
    scale = np.float32(1.0 / (samples - 1))
    return replace(
        lobes,
        # Rounding can leave a tiny negative variance where all samples are equal.
        specular_variance=np.maximum(mirrored - mean_mirrored**2, 0) * scale,
        body_variance=np.maximum(scattered - mean_scattered**2, 0) * scale,
        covariance=(both - mean_mirrored * mean_scattered) * scale,
    )


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) of length 1; zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
