"""Compare a reconstruction from a capture's unpolarised image with the capture itself.

Table I of the paper, on real pictures.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from malus.bench.scoring.capture_metrics import CapturedPixels
from malus.reconstruct.photos.angle_convention import check_convention, check_outlines
from malus.reconstruct.photos.capture import Capture, read_capture
from malus.reconstruct.photos.capture_fit import CaptureFit, fit_capture
from malus.reconstruct.photos.estimate import estimate
from malus.reconstruct.photos.knowledge import Knowledge
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.png16 import aolp_16bit, save_16bit, to_16bit
from malus.reconstruct.photos.write_picture import write_picture
from malus.scenes import polarisation
from malus.scenes.colour import (
    GREY,
    RGB,
    channel_weights,
    differences_from,
    weighted_colours,
)
from malus.scenes.core.arrays import BoolArray, FloatArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import add_to_folder
from malus.scenes.core.json_text import json_text


def score_capture(
    capture: Capture | Path | str,
    fit: CaptureFit | None = None,
    knowledge: Knowledge | None = None,
    where: str = "capture",
) -> dict[str, Any]:
    """NMSE, skill and ΔE76 of a reconstruction from the unpolarised image, against the fit.

    The unpolarised image is s0, twice the mean of the pictures. Clipped pixels and those off the
    mask are left out; the noise of the capture is in both errors.

    Parameters
    ----------
    capture : Capture, or path of a folder, which `read_capture` reads as it does by default
    fit : CaptureFit, from `fit_capture`; fitted here where it is None
    knowledge : Knowledge, what the reconstruction is told besides the unpolarised image
    where : name of the capture in errors

    Returns
    -------
    dict of plain values
        `pixels`, `nmse`, `nmse_trivial`, `skill`, `best_gain`; `delta_e76` and `delta_e76_trivial`,
        mean and standard deviation by image; `convention`, `statements` and `warnings` in words.

    Raises
    ------
    InputError
        Where no method works on this picture, or no pixel is left to score.

    Examples
    --------
    A mirror of η = 1.5 at 60°, tilted to the top, which mirrors the same light everywhere:

    >>> from malus.scenes import polarisation
    >>> normals = np.tile(np.array([0, np.sin(np.pi / 3), 0.5], np.float32), (4, 4, 1))
    >>> mirror = Knowledge(normals, eta=1.5, alpha=0.01, mirror=True)
    >>> stokes = np.array([0.5, 0.45, 0.0])
    >>> angles = (0.0, 45.0, 90.0, 135.0)
    >>> pictures = [np.full((4, 4, 3), polarisation.polarised(stokes, a)) for a in angles]
    >>> clipped = np.zeros((4, 4), bool)
    >>> capture = Capture(np.stack(pictures), angles, clipped, tuple("abcd"), "linear")
    >>> score_capture(capture, knowledge=mirror)["skill"] > 0.99
    True
    """
    if not isinstance(capture, Capture):
        where, capture = str(capture), read_capture(capture)
    fit = fit or fit_capture(capture)
    knowledge = knowledge or Knowledge()
    image = np.maximum(fit.stokes[..., 0], 0)
    result = estimate(image, knowledge, where, capture.wavelengths_nm)
    components = result.components
    mask = ~capture.clipped if knowledge.mask is None else knowledge.mask & ~capture.clipped
    if knowledge.normals is not None:
        mask = mask & (knowledge.normals[..., 2] > 0)
    if not mask.any():
        expected, hint = "pixels to score", "clipped ones count not: give another mask"
        raise InputError(where, expected, "none", hint)
    estimated = np.stack([image[mask], components.s1[mask], components.s2[mask]], axis=-1)
    true = fit.stokes[mask]
    trivial = true * np.array([1, 0, 0], dtype=true.dtype)
    pixels = CapturedPixels.of(capture, fit, mask)
    colours = colour_differences if capture.wavelengths_nm is None else _no_colours
    nmse, skill = pixels.errors(estimated / pixels.peak)
    return {
        "convention": convention_doubt(fit, knowledge, ~capture.clipped),
        "pixels": int(mask.sum()),
        "nmse": nmse,
        "nmse_trivial": pixels.errors(trivial / pixels.peak)[0],
        "skill": skill,
        "best_gain": _best_gain(estimated, true),
        "delta_e76": colours(estimated, true, pixels.peak),
        "delta_e76_trivial": colours(trivial, true, pixels.peak),
        "statements": list(result.statements),
        "warnings": list(result.warnings),
    }


def convention_doubt(fit: CaptureFit, knowledge: Knowledge, known: BoolArray) -> str | None:
    """What speaks against how the angles are counted, by normals or else by a mask; or None.

    `known` (height, width) is False where pictures are clipped.
    """
    mask, normals = knowledge.mask, knowledge.normals
    if normals is not None:
        facing = known & (normals[..., 2] > 0)
        return check_convention(fit, normals, facing if mask is None else facing & mask).doubt
    return None if mask is None else check_outlines(fit, [mask], known).doubt


def _best_gain(estimated: FloatArray, true: FloatArray) -> float:
    """Factor on the estimated polarisation that fits best; below 0 it is turned by 90°."""
    a, b = estimated[..., 1:].astype(np.float64), true[..., 1:].astype(np.float64)
    power = float((a * a).sum())
    return float((a * b).sum()) / power if power > 0 else float("nan")


def colour_differences(
    estimated: FloatArray, true: FloatArray, white: float
) -> dict[str, list[float]]:
    """Mean and standard deviation over pixels of ΔE76, for I_max, I_min and the paper's angles.

    Stokes vectors (pixels, 1 or 3, 3) in linear sRGB primaries, `white` the radiance of white.
    Other channels have no colour: nothing is compared then.
    """
    if true.shape[-2] not in (1, 3):
        return {}  # bands of a spectrum, whose light is not that of three primaries
    colours = weighted_colours(true / white, channel_weights(RGB if true.shape[-2] == 3 else GREY))
    return {
        suffix.removeprefix("_") or f"{angle:g}": [float(values.mean()), float(values.std())]
        for suffix, angle, values in differences_from(colours, estimated / white)
    }


def _no_colours(*_: object) -> dict[str, list[float]]:
    """Bands of a spectrum are not the light of three primaries."""
    return {}


def write_fit(
    out: Path | str, fit: CaptureFit, results: dict[str, Any], channels: tuple[str, ...] = ()
) -> None:
    """Write capture.json and maps of the fit: I_max, I_min as EXR, DoLP and AoLP as 16-bit PNG.

    `channels` names the channels of the EXR files where they are bands of a spectrum.

    Raises
    ------
    InputError
        If the folder cannot be written. Then nothing is.
    """
    i_max, i_min = polarisation.extremes(fit.stokes)
    summed = fit.stokes.sum(axis=2)

    metadata = {"names": channels} if channels else {}

    def write(folder: Path) -> None:
        for name, light in (("i_max", i_max), ("i_min", i_min), ("residual", fit.residual)):
            write_picture(
                folder / f"{name}.exr",
                Picture(light.astype(np.float32), "EXR", None, None, metadata),
            )
        save_16bit(folder / "dolp.png", to_16bit(polarisation.dolp(summed)))
        save_16bit(folder / "aolp.png", aolp_16bit(summed))
        (folder / "capture.json").write_text(json_text(results, 1), encoding="utf-8")

    add_to_folder(Path(out), write)
