"""The polarisation conventions of malus, coded once.

Image frame: x to the right, y up, z towards the viewer. A linear Stokes vector (s0, s1, s2) has
its reference axis along +x (horizontal) and s2 > 0 at +45 degrees anticlockwise as displayed.
A fourth component s3, which no polariser shows, is positive where the field turns clockwise as
displayed: right-handed. A polariser angle ϑ counts anticlockwise from the *vertical*, so that

    I(ϑ) = ½ (s0 − s1 cos 2ϑ − s2 sin 2ϑ).

Under a perspective camera every pixel looks along a line of its own: see `viewing_frame`.
Every other folder calls these functions and none repeats them.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

from malus.scenes.core.arrays import AnyArray, Float64Array, FloatArray

PAPER_ANGLES_DEG = (0.0, 30.0, 45.0, 60.0, 90.0)
"""The five polariser angles of the paper's synthetic experiment (Section IV)."""

FROM_VERTICAL_DEG = -90.0
"""Added to an angle from the horizontal, as camera makers count, it gives one from the vertical."""

_STRAIGHT_UP = 1e-9
"""Distance of a direction from the y axis below which it is the axis."""


def viewing_frame(vectors: FloatArray, view_direction: FloatArray) -> FloatArray:
    """Vectors of the image frame in the frame of a pixel's Stokes vector.

    Its z axis is the view direction v, its x axis the horizontal across the viewing ray: h = y × v
    normalised, which is normalise(d × up) of the ray's direction d = −v; its y axis is v × h.

    Parameters
    ----------
    vectors, view_direction : (..., 3) arrays that broadcast
        View direction: unit vectors from the surface towards the camera. For (0, 0, 1), as of an
        orthographic camera, the frame is the image frame.

    Returns
    -------
    (..., 3) array; NaN where the view direction is straight up or down: no horizontal exists there.

    Examples
    --------
    Left of the centre the camera stands to the right, so that a normal which faces the image
    plane leans to the left:

    >>> view_direction = np.array([0.6, 0.0, 0.8])
    >>> viewing_frame(np.array([0.0, 0.0, 1.0]), view_direction).round(12).tolist()
    [-0.6, 0.0, 0.8]
    """
    x, y, z = (vectors[..., k] for k in range(3))
    v_x, v_y, v_z = (view_direction[..., k] for k in range(3))
    across = np.hypot(v_x, v_z)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        right = (x * v_z - z * v_x) / across
        up = y * across - v_y * (x * v_x + z * v_z) / across
        toward = x * v_x + y * v_y + z * v_z
    return np.stack([right, up, toward], axis=-1)


def image_frame(vectors: FloatArray, view_direction: FloatArray) -> FloatArray:
    """Vectors of a pixel's frame in the image frame: the inverse of `viewing_frame`.

    Parameters
    ----------
    vectors, view_direction : (..., 3) arrays that broadcast
        View direction: unit vectors from the surface towards the camera.

    Returns
    -------
    (..., 3) array; NaN where the view direction is straight up or down.

    Examples
    --------
    What faces the camera has the view direction for its normal:

    >>> image_frame(np.array([0.0, 0.0, 1.0]), np.array([0.6, 0.0, 0.8])).round(12).tolist()
    [0.6, 0.0, 0.8]
    """
    right, up, toward = (vectors[..., k] for k in range(3))
    v_x, v_y, v_z = (view_direction[..., k] for k in range(3))
    across = np.hypot(v_x, v_z)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        level = toward - up * v_y / across
        x = right * v_z / across + level * v_x
        y = up * across + toward * v_y
        z = level * v_z - right * v_x / across
    return np.stack([x, y, z], axis=-1)


def in_turned_frame(stokes: FloatArray, angle: FloatArray) -> FloatArray:
    """Stokes vectors (..., 3) for a reference axis turned by angles (...), anticlockwise, radians.

    Examples
    --------
    >>> in_turned_frame(np.array([2.0, 1.0, 0.0]), np.array(np.pi / 2)).round(12).tolist()
    [2.0, -1.0, -0.0]
    """
    cosine, sine = np.cos(2 * angle), np.sin(2 * angle)
    s0, s1, s2 = np.moveaxis(stokes, -1, 0)
    return np.stack([s0, cosine * s1 + sine * s2, cosine * s2 - sine * s1], axis=-1)


def polarised(stokes: FloatArray, angle_deg: float) -> FloatArray:
    """Radiance behind an ideal linear polariser, I(ϑ).

    Parameters
    ----------
    stokes : (..., 3) array
        Linear Stokes vectors.
    angle_deg : float
        Transmission axis in degrees, anticlockwise from the vertical as displayed.

    Returns
    -------
    (...) array, same unit and dtype as `stokes`.

    Raises
    ------
    ValueError
        If the angle is not finite.

    Examples
    --------
    Horizontally polarised light passes a horizontal polariser, which is 90° from the vertical:

    >>> float(polarised(np.array([1.0, 1.0, 0.0]), 90.0))
    1.0
    """
    if np.ndim(angle_deg) or isinstance(angle_deg, str) or not math.isfinite(angle_deg):
        raise ValueError(f"angle_deg: expected a finite angle in degrees, found {angle_deg!r}")
    cos2, sin2 = _double_angle(angle_deg)
    stokes = _floats(stokes)
    dtype = stokes.dtype.type
    result: FloatArray = dtype(0.5) * (
        stokes[..., 0] - dtype(cos2) * stokes[..., 1] - dtype(sin2) * stokes[..., 2]
    )
    return result


def analyser(
    angles_deg: Float64Array | Sequence[float], extinction_ratio: float | None = None
) -> Float64Array:
    """What a polariser makes of a Stokes vector: weights (..., 3) whose product with it is I(ϑ).

    Parameters
    ----------
    angles_deg : (...) array or sequence
        Transmission axes in degrees, anticlockwise from the vertical as displayed.
    extinction_ratio : float, optional
        Transmission along the axis over that across it, > 1; by default none passes across. The
        transmission of unpolarised light is 1/2 in any case: only its polarised part is weakened,
        by (ratio - 1) / (ratio + 1).

    Examples
    --------
    >>> analyser(np.array([90.0]), extinction_ratio=3.0).round(9).tolist()
    [[0.5, 0.25, -0.0]]
    """
    contrast = 1.0 if extinction_ratio is None else (extinction_ratio - 1) / (extinction_ratio + 1)
    turns = 2.0 * np.radians(angles_deg)
    half = np.full(turns.shape, 0.5)
    return np.stack(
        [half, -0.5 * contrast * np.cos(turns), -0.5 * contrast * np.sin(turns)], axis=-1
    )


def tell_stokes(angles_deg: Sequence[float]) -> bool:
    """Whether light through polarisers at these angles tells its Stokes vector, in degrees.

    It has three unknowns, and angles 180° apart are one: three or more must differ.

    Examples
    --------
    >>> tell_stokes((0.0, 60.0, 120.0)), tell_stokes((30.0, 30.0, 210.0, 90.0))
    (True, False)
    """
    different = {round(angle % 180.0, 3) % 180.0 for angle in angles_deg}
    return all(map(math.isfinite, angles_deg)) and len(different) >= 3


def _double_angle(angle_deg: float) -> tuple[float, float]:
    """cos 2ϑ and sin 2ϑ, exact at multiples of 45 degrees so that crossed polarisers are dark."""
    turns = (2.0 * angle_deg) % 360.0
    exact = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
    if turns in exact:
        return exact[turns]
    return math.cos(math.radians(turns)), math.sin(math.radians(turns))


@functools.cache
def angle_weights(angles_deg: tuple[float, ...] = PAPER_ANGLES_DEG) -> Float64Array:
    """Matrix A (3, 3) that gives the mean squared error over polariser angles from Stokes errors.

    mean over ϑ of ΔI(ϑ)² = Δsᵀ A Δs, because I(ϑ) is linear in s: no image per angle is needed.

    Returns
    -------
    (3, 3) symmetric positive semidefinite array.

    Examples
    --------
    >>> round(float(angle_weights()[0, 0]), 3)
    0.25
    """
    analyser = np.array([(0.5, -0.5 * c, -0.5 * s) for c, s in map(_double_angle, angles_deg)])
    weights: Float64Array = analyser.T @ analyser / len(angles_deg)
    weights.flags.writeable = False  # shared by all callers
    return weights


def polarised_intensity(stokes: FloatArray) -> FloatArray:
    """√(s1² + s2²) of Stokes vectors (..., 3): the polarised part of the radiance.

    Examples
    --------
    >>> float(polarised_intensity(np.array([9.0, 3.0, 4.0])))
    5.0
    """
    stokes = _floats(stokes)
    return np.hypot(stokes[..., 1], stokes[..., 2])


def _floats(values: AnyArray) -> FloatArray:
    """The values themselves; whole numbers, of which a half may be none, in double precision."""
    values = np.asarray(values)
    return values if values.dtype.kind == "f" else values.astype(np.float64)


def extremes(stokes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(I_max, I_min) of the Transmitted Radiance Sinusoid, ½ (s0 ± √(s1² + s2²)).

    Examples
    --------
    >>> i_max, i_min = extremes(np.array([10.0, 3.0, 4.0]))
    >>> float(i_max), float(i_min)
    (7.5, 2.5)
    """
    half_polarised = 0.5 * polarised_intensity(stokes)
    half_total = 0.5 * stokes[..., 0]
    return half_total + half_polarised, half_total - half_polarised


def phase(stokes: FloatArray) -> FloatArray:
    """ψ, the polariser angle of largest transmission: radians in [0, π), from the vertical.

    Examples
    --------
    Vertically polarised light (s1 < 0) passes best at ψ = 0:

    >>> float(phase(np.array([1.0, -1.0, 0.0])))
    0.0
    """
    stokes = _floats(stokes)
    # I(ϑ) = ½ (s0 + (−s1) cos 2ϑ + (−s2) sin 2ϑ) is largest at 2ϑ = atan2(−s2, −s1); adding 0.0
    # turns −0.0 into 0.0, which atan2 would send to ±π.
    return _half_turn(0.5 * np.arctan2(0.0 - stokes[..., 2], 0.0 - stokes[..., 1]))


def dolp(stokes: FloatArray) -> FloatArray:
    """Degree of linear polarisation √(s1² + s2²) / s0, zero where s0 is not positive; NaN stays.

    Examples
    --------
    >>> float(dolp(np.array([10.0, 3.0, 4.0])))
    0.5
    """
    total, length = _floats(stokes)[..., 0], polarised_intensity(stokes)
    lit = ~(total <= 0) | np.isnan(length)
    return np.divide(length, total, out=np.zeros_like(total), where=lit)


def aolp(stokes: FloatArray) -> FloatArray:
    """Angle of linear polarisation: radians in [0, π), anticlockwise from +x as displayed.

    Examples
    --------
    >>> round(float(np.degrees(aolp(np.array([1.0, 0.0, 1.0])))), 6)
    45.0
    """
    stokes = _floats(stokes)
    return _half_turn(0.5 * np.arctan2(stokes[..., 2], stokes[..., 1]))


def _half_turn(angle: FloatArray) -> FloatArray:
    """Angles modulo π, in [0, π): a tiny negative one, which rounding takes to π, becomes 0."""
    result = angle % np.pi
    return np.where(result >= np.pi, result.dtype.type(0.0), result)


def stokes_from_extremes(i_max: FloatArray, i_min: FloatArray, phase: FloatArray) -> FloatArray:
    """Stokes vectors (..., 3) of the sinusoid of the paper's Equation 1.

    Parameters
    ----------
    i_max, i_min : (...) arrays
        Extremes of the Transmitted Radiance Sinusoid; i_max < i_min is a sinusoid turned by 90°.
        Whole numbers are taken in double precision: the sum of two bytes may be no byte.
    phase : (...) array
        ψ in radians, from the vertical.

    Examples
    --------
    >>> stokes_from_extremes(np.array(7.5), np.array(2.5), np.array(0.0)).tolist()
    [10.0, -5.0, -0.0]
    """
    i_max, i_min, phase = map(_floats, (i_max, i_min, phase))
    amplitude = i_max - i_min
    return np.stack(
        np.broadcast_arrays(
            i_max + i_min, -amplitude * np.cos(2 * phase), -amplitude * np.sin(2 * phase)
        ),
        axis=-1,
    )


def polariser_axis(direction: FloatArray, angle_deg: float) -> Float64Array:
    """Transmission axis of a polariser in space, unit vector (3,).

    The polariser stands in `direction` from the origin, which it faces, and is turned as one
    before a camera there: anticlockwise from the vertical as that camera displays it, whose
    vertical is the y axis. Straight above the vertical is −z, straight below +z.

    Parameters
    ----------
    direction : (3,) unit vector
    angle_deg : float

    Examples
    --------
    >>> polariser_axis(np.array([0.0, 0.0, 1.0]), 90.0).tolist()
    [-1.0, 0.0, 0.0]
    """
    right, up = _upright(direction)
    angle = math.radians(angle_deg)
    result: Float64Array = math.cos(angle) * up - math.sin(angle) * right
    return result.round(15) + 0.0  # exact on the axes


def polariser_angle_deg(direction: FloatArray, axis: FloatArray) -> float:
    """Angle in (−90°, 90°] of a polariser in `direction` that transmits along `axis`, both (3,).

    The inverse of `polariser_axis`.

    Examples
    --------
    >>> direction = np.array([0.0, 0.6, 0.8])
    >>> round(polariser_angle_deg(direction, polariser_axis(direction, 30.0)), 9)
    30.0
    """
    right, up = _upright(direction)
    angle = math.degrees(math.atan2(-float(axis @ right), float(axis @ up)))
    turned = math.remainder(angle, 180.0)
    return turned if turned > -90.0 else 90.0


def _upright(direction: FloatArray) -> tuple[Float64Array, Float64Array]:
    """Right and up, unit vectors (3,), of a camera in `direction` that looks at the origin."""
    x, y, z = map(float, direction)
    across = math.hypot(x, z)
    right = np.array([z, 0.0, -x]) / across if across > _STRAIGHT_UP else np.array([1.0, 0.0, 0.0])
    up: Float64Array = np.cross([x, y, z], right)
    return right, up
