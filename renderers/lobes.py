"""What a renderer hands over: both lobes of one family at the nodes in η, on compact pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


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
