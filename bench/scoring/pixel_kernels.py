"""What every score is made of, in one pass each over the pixels of the mask.

Compiled, because the same sums in NumPy are a dozen passes over temporaries that are larger than
the images themselves. Radiances keep the precision that they come in; products and sums are
float64.

The loops of `difference_sums` go over pixels and bands alike, and what they write lies in one
array at places known when they are compiled: only then are they compiled to instructions that
work on several numbers at once, which is three times as fast.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.kernels import compiled

Floats = NDArray[np.float64]
Image = NDArray[np.floating[Any]]
FourRows = tuple[Image, Image, Image, Image]
Lobe = tuple[Image, Image]
Planes = tuple[Image, Image, Image]
Form = tuple[float, float, float, float, float, float]


@compiled
def gather(
    pixels: NDArray[np.intp], specular: Lobe, diffuse: Lobe, seen: Planes, field: Lobe
) -> None:
    """Take the Stokes vectors of both lobes at `pixels`, and one draw of their noise.

    Parameters
    ----------
    pixels : (pixels,)
        Flat indices.
    specular, diffuse : two of (all pixels, bands, 3)
        A lobe and its noise.
    seen : three of (2, pixels, bands)
        Written: intensities of both lobes and their sum, as rendered and with the draw added.
    field : two of (2, pixels, bands)
        Written: s1 and s2 of the sum, and of its draw.
    """
    (light, light_noise), (body, diffuse_noise) = specular, diffuse
    (mirrored, left, image), (true, draw) = seen, field
    for p in range(len(pixels)):
        at = pixels[p]
        for b in range(light.shape[1]):
            one, two = light[at, b, 0], body[at, b, 0]
            mirrored[0, p, b], left[0, p, b], image[0, p, b] = one, two, one + two
            one, two = one + light_noise[at, b, 0], two + diffuse_noise[at, b, 0]
            mirrored[1, p, b], left[1, p, b], image[1, p, b] = one, two, one + two
            for k in range(2):
                true[k, p, b] = light[at, b, k + 1] + body[at, b, k + 1]
                draw[k, p, b] = light_noise[at, b, k + 1] + diffuse_noise[at, b, k + 1]


MOST_BANDS = 512
"""Of a scene, see `Wavelengths`: the bands of a pixel fit in a row of what `difference_sums` has
at hand."""

_ROW = MOST_BANDS + 8  # rows that lie a power of two apart would drive each other from the cache
_D0, _C0, _ALONG, _ACROSS, _ERROR, _CHANGE, _SUMS = (row * _ROW for row in range(7))


@compiled
def compare_pictures(image: Image, half: Image, seen: Image, noisy: Image, rows: Floats) -> None:
    """Write the difference of the estimated picture, and what the draw changes in it."""
    for k in range(len(image)):
        d0 = np.float64(image[k]) - seen[k]
        rows[_D0 + k] = d0
        rows[_C0 + k] = np.float64(half[k]) - noisy[k] - d0


@compiled
def weighted(form: Form, x0: float, x1: float, x2: float) -> tuple[float, float, float]:
    """A symmetric form times one Stokes vector."""
    f00, f01, f02, f11, f12, f22 = form
    return (
        f00 * x0 + f01 * x1 + f02 * x2,
        f01 * x0 + f11 * x1 + f12 * x2,
        f02 * x0 + f12 * x1 + f22 * x2,
    )


@compiled
def add_products(rows: Floats, k: int, x0: float, x1: float, x2: float) -> None:
    """Add 00, 01, 02, 11, 12, 22 of one Stokes vector to column k of the first six rows."""
    rows[k] += x0 * x0
    rows[1 * _ROW + k] += x0 * x1
    rows[2 * _ROW + k] += x0 * x2
    rows[3 * _ROW + k] += x1 * x1
    rows[4 * _ROW + k] += x1 * x2
    rows[5 * _ROW + k] += x2 * x2


@compiled
def compare_fields(estimate: FourRows, field: FourRows, form: Form, rows: Floats) -> None:
    """Write the terms of every pixel and band, and add those that need no weight of the pixel.

    `estimate` has s1 of both pictures, then s2 of both; `field` s1 and s2 of the truth, then of
    the draw.
    """
    (first, first_half, second, second_half), (true1, true2, draw1, draw2) = estimate, field
    for k in range(len(first)):
        t1, t2 = np.float64(true1[k]), np.float64(true2[k])
        n1, n2 = np.float64(draw1[k]), np.float64(draw2[k])
        d0, d1, d2 = rows[_D0 + k], first[k] - t1, second[k] - t2
        c0, c1, c2 = rows[_C0 + k], first_half[k] - (t1 + n1) - d1, second_half[k] - (t2 + n2) - d2
        rows[_ALONG + k] = d1 * n1 + d2 * n2 + c1 * t1 + c2 * t2
        rows[_ACROSS + k] = d2 * n1 - d1 * n2 + c2 * t1 - c1 * t2
        w0, w1, w2 = weighted(form, d0, d1, d2)
        m0, m1, m2 = weighted(form, c0, c1, c2)
        rows[_ERROR + k] = w0 * d0 + w1 * d1 + w2 * d2 - m0 * c0 - m1 * c1 - m2 * c2
        rows[_CHANGE + k] = 2.0 * (w0 * c0 + w1 * c1 + w2 * c2)
        add_products(rows, _SUMS + k, d0, d1, d2)
        add_products(rows, _SUMS + 6 * _ROW + k, c0, c1, c2)
        rows[_SUMS + 12 * _ROW + k] += d1 * t1 + d2 * t2 - c1 * n1 - c2 * n2
        rows[_SUMS + 13 * _ROW + k] += d2 * t1 - d1 * t2 - c2 * n1 + c1 * n2


@compiled
def add_bands(rows: Floats, bands: int, facing: Floats, draws: Floats) -> float:
    """Write the draws of every pixel, and return the weighted squared error."""
    along, across, error, change = rows[_ALONG:], rows[_ACROSS:], rows[_ERROR:], rows[_CHANGE:]
    total = 0.0
    for p in range(len(facing)):
        a = b = e = c = 0.0
        for k in range(p * bands, (p + 1) * bands):
            a += along[k]
            b += across[k]
            e += error[k]
            c += change[k]
        draws[0, p], draws[1, p], draws[2, p] = a, b, facing[p] * c
        total += facing[p] * e
    return total


@compiled
def difference_sums(
    estimate: Planes, known: Planes, facing: Floats, form: Form, draws: Floats
) -> tuple[Floats, Floats]:
    """Second moments of an estimate's differences, and its products with the true field.

    With independent halves t ± n the mean of the products of both is tᵀWt − nᵀWn; to first
    order, the draw n changes it by 2 tᵀWn.

    Parameters
    ----------
    estimate : three of (2, pixels, bands), C-ordered
        I, s1 and s2 from the picture as rendered and from that with the draw added.
    known : three of (2, pixels, bands), C-ordered
        Both pictures; s1 and s2 of the truth; s1 and s2 of the draw.
    facing : (pixels,)
        Weights of the pixels in the total of the squared error.
    form : 6 floats
        Elements 00, 01, 02, 11, 12, 22 of the quadratic form W of a squared error over polariser
        angles.
    draws : (3 or more, pixels)
        Written: what the draw of a pixel's noise, in all bands at once, adds to the totals.

    Returns
    -------
    moments : (2, 6, bands)
        Σ over pixels of the products 00, 01, 02, 11, 12, 22 of the difference, and of what the
        draw changes in it.
    totals : (3,)
        Σ d·s and Σ s × d over the polarised parts, Σ of the weighted squared error; without noise.
    """
    pixels, bands = known[0].shape[1:]
    (image, s1, s2), (seen, true, draw) = flat(estimate), flat(known)
    at_once = MOST_BANDS // bands
    rows, error = np.zeros(_SUMS + 14 * _ROW), 0.0
    for p in range(0, pixels, at_once):
        q = min(p + at_once, pixels)
        i, j = p * bands, q * bands
        compare_pictures(image[0, i:j], image[1, i:j], seen[0, i:j], seen[1, i:j], rows)
        found = s1[0, i:j], s1[1, i:j], s2[0, i:j], s2[1, i:j]
        field = true[0, i:j], true[1, i:j], draw[0, i:j], draw[1, i:j]
        compare_fields(found, field, form, rows)
        error += add_bands(rows, bands, facing[p:q], draws[:, p:q])
    sums = np.zeros((14, bands))
    for row in range(14):
        part = rows[_SUMS + row * _ROW :]
        for first in range(0, at_once * bands, bands):
            for b in range(bands):
                sums[row, b] += part[first + b]
    totals = np.array([sums[12].sum(), sums[13].sum(), error])
    return sums[:12].copy().reshape(2, 6, bands), totals


@compiled
def flat(planes: Planes) -> Planes:
    """Pixels and bands as one axis."""
    one, two, three = planes
    return one.reshape(2, -1), two.reshape(2, -1), three.reshape(2, -1)


@partial(compiled, any_order=True)
def dot(x: Floats, y: Floats) -> float:
    """Σ x·y."""
    total = 0.0
    for k in range(len(x)):
        total += x[k] * y[k]
    return total


@compiled
def products(rows: Floats) -> Floats:
    """Products (n, n) of all pairs of rows (n, pixels); BLAS takes four times as long for five."""
    found = np.empty((len(rows), len(rows)))
    for i in range(len(rows)):
        for j in range(i + 1):
            found[i, j] = found[j, i] = dot(rows[i], rows[j])
    return found


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
