"""Stokes samples of the specular and the diffuse lobe of a family at every node in η."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from malus.scenes.core.arrays import AnyArray, BoolArray, Float32Array, FloatArray, IntArray

HALVES = 2
"""Independent halves of the samples; the difference of their means shows the Monte Carlo noise."""

MOST_IN_FLOAT32 = 4096
"""Most samples a pixel that are summed in float32. At these, rounding makes a sum of equal samples
wrong by 5e-6; at 2^20 samples it would be 5e-3, and no standard error would show it."""


def in_float64(samples: int) -> bool:
    """Whether so many samples a pixel are summed in float64; fewer are faster in float32."""
    return samples > MOST_IN_FLOAT32


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
    normal_spread : (P,)
        How far the normals within a pixel differ, degrees; see `spread_of`.
    covered : (P,) bool
        Whether every sample of the pixel hit the object.
    specular_variance, diffuse_variance, covariance : (K, P, 3), (B, P, 3), (K, P, 3) or None
        Variances of the mean of all samples, and the covariance of both lobes, where asked for.
    s3, s3_variance : (2, K, P), (K, P), or None
        The fourth Stokes component, all of it specular, where it can be non-zero.
    draws : int or None
        Independent draws that each pixel's own variances come from; None where these are those of
        neighbouring pixels too.
    copy_seconds : float
        Time that passed between the last kernel and these arrays: copies from the device, and
        means of the sums.
    """

    specular: Float32Array
    diffuse: Float32Array
    pixels: IntArray
    normals: Float32Array
    normal_spread: Float32Array
    covered: BoolArray
    specular_variance: Float32Array | None = None
    diffuse_variance: Float32Array | None = None
    covariance: Float32Array | None = None
    s3: Float32Array | None = None
    s3_variance: Float32Array | None = None
    draws: int | None = None
    copy_seconds: float = 0.0

    def at(self, nodes: slice | list[int]) -> Lobes:
        """The lobes at some of their nodes; of a lobe with one node for all, at that."""
        halves = ("specular", "diffuse", "s3")
        variances = ("specular_variance", "diffuse_variance", "covariance", "s3_variance")
        chosen = {name: _chosen(getattr(self, name), nodes, axis=1) for name in halves}
        chosen |= {name: _chosen(getattr(self, name), nodes, axis=0) for name in variances}
        return replace(self, **chosen)


def _chosen(values: AnyArray | None, nodes: slice | list[int], axis: int) -> Any:
    if values is None:
        return None
    if isinstance(nodes, slice):
        return values[:, nodes] if axis == 1 else values[nodes]
    return np.take(values, nodes, axis)


@dataclass(frozen=True)
class Layout:
    """Order of the sums over samples: normal, specular and diffuse nodes, products if `errors`.

    Every quantity has three channels: x, y and z of the normal; s0, s1 and s2 of a Stokes vector.
    """

    specular: int
    diffuse: int
    errors: bool

    @property
    def counts(self) -> list[int]:
        """Number of vectors of three channels in each part."""
        products = [self.specular, self.diffuse, self.specular] if self.errors else []
        return [1, self.specular, self.diffuse, *products]

    @property
    def vectors(self) -> list[tuple[int, int, int]]:
        """For each vector: number of vectors in earlier parts, size of its part, index in it."""
        starts = np.cumsum([0, *self.counts]).tolist()
        parts = zip(starts, self.counts, strict=False)
        return [(before, count, node) for before, count in parts for node in range(count)]

    @property
    def channels(self) -> int:
        """Number of channels of all parts."""
        return 3 * sum(self.counts)

    def split(self, sums: FloatArray) -> list[FloatArray]:
        """Views (2, count, pixels, 3) of each part of flat sums."""
        ends = HALVES * 3 * np.cumsum(self.counts) * (sums.size // (HALVES * self.channels))
        parts = zip(np.split(sums, ends[:-1]), self.counts, strict=True)
        return [part.reshape(HALVES, count, -1, 3) for part, count in parts]


def lobes_from_sums(
    blocks: Sequence[FloatArray],
    layout: Layout,
    samples: int,
    pixels: IntArray,
    covered: BoolArray,
) -> Lobes:
    """Means and variances from sums over the samples of each half.

    Parameters
    ----------
    blocks : flat arrays of float32 or float64, in which means and variances are computed
        Sums for some of the pixels each, in the order of `layout`; products are the squares of
        both lobes and the products of one with the other. They are divided in place.
    samples : int
        Samples of a half.
    """
    split = [layout.split(block) for block in blocks]
    for block in blocks:
        block /= np.float32(samples)
    normal, specular, diffuse, *products = (
        parts[0] if len(parts) == 1 else np.concatenate(parts, axis=2)
        for parts in zip(*split, strict=True)
    )
    mean_normals = as_float32(normal.mean(axis=(0, 1)))
    lobes = Lobes(
        specular=as_float32(specular),
        diffuse=as_float32(diffuse),
        pixels=pixels,
        normals=unit(mean_normals),
        normal_spread=spread_of(mean_normals),
        covered=covered,
    )
    if not products:
        return lobes
    return _with_variances(lobes, (specular, diffuse), products, HALVES * samples)


def _with_variances(
    lobes: Lobes, means: tuple[FloatArray, FloatArray], products: list[FloatArray], samples: int
) -> Lobes:
    """The lobes with the variances of their means, from means, squares and products of halves."""
    specular, diffuse, both = (product.mean(axis=0) for product in products)
    mean_specular, mean_diffuse = (halves.mean(axis=0) for halves in means)
    scale = np.float32(1.0 / (samples - 1))
    return replace(
        lobes,
        draws=samples,
        # Rounding can leave a tiny negative variance where all samples are equal.
        specular_variance=as_float32(np.maximum(specular - mean_specular**2, 0) * scale),
        diffuse_variance=as_float32(np.maximum(diffuse - mean_diffuse**2, 0) * scale),
        covariance=as_float32((both - mean_specular * mean_diffuse) * scale),
    )


def finite(sums: FloatArray) -> FloatArray:
    """What Mitsuba has rendered, the same array.

    Raises
    ------
    FloatingPointError
        Where it is not finite: one such sample would spoil a pixel, and the mean of an image.

    Examples
    --------
    >>> finite(np.array([1.0, np.nan]))
    Traceback (most recent call last):
    ...
    FloatingPointError: expected finite light from Mitsuba, found 1 of 2 values that are not
    """
    with np.errstate(invalid="ignore"):  # of infinities of both signs
        is_finite = np.isfinite(sums.sum(dtype=np.float64))
    if not is_finite:
        count = int(np.count_nonzero(~np.isfinite(sums)))
        raise FloatingPointError(
            f"expected finite light from Mitsuba, found {count} of {sums.size} values that are not"
        )
    return sums


def as_float32(values: FloatArray) -> Float32Array:
    """The values in float32: the same array where it has them already."""
    return np.asarray(values, dtype=np.float32)


def unit(vectors: Float32Array) -> Float32Array:
    """Vectors (..., 3) of length 1; zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def spread_of(mean_normals: Float32Array) -> Float32Array:
    """How far unit vectors differ, from their means (...,  3): an angle in degrees.

    It is the angle whose cosine is the length of the mean, zero for a mean of zero, which no vector
    has. Two equally frequent normals at an angle t from their middle have a spread of t; small
    spreads are the root mean square of the angles from the mean. A few hundredths of a degree are
    rounding.

    Source: the resultant length of Mardia and Jupp, "Directional Statistics" (2000), section 9.2.1.

    Examples
    --------
    >>> two = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]], np.float32)
    >>> spread_of(two.mean(axis=0)).item(), spread_of(two).tolist()
    (45.0, [0.0, 0.0])
    """
    length = np.linalg.norm(mean_normals, axis=-1)
    spread = np.degrees(np.arccos(np.minimum(length, 1.0)))
    return np.where(length > 0, spread, 0.0).astype(mean_normals.dtype)
