"""What a renderer hands over: both lobes of one family at the nodes in η, on compact pixels."""

from __future__ import annotations

from dataclasses import dataclass

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
    specular_variance, body_variance, covariance : (K, P, 3), (B, P, 3), (K, P, 3)
        Variances of the mean of all samples, and the covariance of both lobes.
    pixels : (P,)
        Flat indices into the image, row by row from the top.
    normals : (P, 3)
        Unit mean shading normals.
    covered : (P,) bool
        Whether every sample of the pixel hit the object.
    """

    specular: Floats
    body: Floats
    specular_variance: Floats
    body_variance: Floats
    covariance: Floats
    pixels: NDArray[np.int64]
    normals: Floats
    covered: NDArray[np.bool_]


def lobes_from_sums(
    sums: Floats,
    interface: int,
    body: int,
    samples: int,
    pixels: NDArray[np.int64],
    covered: NDArray[np.bool_],
) -> Lobes:
    """Means and variances from sums over the samples of each half.

    Parameters
    ----------
    sums : (channels, 2, P)
        Normal, Stokes vectors of the interface's and the body's nodes, their squares, and the
        products of both lobes, in that order.
    interface, body : int
        Numbers of nodes.
    samples : int
        Samples of a half.
    """
    counts = [1, interface, body, interface, body, interface]
    parts = np.split(sums, np.cumsum([3 * count for count in counts])[:-1])
    # (count * 3, halves, pixels) -> (halves, count, pixels, 3), means over the half's samples
    normal, mirrored, scattered, mirrored2, scattered2, product = (
        part.reshape(count, 3, HALVES, -1).transpose(2, 0, 3, 1) / np.float32(samples)
        for part, count in zip(parts, counts, strict=True)
    )
    mean_mirrored, mean_scattered = mirrored.mean(axis=0), scattered.mean(axis=0)
    scale = np.float32(1.0 / (HALVES * samples - 1))
    return Lobes(
        specular=np.ascontiguousarray(mirrored),
        body=np.ascontiguousarray(scattered),
        specular_variance=_variance(mirrored2, mean_mirrored**2, scale),
        body_variance=_variance(scattered2, mean_scattered**2, scale),
        covariance=(product.mean(axis=0) - mean_mirrored * mean_scattered) * scale,
        pixels=pixels,
        normals=unit(normal.mean(axis=(0, 1))),
        covered=covered,
    )


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) of length 1; zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def _variance(squares: Floats, squared_mean: Floats, scale: np.float32) -> Floats:
    # Rounding can leave a tiny negative variance where all samples are equal.
    result: Floats = np.maximum(squares.mean(axis=0) - squared_mean, 0) * scale
    return result
