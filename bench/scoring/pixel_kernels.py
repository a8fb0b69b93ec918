"""Compiled loops over the pixels of the mask, from which every score is computed.

The same sums in NumPy are a dozen passes over temporaries that are larger than the images
themselves; here they are one pass. Radiances keep their precision; products and sums are float64.

The loops of `difference_sums` treat pixels and bands alike, and write to one array at offsets that
are known at compile time: only then does the compiler use instructions that work on several numbers
at once, which is three times as fast.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct.kernels import compiled
from malus.scenes.core.arrays import Float32Array, Float64Array, FloatArray, IntArray

TwoImages = tuple[FloatArray, FloatArray]
ThreeImages = tuple[FloatArray, FloatArray, FloatArray]
FourRows = tuple[FloatArray, FloatArray, FloatArray, FloatArray]

QuadraticForm = tuple[float, float, float, float, float, float]
"""Elements 00, 01, 02, 11, 12, 22 of a symmetric matrix of Stokes components."""


@compiled
def gather(
    indices: NDArray[np.intp],
    specular: TwoImages,
    diffuse: TwoImages,
    intensities: ThreeImages,
    fields: TwoImages,
) -> None:
    """Gather the Stokes vectors of both lobes at some pixels, and one draw of their noise.

    Parameters
    ----------
    indices : (pixels,)
        Flat indices of the pixels.
    specular, diffuse : two of (all pixels, bands, 3)
        Stokes vectors of a lobe, and one draw of their noise.
    intensities : three of (2, pixels, bands)
        Written: intensities of both lobes and their sum, as rendered and with the draw added.
    fields : two of (2, pixels, bands)
        Written: s1 and s2 of the sum of both lobes, and of its draw.
    """
    (specular_stokes, specular_noise), (diffuse_stokes, diffuse_noise) = specular, diffuse
    (specular_image, diffuse_image, image), (true, draw) = intensities, fields
    for p in range(len(indices)):
        i = indices[p]
        for b in range(specular_stokes.shape[1]):
            s, d = specular_stokes[i, b, 0], diffuse_stokes[i, b, 0]
            specular_image[0, p, b], diffuse_image[0, p, b], image[0, p, b] = s, d, s + d
            s, d = s + specular_noise[i, b, 0], d + diffuse_noise[i, b, 0]
            specular_image[1, p, b], diffuse_image[1, p, b], image[1, p, b] = s, d, s + d
            for k in range(2):
                true[k, p, b] = specular_stokes[i, b, k + 1] + diffuse_stokes[i, b, k + 1]
                draw[k, p, b] = specular_noise[i, b, k + 1] + diffuse_noise[i, b, k + 1]


@compiled
def gather_family(
    indices: NDArray[np.intp],
    specular: Float32Array,
    diffuse: Float32Array,
    weights: tuple[Float32Array, Float32Array],
    albedo: Float32Array,
    intensities: ThreeImages,
    fields: TwoImages,
) -> None:
    """As `gather`, for the bands of many scenes that are interpolated from the same renders.

    Parameters
    ----------
    indices : (pixels,)
        Indices of the pixels among those of the renders.
    specular, diffuse : (2, K, rendered pixels, 3)
        Stokes vectors of a lobe from both halves of the samples, at the nodes in η.
    weights : two of (K, bands)
        Weights of the nodes of a lobe in every band.
    albedo : (bands,)
        Of the body, which `diffuse` is rendered without.
    intensities, fields
        Written: see `gather`.
    """
    (specular_image, diffuse_image, image), (true, draw) = intensities, fields
    bands = len(albedo)
    lobes = np.empty((12, bands), np.float32)
    for p in range(len(indices)):
        lobes[:] = np.float32(0.0)
        interpolate_lobe(specular[:, :, indices[p]], weights[0], lobes[:6])
        interpolate_lobe(diffuse[:, :, indices[p]], weights[1], lobes[6:])
        for row in range(6, 12):
            for b in range(bands):
                lobes[row, b] *= albedo[b]
        for b in range(bands):
            s, d = lobes[0, b], lobes[6, b]
            specular_image[0, p, b], diffuse_image[0, p, b], image[0, p, b] = s, d, s + d
            s, d = s + lobes[3, b], d + lobes[9, b]
            specular_image[1, p, b], diffuse_image[1, p, b], image[1, p, b] = s, d, s + d
        for k in range(2):
            for b in range(bands):
                true[k, p, b] = lobes[k + 1, b] + lobes[k + 7, b]
                draw[k, p, b] = lobes[k + 4, b] + lobes[k + 10, b]


@compiled
def interpolate_lobe(halves: Float32Array, weights: Float32Array, sums: Float32Array) -> None:
    """Add the weighted mean of both halves (2, K, 3) and half their difference to (6, bands)."""
    half = np.float32(0.5)
    for k in range(weights.shape[0]):
        for component in range(3):
            first, second = halves[0, k, component], halves[1, k, component]
            mean, noise = half * (first + second), half * (first - second)
            for b in range(weights.shape[1]):
                sums[component, b] += weights[k, b] * mean
                sums[3 + component, b] += weights[k, b] * noise


MOST_BANDS = 512
"""Largest number of bands of a scene, see `Wavelengths`: those of a pixel fit in one row of the
working array of `difference_sums`."""

_ROW = MOST_BANDS + 8  # rows a power of two apart would evict each other from the cache
_D0, _C0, _ALONG, _ACROSS, _ERROR, _CHANGE, _SUMS = (row * _ROW for row in range(7))


@compiled
def compare_pictures(
    estimate: FloatArray,
    noisy_estimate: FloatArray,
    picture: FloatArray,
    noisy_picture: FloatArray,
    rows: Float64Array,
) -> None:
    """Write the error of the estimated intensity, and how much the draw of the noise changes it."""
    for k in range(len(estimate)):
        d0 = np.float64(estimate[k]) - picture[k]
        rows[_D0 + k] = d0
        rows[_C0 + k] = np.float64(noisy_estimate[k]) - noisy_picture[k] - d0


@compiled
def weighted(form: QuadraticForm, x0: float, x1: float, x2: float) -> tuple[float, float, float]:
    """Multiply one Stokes vector by a symmetric matrix."""
    f00, f01, f02, f11, f12, f22 = form
    return (
        f00 * x0 + f01 * x1 + f02 * x2,
        f01 * x0 + f11 * x1 + f12 * x2,
        f02 * x0 + f12 * x1 + f22 * x2,
    )


@compiled
def add_products(rows: Float64Array, k: int, x0: float, x1: float, x2: float) -> None:
    """Add the products 00, 01, 02, 11, 12, 22 of one Stokes vector to column k of six rows."""
    rows[k] += x0 * x0
    rows[1 * _ROW + k] += x0 * x1
    rows[2 * _ROW + k] += x0 * x2
    rows[3 * _ROW + k] += x1 * x1
    rows[4 * _ROW + k] += x1 * x2
    rows[5 * _ROW + k] += x2 * x2


@compiled
def compare_fields(
    estimate: FourRows, fields: FourRows, form: QuadraticForm, rows: Float64Array
) -> None:
    """Write the error terms of every pixel and band, and add those that need no pixel's weight.

    `estimate` has s1 of both pictures, then s2 of both; `fields` s1 and s2 of the truth, then of
    the draw of its noise.
    """
    (s1, noisy_s1, s2, noisy_s2), (true1, true2, draw1, draw2) = estimate, fields
    for k in range(len(s1)):
        t1, t2 = np.float64(true1[k]), np.float64(true2[k])
        n1, n2 = np.float64(draw1[k]), np.float64(draw2[k])
        d0, d1, d2 = rows[_D0 + k], s1[k] - t1, s2[k] - t2
        c0, c1, c2 = rows[_C0 + k], noisy_s1[k] - (t1 + n1) - d1, noisy_s2[k] - (t2 + n2) - d2
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
def add_bands(
    rows: Float64Array,
    bands: int,
    facing: Float64Array,
    draws: Float64Array,
    errors: Float64Array,
) -> None:
    """Sum each pixel's changes by noise over the `bands` of each scene, and add to `errors`.

    `draws` is (scenes, 3 or more, pixels), `errors` the weighted squared error of each scene.
    """
    along, across, error, change = rows[_ALONG:], rows[_ACROSS:], rows[_ERROR:], rows[_CHANGE:]
    scenes = len(errors)
    for scene in range(scenes):
        total = 0.0
        for p in range(len(facing)):
            a = b = e = c = 0.0
            start = (p * scenes + scene) * bands
            for k in range(start, start + bands):
                a += along[k]
                b += across[k]
                e += error[k]
                c += change[k]
            draws[scene, 0, p], draws[scene, 1, p], draws[scene, 2, p] = a, b, facing[p] * c
            total += facing[p] * e
        errors[scene] += total


@compiled
def difference_sums(
    estimate: ThreeImages,
    truth: ThreeImages,
    facing: Float64Array,
    form: QuadraticForm,
    draws: Float64Array,
) -> tuple[Float64Array, Float64Array]:
    """Second moments of an estimate's errors, and their products with the true field.

    With independent halves t ± n the mean of the products of both is tᵀWt − nᵀWn; to first
    order, the draw n changes it by 2 tᵀWn. The bands of several scenes of as many bands each may
    stand side by side.

    Parameters
    ----------
    estimate : three of (2, pixels, bands), C-ordered
        I, s1 and s2 from the picture as rendered and from that with the draw added.
    truth : three of (2, pixels, bands), C-ordered
        Both pictures; s1 and s2 of the truth; s1 and s2 of the draw.
    facing : (pixels,)
        Weights of the pixels in the total of the squared error.
    form : 6 floats
        The matrix W of the squared error over polariser angles.
    draws : (scenes, 3 or more, pixels)
        Written: change of the totals by the draw of a pixel's noise, in all bands of a scene.

    Returns
    -------
    moments : (2, 6, bands)
        Σ over pixels of the products 00, 01, 02, 11, 12, 22 of the error, and of its change by the
        draw.
    totals : (scenes, 3)
        Σ d·s and Σ s × d over the polarised parts, Σ of the weighted squared error; without noise.
    """
    pixels, bands = truth[0].shape[1:]
    (image, s1, s2), (picture, true, draw) = flat(estimate), flat(truth)
    at_once = MOST_BANDS // bands
    scenes = len(draws)
    rows, totals = np.zeros(_SUMS + 14 * _ROW), np.zeros((scenes, 3))
    errors = np.zeros(scenes)
    for p in range(0, pixels, at_once):
        q = min(p + at_once, pixels)
        i, j = p * bands, q * bands
        compare_pictures(image[0, i:j], image[1, i:j], picture[0, i:j], picture[1, i:j], rows)
        estimated_fields = s1[0, i:j], s1[1, i:j], s2[0, i:j], s2[1, i:j]
        true_fields = true[0, i:j], true[1, i:j], draw[0, i:j], draw[1, i:j]
        compare_fields(estimated_fields, true_fields, form, rows)
        add_bands(rows, bands // scenes, facing[p:q], draws[:, :, p:q], errors)
    sums = np.zeros((14, bands))
    for row in range(14):
        column_sums = rows[_SUMS + row * _ROW :]
        for first in range(0, at_once * bands, bands):
            for b in range(bands):
                sums[row, b] += column_sums[first + b]
    for scene in range(scenes):
        own = slice(scene * (bands // scenes), (scene + 1) * (bands // scenes))
        totals[scene, 0], totals[scene, 1] = sums[12, own].sum(), sums[13, own].sum()
        totals[scene, 2] = errors[scene]
    return sums[:12].copy().reshape(2, 6, bands), totals


@compiled
def flat(images: ThreeImages) -> ThreeImages:
    """Join the axes of pixels and bands: three of (2, pixels · bands)."""
    first, second, third = images
    return first.reshape(2, -1), second.reshape(2, -1), third.reshape(2, -1)


@partial(compiled, any_order=True)
def dot(x: Float64Array, y: Float64Array) -> float:
    """Σ x·y of two vectors of one length."""
    total = 0.0
    for k in range(len(x)):
        total += x[k] * y[k]
    return total


@compiled
def products(rows: Float64Array) -> Float64Array:
    """Products (n, n) of all pairs of rows (n, pixels); BLAS takes four times as long for five."""
    matrix = np.empty((len(rows), len(rows)))
    for i in range(len(rows)):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = dot(rows[i], rows[j])
    return matrix


@compiled
def count_violations(
    image: FloatArray,
    s1: FloatArray,
    s2: FloatArray,
    picture: FloatArray,
    slack: float,
    counts: IntArray,
) -> None:
    """Count pixels of (pixels, bands) with DoLP > slack, I_max + I_min ≠ I, or not finite.

    `counts` (scenes,) is written: a pixel counts once for every scene whose bands break a rule.
    """
    counts[:] = 0
    # Flat arrays first, several values at once: most estimates break no rule.
    broken = 0
    flat_image, x, y, pixels = image.ravel(), s1.ravel(), s2.ravel(), picture.ravel()
    for k in range(flat_image.size):
        broken += breaks_a_rule(flat_image[k], x[k], y[k], pixels[k], slack)
    if not broken:
        return
    bands = image.shape[1] // len(counts)
    for p in range(image.shape[0]):
        for scene in range(len(counts)):
            bad = False
            for b in range(scene * bands, (scene + 1) * bands):
                bad |= breaks_a_rule(image[p, b], s1[p, b], s2[p, b], picture[p, b], slack)
            counts[scene] += bad


@compiled
def breaks_a_rule(image: float, s1: float, s2: float, picture: float, slack: float) -> bool:
    """Whether one estimate is unphysical, see `count_violations`; written so that NaN is."""
    total, x, y, expected = float(image), float(s1), float(s2), float(picture)
    # I_min < 0 and DoLP > 1 are one condition.
    most = total * slack
    equal = abs(total - expected) <= 1e-5 * abs(expected)
    return not (equal & (most >= 0.0) & (x * x + y * y <= most * most) & (total < np.inf))
