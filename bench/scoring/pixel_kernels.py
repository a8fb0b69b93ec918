"""What every score is made of, in one pass each over the pixels of the mask.

Compiled, because the same sums in NumPy are a dozen passes over temporaries that are larger than
the images themselves. Radiances keep the precision that they come in; products and sums are
float64.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.kernels import compiled

Floats = NDArray[np.float64]
Image = NDArray[np.floating[Any]]


@compiled
def gather(
    pixels: NDArray[np.intp], lobe: Image, noise: Image, seen: Image, true: Image, draw: Image
) -> None:
    """Take one lobe's Stokes vectors at `pixels`, and one draw of their noise.

    Parameters
    ----------
    pixels : (pixels,)
        Flat indices.
    lobe, noise : (all pixels, bands, 3)
    seen : (2, pixels, bands)
        Written: the intensity as rendered, and with the draw added.
    true, draw : (2, pixels, bands)
        Added to: s1 and s2.
    """
    for p in range(len(pixels)):
        at = pixels[p]
        for b in range(lobe.shape[1]):
            seen[0, p, b] = lobe[at, b, 0]
            seen[1, p, b] = lobe[at, b, 0] + noise[at, b, 0]
            for k in range(2):
                true[k, p, b] += lobe[at, b, k + 1]
                draw[k, p, b] += noise[at, b, k + 1]


@compiled
def add_products(products: Floats, x0: float, x1: float, x2: float) -> None:
    """Add 00, 01, 02, 11, 12, 22 of one Stokes vector."""
    products[3] += x1 * x1
    products[4] += x1 * x2
    products[5] += x2 * x2
    if x0 != 0.0:  # most methods keep the picture
        products[0] += x0 * x0
        products[1] += x0 * x1
        products[2] += x0 * x2


@compiled
def add_outer(sums: Floats, values: Floats) -> None:
    """Add the products of all pairs of values."""
    for i in range(len(values)):
        for j in range(len(values)):
            sums[i, j] += values[i] * values[j]


@compiled
def weighted(form: Floats, x0: float, x1: float, x2: float) -> tuple[float, float, float]:
    """A form (3, 3) times one Stokes vector."""
    return (
        form[0, 0] * x0 + form[0, 1] * x1 + form[0, 2] * x2,
        form[1, 0] * x0 + form[1, 1] * x1 + form[1, 2] * x2,
        form[2, 0] * x0 + form[2, 1] * x1 + form[2, 2] * x2,
    )


@compiled
def field_sums(
    true: Image, draw: Image, facing: Floats, form: Floats
) -> tuple[Floats, Floats, Floats]:
    """What all methods share: energy of the polarised field, errors of the guess I(ϑ) = I/2.

    With independent halves t ± n the mean of the products of both is tᵀWt − nᵀWn; to first
    order, the draw n changes it by 2 tᵀWn.

    Parameters
    ----------
    true, draw : (2, pixels, bands)
        s1 and s2.
    facing : (pixels,)
        Weights of the pixels in the error of the guess.
    form : (3, 3)
        The quadratic form of a squared error over polariser angles.

    Returns
    -------
    moments : (2, bands, 6)
        Of the guess, as `estimate_sums` has them.
    totals : (2,)
        Σ s·s and Σ of the weighted squared error of the guess, without noise.
    draws : (pixels, 2)
        What the draw of a pixel's noise, in all bands at once, adds to the totals.
    """
    moments, totals = np.zeros((2, true.shape[2], 6)), np.zeros(2)
    draws = np.zeros((true.shape[1], 2))
    for p in range(true.shape[1]):
        energy_draw = guess = guess_draw = 0.0
        for b in range(true.shape[2]):
            t1, t2 = np.float64(true[0, p, b]), np.float64(true[1, p, b])
            n1, n2 = np.float64(draw[0, p, b]), np.float64(draw[1, p, b])
            add_products(moments[0, b], 0.0, t1, t2)
            add_products(moments[1, b], 0.0, n1, n2)
            totals[0] += t1 * t1 + t2 * t2 - n1 * n1 - n2 * n2
            energy_draw += 2.0 * (t1 * n1 + t2 * n2)
            _, w1, w2 = weighted(form, 0.0, t1, t2)
            _, m1, m2 = weighted(form, 0.0, n1, n2)
            guess += w1 * t1 + w2 * t2 - m1 * n1 - m2 * n2
            guess_draw += 2.0 * (w1 * n1 + w2 * n2)
        totals[1] += facing[p] * guess
        draws[p, 0], draws[p, 1] = energy_draw, facing[p] * guess_draw
    return moments, totals, draws


Planes = tuple[Image, Image, Image]


@compiled
def estimate_sums(
    estimate: Planes, known: Planes, shared: Floats, facing: Floats, form: Floats
) -> tuple[Floats, Floats, Floats]:
    """Second moments of an estimate's differences, and its products with the true field.

    Parameters
    ----------
    estimate : three of (2, pixels, bands)
        I, s1 and s2 from the picture as rendered and from that with the draw added.
    known : three of (2, pixels, bands)
        Both pictures; s1 and s2 of the truth; s1 and s2 of the draw.
    shared : (pixels, 2)
        The draws that `field_sums` found.
    facing, form
        As in `field_sums`.

    Returns
    -------
    moments : (2, bands, 6)
        Σ over pixels of the products 00, 01, 02, 11, 12, 22 of the difference, and of what the
        draw changes in it.
    totals : (3,)
        Σ d·s and Σ s × d over the polarised parts, Σ of the weighted squared error; without noise.
    covariance : (5, 5)
        Of these totals and the two of `field_sums` by the noise; pixels are independent.
    """
    (image, s1, s2), (seen, true, draw) = estimate, known
    moments, totals = np.zeros((2, true.shape[2], 6)), np.zeros(3)
    covariance, draws = np.zeros((5, 5)), np.zeros(5)
    for p in range(true.shape[1]):
        along = along_draw = across = across_draw = error = error_draw = 0.0
        for b in range(true.shape[2]):
            t1, t2 = np.float64(true[0, p, b]), np.float64(true[1, p, b])
            n1, n2 = np.float64(draw[0, p, b]), np.float64(draw[1, p, b])
            d0 = np.float64(image[0, p, b]) - seen[0, p, b]
            d1, d2 = s1[0, p, b] - t1, s2[0, p, b] - t2
            c0 = np.float64(image[1, p, b]) - seen[1, p, b] - d0
            c1, c2 = s1[1, p, b] - (t1 + n1) - d1, s2[1, p, b] - (t2 + n2) - d2
            add_products(moments[0, b], d0, d1, d2)
            add_products(moments[1, b], c0, c1, c2)
            along += d1 * t1 + d2 * t2 - c1 * n1 - c2 * n2
            along_draw += d1 * n1 + d2 * n2 + c1 * t1 + c2 * t2
            across += d2 * t1 - d1 * t2 - c2 * n1 + c1 * n2
            across_draw += d2 * n1 - d1 * n2 + c2 * t1 - c1 * t2
            w0, w1, w2 = weighted(form, d0, d1, d2)
            m0, m1, m2 = weighted(form, c0, c1, c2)
            error += w0 * d0 + w1 * d1 + w2 * d2 - m0 * c0 - m1 * c1 - m2 * c2
            error_draw += 2.0 * (w0 * c0 + w1 * c1 + w2 * c2)
        totals[0] += along
        totals[1] += across
        totals[2] += facing[p] * error
        draws[0], draws[1], draws[2] = along_draw, across_draw, facing[p] * error_draw
        draws[3], draws[4] = shared[p]
        add_outer(covariance, draws)
    return moments, totals, covariance


@compiled
def count_violations(image: Image, s1: Image, s2: Image, seen: Image, slack: float) -> int:
    """Pixels of (pixels, bands) with DoLP > slack, I_max + I_min ≠ I, or a value not finite."""
    count = 0
    for p in range(image.shape[0]):
        bad = False
        for b in range(image.shape[1]):
            total, x, y = np.float64(image[p, b]), np.float64(s1[p, b]), np.float64(s2[p, b])
            expected = np.float64(seen[p, b])
            # Written so that NaN is bad.
            equal = abs(total - expected) <= 1e-5 * abs(expected)
            # I_min < 0 and DoLP > 1 are one condition.
            most = total * slack
            polarised = most >= 0.0 and x * x + y * y <= most * most
            bad |= not (equal and polarised and total < np.inf)
        count += bad
    return count
