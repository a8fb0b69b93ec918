"""What one ordinary image tells, stage by stage, on truths.

To run it: `malus bench single-image`.

Every stage is measured against the truth of the same scenes: separation by colour on coloured
bodies; shape, parameters and polarisation on grey ones, where separation has to come from the
shape, or where asked on the same coloured bodies. With a file of rows a measurement
that was stopped goes on where it stopped.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from malus.bench.scoring.metrics import Error, Residuals, peak, skill
from malus.bench.scoring.observe import observe
from malus.bench.studies.single_image_rows import Row, kept_rows
from malus.bench.studies.single_image_scenes import BANDS_NM, photo_scenes
from malus.reconstruct import Components, Inapplicable
from malus.reconstruct.single_image.blind import run_chain
from malus.reconstruct.single_image.convergence import Convergence
from malus.reconstruct.single_image.illuminant import ILLUMINANTS, specular_tint
from malus.reconstruct.single_image.separation import SEPARATIONS, separate
from malus.renderers.families.family import render_family
from malus.renderers.truth import Truth
from malus.scenes import Distant, Sampling, Scene

Image = NDArray[np.floating[Any]]

LEVELS = {
    "blind": frozenset[str](),
    "blind-light": frozenset({"light"}),
    "blind-normals": frozenset({"light", "normals"}),
}


def separation_row(truth: Truth) -> Row:
    """RMSE of I_s over its largest value, by method, without and with the tint of dispersion."""
    true, mask = truth.specular[..., 0], truth.mask
    tint = specular_tint(BANDS_NM)
    row = _scene_columns(truth)
    for method in SEPARATIONS:
        for label, used in (("", None), ("+tint", tint)):
            try:
                found = separate(truth.image, mask, None, method, used).specular
            except Inapplicable as reason:
                return {**row, "failed": str(reason)}
            error = np.sqrt(np.mean(np.square((found - true)[mask], dtype=np.float64)))
            row[method + label] = float(error) / float(true[mask].max())
    for name, estimator in ILLUMINANTS.items():
        try:
            colour = estimator(truth.image, mask).colour
        except Inapplicable:
            row[f"light {name}"] = np.nan
            continue
        cosine = colour.sum() / np.linalg.norm(colour) / np.sqrt(len(colour))
        row[f"light {name}"] = float(np.degrees(np.arccos(min(1.0, cosine))))
    return row


def chain_row(truth: Truth, level: str) -> Row:
    """Errors of normals, index, roughness, light and polarisation of the chain at one level."""
    row = {**_scene_columns(truth), "level": level}
    started = time.perf_counter()
    try:
        chain = run_chain(observe(truth, LEVELS[level]))
    except Inapplicable as reason:
        return {**row, "failed": str(reason)}
    row["seconds"] = time.perf_counter() - started
    found, mask = chain.observation, truth.mask
    cosine = np.clip((found.require("normals") * truth.normals)[mask].sum(axis=-1), -1, 1)
    eta, alpha = float(np.mean(found.require("eta"))), float(found.require("alpha"))
    error, guess, noise = _errors(chain.components, truth)
    row |= {
        "normals_deg": float(np.degrees(np.arccos(cosine)).mean()),
        "eta_error": abs(eta - float(np.mean(truth.eta.real))),
        "alpha_error": abs(alpha / float(np.mean(truth.alpha)) - 1.0),
        "body_right": float(chain.body == truth.scene.surface.body),
        "light_deg": _light_error(found.light, truth.scene.light_in_image),
        "nmse": error,
        "skill": skill(Error(error, noise), Error(guess, noise), int(mask.sum())),
    }
    return row | _convergence_columns(chain.convergence)


def _convergence_columns(found: Convergence | None) -> Row:
    if found is None:
        return {}
    unanimous = float(found.agreed == found.starts)
    return {
        "converged": float(found.converged),
        "residual": found.residual,
        "unanimous": unanimous,
        "rival": found.rival,
        "decided": float(found.decided),
    }


def _errors(found: Components, truth: Truth) -> tuple[float, float, float]:
    """NMSE of an estimate, of the guess that does nothing, and of the noise in both.

    A method that keeps the image has, to first order, the noise of that guess.
    """
    mask, unit = truth.mask, peak(truth)
    true = truth.stokes[mask]
    polarised = np.array([0, 1, 1], dtype=true.dtype)
    noise = (truth.specular_noise + truth.diffuse_noise)[mask]
    differences = (found.stokes[mask] - true, true * polarised, noise * polarised)
    error, guess, part = (Residuals.of(d, unit).nmse() for d in differences)
    return error, guess, part


def _light_error(found: Any, true: Any) -> float:
    assert isinstance(found, Distant)
    assert isinstance(true, Distant)
    cosine = float(np.dot(found.direction, true.direction))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _scene_columns(truth: Truth) -> Row:
    scene = truth.scene
    return {
        "scene": scene.id,
        "shape": scene.shape.label,
        "surface": scene.surface.label,
        "material": scene.surface.material_label,
        "body": scene.surface.body,
        "light": scene.light.label,
    }


def megapixels_per_second(megapixels: float = 2.0, repeats: int = 3) -> dict[str, float]:
    """Speed of every separation on a picture of 16 colours; the best of several runs."""
    rng = np.random.default_rng(0)
    side = round((megapixels * 1e6) ** 0.5 / 32)
    colours = np.kron(rng.random((32, 32, 3)), np.ones((side, side, 1)))
    shade = rng.random((32 * side, 32 * side, 1))
    image = (colours * shade + 0.2 * (shade > 0.7)).astype(np.float32)
    mask = np.ones(image.shape[:2], bool)
    found = {}
    for method in SEPARATIONS:
        times = []
        for _ in range(1 if method == "suv" else repeats):
            started = time.perf_counter()
            separate(image, mask, None, method)
            times.append(time.perf_counter() - started)
        found[method] = mask.size / 1e6 / min(times)
    return found


def measured(scenes: Sequence[Scene], levels: Sequence[str], path: Path | None) -> list[Row]:
    """A row a scene and level, the level '' being separation; those in the file are not redone."""
    kept = kept_rows(path) if path else {}
    for scene in scenes:
        missing = [level for level in levels if (scene.id, level) not in kept]
        if not missing:
            continue
        truth = render_family([scene], Sampling(samples=64)).truth(scene)
        for level in missing:
            row = chain_row(truth, level) if level else separation_row(truth)
            kept[scene.id, level] = row
            if path:
                with path.open("a", encoding="utf-8") as file:
                    print(json.dumps(row), file=file)
    return [kept[scene.id, level] for scene in scenes for level in levels]


_QUANTILES = {"median": 0.5, "lower quartile": 0.25, "least": 0.0, "largest": 1.0}


def summary_lines(table: pd.DataFrame) -> list[str]:
    """Quantiles and means of every column of numbers, by shape, body and level."""
    keys = [key for key in ("shape", "body", "level") if key in table]
    numbers = [c for c in table.columns if table[c].dtype.kind == "f"]
    grouped = table.groupby(keys)
    statistics = {name: grouped[numbers].quantile(q) for name, q in _QUANTILES.items()}
    statistics |= {"mean": grouped[numbers].mean(), "scenes": grouped[["scene"]].count()}
    lines = []
    for name, statistic in statistics.items():
        text = statistic.to_string(float_format="{:.4g}".format, line_width=200)
        lines += [f"{name}:", text]
    if "failed" in table:
        lines.append(f"failed: {table['failed'].notna().sum()} of {len(table)}")
    return lines


def single_image(
    stage: str,
    shapes: Sequence[str] = ("sphere", "blob"),
    every: int = 1,
    levels: Sequence[str] = ("blind-light",),
    resolution: int = 48,
    coloured: bool = False,
    rows_file: Path | None = None,
) -> pd.DataFrame:
    """Measure one stage of the chain on 24 materials x 5 surfaces x 2 bodies x 4 lights.

    Parameters
    ----------
    stage : 'separation' or 'chain'
    shapes : 'sphere', 'blob' (seed 0) or 'blobN'
    every : every n-th material, a divisor of 24
    levels : names of `LEVELS`, for the chain
    resolution : pixels a side
    coloured : coloured bodies for the chain, too
    rows_file : Path, optional
        Every row is written to it as a line of JSON; scenes that it has are not measured again.

    Returns
    -------
    DataFrame
        One row a scene, and level of the chain.

    Raises
    ------
    InputError
        If the file holds something else than rows of this study.
    """
    chain = stage == "chain"
    scenes = photo_scenes(shapes, every, resolution, coloured or not chain)
    return pd.DataFrame(measured(scenes, levels if chain else ("",), rows_file))
