"""A reconstruction from the mean of a capture against the capture: Table I on real pictures."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.bench.scoring.metrics import Error, Residuals, skill
from malus.reconstruct.photos.capture import Capture
from malus.reconstruct.photos.capture_fit import Fit, convention
from malus.reconstruct.photos.estimate import Knowledge, estimate
from malus.scenes import polarisation
from malus.scenes.colour import lab_of_linear_srgb
from malus.scenes.polarisation import PAPER_ANGLES_DEG

Image = NDArray[np.floating[Any]]
Floats = NDArray[np.float64]


def score_capture(capture: Capture, fit: Fit, known: Knowledge, where: str) -> dict[str, Any]:
    """NMSE, skill and ΔE76 of what is told from the unpolarised image, against the fit.

    The unpolarised image is s0, twice the mean of the pictures. Clipped pixels and those off the
    mask are left out; the noise of the capture is in both errors.

    Raises
    ------
    InputError
        Where no method works on this picture.
    """
    image = np.maximum(fit.stokes[..., 0], 0)
    found = estimate(image, known, where)
    components = found.components
    mask = ~capture.clipped if known.mask is None else known.mask & ~capture.clipped
    if known.normals is not None:
        mask = mask & (known.normals[..., 2] > 0)
    estimated = np.stack([image[mask], components.s1[mask], components.s2[mask]], axis=-1)
    true = fit.stokes[mask]
    trivial = true * np.array([1, 0, 0], dtype=true.dtype)
    peak = max(float(image[mask].max(initial=0.0)), 1e-30)
    errors = [Residuals.of(guess - true, peak) for guess in (estimated, trivial)]
    nmse, guess = (error.nmse() for error in errors)
    doubt = convention(fit, known.normals, mask).doubt if known.normals is not None else None
    return {
        "convention": doubt,
        "pixels": int(mask.sum()),
        "nmse": nmse,
        "nmse_trivial": guess,
        "skill": skill(Error(nmse, 0.0), Error(guess, 0.0), int(mask.sum())),
        "best_gain": _best_gain(estimated, true),
        "delta_e76": colour_differences(estimated, true, peak),
        "delta_e76_trivial": colour_differences(trivial, true, peak),
        "statements": list(found.statements),
        "warnings": list(found.warnings),
    }


def _best_gain(estimated: Image, true: Image) -> float:
    """Factor on the estimated polarisation that would fit best: < 0 is a turn by 90°."""
    a, b = estimated[..., 1:].astype(np.float64), true[..., 1:].astype(np.float64)
    power = float((a * a).sum())
    return float((a * b).sum()) / power if power > 0 else float("nan")


def colour_differences(estimated: Image, true: Image, white: float) -> dict[str, list[float]]:
    """Mean and standard deviation over pixels of ΔE76, for I_max, I_min and the paper's angles.

    Stokes vectors (pixels, 1 or 3, 3) in linear sRGB primaries, `white` the radiance of white.
    """
    views: dict[str, Callable[[Image], Image]] = {
        "i_max": lambda stokes: polarisation.extremes(stokes)[0],
        "i_min": lambda stokes: polarisation.extremes(stokes)[1],
    }
    for angle in PAPER_ANGLES_DEG:
        views[f"{angle:g}"] = functools.partial(polarisation.polarised, angle_deg=angle)
    found = {}
    for name, view in views.items():
        difference = np.linalg.norm(
            lab_of_linear_srgb(view(estimated), white) - lab_of_linear_srgb(view(true), white),
            axis=-1,
        )
        found[name] = [float(difference.mean()), float(difference.std())]
    return found


def write_fit(out: Path, fit: Fit, results: dict[str, Any]) -> None:
    """capture.json and maps of the fit: I_max, I_min as EXR, DoLP and AoLP as 16-bit PNG.

    Raises
    ------
    InputError
        If the folder cannot be written. Then nothing is.
    """
    import json

    from malus.reconstruct.photos.filter import all_or_nothing
    from malus.reconstruct.photos.picture import Picture
    from malus.reconstruct.photos.png16 import aolp_16bit, save_16bit, to_16bit
    from malus.reconstruct.photos.write_picture import write_picture

    i_max, i_min = polarisation.extremes(fit.stokes)
    summed = fit.stokes.sum(axis=2)
    with all_or_nothing(out) as folder:
        for name, light in (("i_max", i_max), ("i_min", i_min), ("residual", fit.residual)):
            write_picture(folder / f"{name}.exr", Picture(light.astype(np.float32), "EXR", None))
        save_16bit(folder / "dolp.png", to_16bit(polarisation.dolp(summed)))
        save_16bit(folder / "aolp.png", aolp_16bit(summed))
        (folder / "capture.json").write_text(json.dumps(results, indent=1), encoding="utf-8")
