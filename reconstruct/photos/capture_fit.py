"""Fit the sinusoid of Equation 1 to real pictures, and warn of what looks wrong with them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from malus.reconstruct.observation import Components
from malus.reconstruct.photos.capture import Capture, read_capture
from malus.reconstruct.photos.capture_angles import check_angles
from malus.reconstruct.photos.movement import (
    MOVED,
    Shift,
    is_sub_grids,
    measure_shifts,
)
from malus.scenes import polarisation
from malus.scenes.core.arrays import Float32Array
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.errors import InputError

CLIPPED = 0.002
"""Share of clipped pixels that is worth a warning."""
UNSTEADY = 0.02
"""Residual of the fit over the mean from which the light, or the polariser, was not steady."""

NOISY = 4.0
"""Times the noise of angles evenly around the half circle from which that of others is told."""


@dataclass(frozen=True)
class CaptureFit:
    """The sinusoid of Equation 1 at every pixel and channel, by least squares.

    Attributes
    ----------
    stokes : (height, width, channels, 3)
        Linear Stokes vectors, in units of the pictures' light.
    residual : (height, width, channels)
        Root mean square over the pictures, in units of light.
    relative_residual : float
        Over all unclipped pixels, divided by their mean light.
    shifts : (pictures,)
        Pixels that each picture moved against the first.
    warnings : tuple of str
        Why the fit may be wrong, in words.

    Examples
    --------
    >>> pictures = np.full((4, 8, 8, 1), 0.5, np.float32)  # unpolarised light of 1
    >>> names = ("a.png", "b.png", "c.png", "d.png")
    >>> angles, clipped = (0.0, 45.0, 90.0, 135.0), np.zeros((8, 8), bool)
    >>> fit = fit_capture(Capture(pictures, angles, clipped, names, "light"))
    >>> fit.stokes[0, 0, 0].round(6).tolist()
    [1.0, 0.0, 0.0]
    """

    __repr__ = brief_repr

    stokes: Float32Array
    residual: Float32Array
    relative_residual: float
    shifts: tuple[float, ...]
    warnings: tuple[str, ...]

    @property
    def components(self) -> Components:
        """The Stokes vectors as `Components`, with DoLP, AoLP and the light through a polariser."""
        return Components(self.stokes[..., 0], self.stokes[..., 1], self.stokes[..., 2])


def fit_capture(capture: Capture | Path | str) -> CaptureFit:
    """Stokes vectors of a capture by least squares, with residuals and warnings.

    I(ϑ) = ½ (s0 − s1 cos 2ϑ − s2 sin 2ϑ) is linear in the Stokes vector: Equation 1 of the paper.

    Parameters
    ----------
    capture : Capture, or path of a folder, which `read_capture` reads as it does by default

    Returns
    -------
    CaptureFit
        Stokes vectors (height, width, channels, 3) in the pictures' light, and what is in doubt.

    Raises
    ------
    InputError
        From `read_capture`, and of a capture whose parts do not belong together, whose angles are
        fewer than three different ones modulo 180°, that is clipped everywhere or has no light.

    Examples
    --------
    >>> i = np.array([0.75, 0.5, 0.25, 0.5], np.float32).reshape(4, 1, 1, 1)
    >>> clipped = np.zeros((1, 1), bool)
    >>> capture = Capture(i, (0.0, 45.0, 90.0, 135.0), clipped, tuple("abcd"), "linear")
    >>> fit_capture(capture).stokes.round(6).tolist()
    [[[[1.0, -0.5, 0.0]]]]
    """
    where = "capture" if isinstance(capture, Capture) else str(capture)
    if not isinstance(capture, Capture):
        capture = read_capture(capture)
    _check(capture, where)
    mean = _mean_light(capture, where)
    matrix = polarisation.analyser(capture.angles_deg)
    inverse = np.linalg.pinv(matrix).astype(np.float32)
    stokes = np.tensordot(capture.pictures, inverse, axes=(0, 1))
    square = np.zeros(stokes.shape[:-1], dtype=np.float32)
    for row, picture in zip(matrix.astype(np.float32), capture.pictures, strict=True):
        square += (stokes @ row - picture) ** 2
    residual = np.sqrt(square / len(capture.pictures))
    good = ~capture.clipped
    relative = float(np.sqrt(np.mean(square[good]) / len(matrix))) / mean
    shifts = [Shift(0.0, 0.0) for _ in capture.names]
    if not capture.one_exposure:
        shifts = list(measure_shifts(capture.pictures, capture.angles_deg))
    warnings = _warnings(capture, stokes, relative, shifts)
    return CaptureFit(stokes, residual, relative, tuple(s.length for s in shifts), warnings)


def _check(capture: Capture, where: str) -> None:
    """Refuse a capture whose parts do not belong together, or whose angles tell no sinusoid."""
    shape, clipped = np.shape(capture.pictures), np.shape(capture.clipped)
    angles, names = len(capture.angles_deg), len(capture.names)
    if len(shape) != 4 or (angles, names, clipped) != (shape[0], shape[0], shape[1:3]):
        expected = "pictures (n, height, width, channels), n angles, n names, clipped as large"
        found = f"{shape}, {angles}, {names}, {clipped}"
        raise InputError(where, expected, found, "correct what differs")
    check_angles(where, capture.angles_deg)


def _mean_light(capture: Capture, where: str) -> float:
    """Mean over all pictures and what is not clipped."""
    good = ~capture.clipped
    if not good.any():
        raise InputError(where, "pixels that are not clipped", "none", "expose shorter")
    mean = float(capture.pictures[:, good].mean())
    if not mean > 0:
        hint = "check the black level"
        raise InputError(where, "pictures with light in them", f"a mean of {mean:.3g}", hint)
    return mean


def _warnings(
    capture: Capture, stokes: Float32Array, relative: float, shifts: Sequence[Shift]
) -> tuple[str, ...]:
    warnings = []
    if capture.clipped.mean() > CLIPPED:
        warnings.append(f"{capture.clipped.mean():.1%} of the pixels are clipped and left out")
    lengths = [shift.length for shift in shifts]
    moved = [n for n, length in zip(capture.names, lengths, strict=True) if length > MOVED]
    if is_sub_grids(shifts):
        warnings.append(
            "the pictures stand half a pixel apart, as those taken out of one frame of a "
            "polarisation camera: give the frame itself, with `mosaic`"
        )
    elif moved:
        warnings.append(f"moved by up to {max(lengths):.1f} pixels: {', '.join(moved)}")
    if len(capture.pictures) == 3:
        warnings.append("three pictures leave no residual: take a fourth to check the fit")
    elif relative > UNSTEADY:
        cause = "light or exposure changed, or angles are wrong"
        if capture.one_exposure:
            cause = "the angles of `mosaic` or the `packing` are wrong, or all is edges"
        warnings.append(f"residual of {relative:.1%}: {cause}")
    noise = noise_by_angles(capture.angles_deg)
    if noise > NOISY:
        warnings.append(
            f"the angles lie close together, modulo 180°: noise in s1 and s2 is {noise:.0f} times"
            " that of as many angles evenly around"
        )
    over = float(np.mean(polarisation.dolp(stokes) > 1.0))
    if over > 0.01:
        warnings.append(f"{over:.1%} of the values are more than completely polarised")
    return tuple(warnings)


def noise_by_angles(angles_deg: Sequence[float]) -> float:
    """Largest standard error in s1 and s2, over that of as many angles evenly around.

    Of the normal equations; of n angles evenly around it is √(8/n) times the noise of a picture.

    Examples
    --------
    >>> round(noise_by_angles((0.0, 60.0, 120.0)), 6), round(noise_by_angles((0.0, 10.0, 20.0)))
    (1.0, 25)
    """
    matrix = polarisation.analyser(angles_deg)
    covariance = np.linalg.inv(matrix.T @ matrix)
    largest = float(np.linalg.eigvalsh(covariance[1:, 1:])[-1])
    return math.sqrt(largest * len(angles_deg) / 8.0)


def capture_summary(capture: Capture, fit: CaptureFit) -> dict[str, Any]:
    """Numbers of a fit, as they stand in `capture.json`."""
    dolp = polarisation.dolp(fit.stokes)[~capture.clipped]
    return {
        "pictures": len(capture.pictures),
        "angles_deg": list(capture.angles_deg),
        "relative_residual": fit.relative_residual,
        "clipped_share": float(capture.clipped.mean()),
        "shifts_pixels": list(fit.shifts),
        "median_dolp": float(np.median(dolp)),
        "dolp_99": float(np.quantile(dolp, 0.99)),
        "assumption": capture.assumption,
        "hints": list(capture.hints),
        "warnings": list(fit.warnings),
    }
