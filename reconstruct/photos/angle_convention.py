"""Whether a capture's angles are counted as assumed, from how polarisation follows the surfaces.

Light mirrored by a surface is polarised crosswise to its normal as the camera sees it, and light
from its body along it. Round an object both turn with the outline once; angles that are counted the
other way make them turn against it. Where the two take turns round the outline, as between lamps on
both sides of an object or behind it, right angles may look reversed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from malus.reconstruct.photos.capture_fit import CaptureFit
from malus.scenes.core.arrays import (
    BoolArray,
    Complex128Array,
    Float32Array,
    Float64Array,
)

_STEEP = 0.6
"""Sine of the zenith angle from which specular light is polarised enough to show its plane."""
_SURE, _CLEAR = 0.15, 3.0
"""Least share that turns against the outlines, and its least ratio to what turns with them.

Of 1155 scenes of `photos` with right angles none reaches both; with their sense reversed, 207 do.
Both limits were chosen on a third of them.
"""
_TURNED_DEG = 35.0
"""Turn against outlines that is doubted; among those 207 right angles reach 21°."""
_WEAK = 0.02
"""Root mean square of what varies, over the light, below which it may be noise of the pictures."""
_SIDE = 200
"""Pixels of an object's longer side: of larger ones every k-th row and column is looked at."""
_ONE_DIRECTION = 1e3
"""Condition from which outlines face too few directions to tell a turn from none."""
_FEWEST = 300
"""Pixels from which an object has an outline."""
_NEAR = (0.01, 0.12)
"""Distances from the outline of what is looked at, over the square root of the object's area."""


class AngleConvention(NamedTuple):
    """Rotation from measured angles of polarisation to those of specular light on known normals.

    `coherence` is 1 where they differ by one and the same rotation at every pixel, for angles
    that count as assumed and for angles that count the other way; `rotation_deg` is that rotation.
    """

    coherence: float
    rotation_deg: float
    coherence_reversed: float
    rotation_reversed_deg: float

    @property
    def doubt(self) -> str | None:
        """A warning that angles seem to be counted otherwise, or None where they fit."""
        reverse = self.coherence_reversed > max(self.coherence + 0.1, 0.6)
        best = self.rotation_reversed_deg if reverse else self.rotation_deg
        sure = max(self.coherence, self.coherence_reversed) > 0.6
        if not sure or (not reverse and abs(best) < 15.0):
            return None
        fitting = _fitting(reverse, f"{round(-best)}°")
        return (
            "the polarisation stands askew to that of mirrored light on these normals;"
            f" {fitting}, would fit: check `sense`, `zero` and `offset`"
        )


def _fitting(reverse: bool, turns: str) -> str:
    """How angles would have to be read, beside the offset that is given."""
    if reverse:
        return f"angles that count the other way, at an `offset` of {turns} less the given"
    return f"an `offset` of {turns} more than the given"


def check_convention(fit: CaptureFit, normals: Float32Array, mask: BoolArray) -> AngleConvention:
    """Compare measured angles with those of specular light, which is crosswise to the normal.

    On steep parts of metals and of glossy dielectrics specular light rules, and its plane is known
    from the normal alone, which checks the angles of the polariser. Diffuse light is turned by 90°.
    """
    x, y = normals[..., 0].astype(np.float64), normals[..., 1].astype(np.float64)
    steep = mask & (np.hypot(x, y) > _STEEP)
    measured = _polarised_light(fit, steep)
    specular = -np.square(x[steep] + 1j * y[steep])
    total = float(np.abs(measured * specular).sum())
    if total == 0.0:
        return AngleConvention(0.0, 0.0, 0.0, 0.0)
    sums = [(m * specular.conj()).sum() for m in (measured, measured.conj())]
    values = [(abs(s) / total, float(np.degrees(np.angle(s))) / 2.0) for s in sums]
    return AngleConvention(*values[0], *values[1])


class OutlineTurn(NamedTuple):
    """How polarisation near the outlines of objects turns with them.

    `with_outlines` is the share of its variation that turns as normals do, and `against_outlines`
    the share that turns the other way. The rotations say how far either stands anticlockwise of
    both mirrored and diffuse light, which differ by 90°: from −45° to 45°.
    """

    with_outlines: float
    rotation_deg: float
    against_outlines: float
    rotation_reversed_deg: float

    @property
    def doubt(self) -> str | None:
        """A warning that angles seem to be counted otherwise, or None where they may be right."""
        low, high = sorted((self.with_outlines, self.against_outlines))
        if high < _SURE or high < _CLEAR * low:
            return None
        reverse = self.against_outlines > self.with_outlines
        turn = -(self.rotation_reversed_deg if reverse else self.rotation_deg)
        if not reverse and abs(turn) < _TURNED_DEG:
            return None
        turns = f"{round(turn)}° or {round(turn - math.copysign(90, turn))}°"  # not -0°
        how = "turns against" if reverse else "stands askew to"
        return (
            f"the polarisation {how} the outlines of the mask, as that of mirrored or diffuse"
            f" light seldom does; {_fitting(reverse, turns)}, would fit: check `sense`, `zero` and"
            " `offset`"
        )


def check_outlines(fit: CaptureFit, objects: Sequence[BoolArray], known: BoolArray) -> OutlineTurn:
    """Compare how angles of polarisation turn along the outlines of objects with how these turn.

    Parameters
    ----------
    fit : CaptureFit, of pictures (height, width)
    objects : masks (height, width); each part that hangs together is looked at by itself
    known : (height, width), where the fit can be believed: nothing is clipped

    Notes
    -----
    With α the azimuth of the nearest outline's outward normal, s1 + i s2 near it is fitted by
    a + b exp(2iα) + c exp(−2iα), by least squares: light from one direction, which turns nowhere,
    is in a; b is mirrored (b < 0) or diffuse (b > 0) light; c is neither. Shares are of what
    a leaves, by how much worse the fit gets without b, or without c; of several parts, they are
    added as vectors that stand at their rotations.

    Examples
    --------
    A disk whose light is polarised along its outline:

    >>> y, x = np.mgrid[1:-1:64j, -1:1:64j]
    >>> mirrored = -np.square(x + 1j * y)[..., None]
    >>> stokes = np.stack([np.full_like(x, 2)[..., None], mirrored.real, mirrored.imag], -1)
    >>> fit = CaptureFit(stokes.astype(np.float32), np.zeros((64, 64, 1), np.float32), 0, (), ())
    >>> disk = x**2 + y**2 < 0.9
    >>> turn = check_outlines(fit, [disk], disk)
    >>> round(turn.with_outlines, 1), round(turn.against_outlines, 1), turn.doubt
    (1.0, 0.0, None)
    """
    total, bright, shares = 0.0, 0.0, np.zeros(2, dtype=np.complex128)
    for where, part in (each for mask in objects for each in _parts(mask)):
        near, azimuth = _near_the_outline(part)
        light = _polarised_light(fit, where)
        near &= known[where] & np.isfinite(light)
        varying, explained = _explained(light[near], azimuth[near])
        if varying:
            total += varying
            bright += float(np.square(fit.stokes[where][near, :, 0].sum(axis=-1)).sum())
            shares += explained
    if total <= _WEAK**2 * bright:
        return OutlineTurn(0.0, 0.0, 0.0, 0.0)
    sizes, rotations = np.abs(shares) / total, np.degrees(np.angle(shares)) / 4
    # Reversed, s1 − i s2 turns as it should, by minus the angle of c.
    return OutlineTurn(*map(float, (sizes[0], rotations[0], sizes[1], -rotations[1])))


def _polarised_light(fit: CaptureFit, chosen: BoolArray | tuple[slice, slice]) -> Complex128Array:
    """s1 + i s2 of the chosen pixels, summed over channels."""
    field = fit.stokes[chosen][..., 1:].sum(axis=-2, dtype=np.float64)
    light: Complex128Array = field[..., 0] + 1j * field[..., 1]
    return light


def _parts(mask: BoolArray) -> Iterator[tuple[tuple[slice, slice], BoolArray]]:
    """Where each part of a mask that hangs together lies, thinned out, and what it covers there."""
    labels, _ = ndimage.label(mask)
    for number, (rows, columns) in enumerate(ndimage.find_objects(labels), start=1):
        step = max(1, -(-max(rows.stop - rows.start, columns.stop - columns.start) // _SIDE))
        # Two pixels around it are what the outline is seen by, where the picture goes on.
        around = (_wider(rows, 2 * step, step), _wider(columns, 2 * step, step))
        part = labels[around] == number
        if np.count_nonzero(part) >= _FEWEST:
            yield around, part


def _wider(span: slice, margin: int, step: int) -> slice:
    return slice(max(0, span.start - margin), span.stop + margin, step)


def _near_the_outline(part: BoolArray) -> tuple[BoolArray, Float64Array]:
    """Which pixels of a part lie near its outline, and the azimuth of the normal out of it there.

    The frame of the picture is no outline: the distance is to the nearest pixel off the mask.
    """
    if part.all():
        return np.zeros_like(part), np.zeros(part.shape)
    size = float(np.sqrt(np.count_nonzero(part)))
    distance = ndimage.distance_transform_edt(part)
    # Smoothed, as the distance has creases, and outlines have steps of a pixel.
    down, right = np.gradient(ndimage.gaussian_filter(distance, 1 + size / 60))
    nearest, farthest = max(1.0, _NEAR[0] * size), max(3.0, _NEAR[1] * size)
    return part & (distance > nearest) & (distance < farthest), np.arctan2(down, -right)


def _explained(light: Complex128Array, azimuth: Float64Array) -> tuple[float, Complex128Array]:
    """Squared variation of light (pixels,), and what turning with and against azimuths explains.

    The second is what the sum of squares of the fit grows by without either, at the angle of twice
    its phase, so that mirrored and diffuse light count alike.
    """
    turning = np.exp(2j * azimuth)
    parts = np.stack([np.ones_like(turning), turning, turning.conj()], axis=1)
    gram = parts.conj().T @ parts
    nothing = 0.0, np.zeros(2, dtype=np.complex128)
    if len(light) < _FEWEST / 3 or np.linalg.cond(gram) > _ONE_DIRECTION:
        return nothing
    factors = np.linalg.solve(gram, parts.conj().T @ light)
    growth = np.square(np.abs(factors)) / np.linalg.inv(gram).diagonal().real
    varying = float(np.square(np.abs(light)).sum() - np.abs(light.sum()) ** 2 / len(light))
    return varying, (growth * np.exp(2j * np.angle(factors)))[1:]
