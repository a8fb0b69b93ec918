"""Study of the chain for one ordinary image: errors of each stage, against truths.

To run it: `malus bench single-image`.

Separation of the lobes by colour is measured on coloured bodies; shape, parameters and
polarisation on grey ones, where the separation has to come from the shape, or with `coloured` on
the same coloured bodies. With a file of rows, a study that was stopped goes on where it stopped.
"""

from __future__ import annotations

import json
import random
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from malus.bench.scoring.metrics import Error, Residuals, peak, skill
from malus.bench.scoring.observe import observe
from malus.bench.studies.registry import STUDIES
from malus.bench.studies.study import Findings
from malus.bench.studies.timing import timed
from malus.reconstruct import Components, Inapplicable
from malus.reconstruct.single_image.blind import run_chain
from malus.reconstruct.single_image.convergence import Convergence
from malus.reconstruct.single_image.illuminant import ILLUMINANTS, specular_tint
from malus.reconstruct.single_image.separation import SEPARATIONS, separate
from malus.renderers.families.family import render_family
from malus.renderers.truth import Truth
from malus.renderers.variant import choose, made_by
from malus.scenes import Blob, Camera, Dielectric, Distant, InputError, Sampling, Scene, Sphere
from malus.scenes.core.model import content_id
from malus.scenes.core.registry import lookup
from malus.scenes.materials.materials import materials, surfaces

Row = dict[str, Any]

LEVELS = {
    "blind": frozenset[str](),
    "blind-light": frozenset({"light"}),
    "blind-normals": frozenset({"light", "normals"}),
}
"""Inputs that the chain is given besides the picture, by the name of the level."""

SAMPLES = 64


_SHAPE = re.compile(r"sphere|blob[0-9]{0,6}")


def findings(
    folder: Path | None,
    stage: str,
    shapes: Sequence[str],
    every: int,
    levels: Sequence[str],
    resolution: int,
    coloured: bool,
    rows: Path | str | None,
) -> Findings:
    """Run one stage of the study."""
    told = {"shapes": shapes, "every": every, "levels": levels, "resolution": resolution}
    _check_used(stage, told | {"coloured": coloured, "rows": rows})
    if stage == "speed":
        speeds = megapixels_per_second()
        return Findings(tuple(json.dumps(speeds, indent=1).splitlines()), speeds)
    table = single_image(
        stage, shapes, every, levels, resolution, coloured, None if rows is None else Path(rows)
    )
    figures = json.loads(table.to_json(orient="records"))
    return Findings(tuple(summary_lines(table)), figures)


_UNUSED = {
    "speed": ("shapes", "every", "levels", "resolution", "coloured", "rows"),
    "separation": ("levels", "coloured"),
    "chain": (),
}
"""Options that a stage has no use for."""


def _check_used(stage: str, values: Mapping[str, Any]) -> None:
    """Refuse options that a stage would pass over."""
    for option in STUDIES["single-image"].options:
        name = option.name
        if name in _UNUSED[stage] and values[name] != option.default:
            expected, hint = f"nothing with the stage {stage}", f"leave `{name}` out"
            raise InputError(name, expected, str(values[name]), hint)


def single_image(
    stage: str,
    shapes: Sequence[str],
    every: int,
    levels: Sequence[str],
    resolution: int,
    coloured: bool,
    rows_file: Path | None,
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
        Every row is written to it as a line of JSON; scenes that it has from this version of malus
        are not measured again.

    Returns
    -------
    DataFrame
        One row a scene, and level of the chain.

    Raises
    ------
    InputError
        An unknown level or shape, or a file that holds something else than rows of this study.
    """
    for level in levels:
        lookup(level, LEVELS, "levels", "the name of a level")
    for shape in shapes:
        if not _SHAPE.fullmatch(shape):
            raise InputError("shapes", "sphere, blob, or blob and a seed", shape, "choose one")
    chain = stage == "chain"
    scenes = photo_scenes(shapes, every, resolution, coloured or not chain)
    return pd.DataFrame(list(_rows(scenes, levels if chain else ("",), rows_file)))


def _rows(scenes: Sequence[Scene], levels: Sequence[str], rows_file: Path | None) -> Iterator[Row]:
    """Row of every scene and level, the level '' being separation; rows of the file are kept."""
    made = _made() if rows_file else ""
    rows = _kept_rows(rows_file, made) if rows_file else {}
    for scene in scenes:
        missing = [level for level in levels if (scene.id, level) not in rows]
        if missing:
            truth = render_family([scene], Sampling(samples=SAMPLES)).truth(scene)
        for level in missing:
            row = chain_row(truth, level) if level else separation_row(truth)
            rows[scene.id, level] = row
            if rows_file:
                with rows_file.open("a", encoding="utf-8") as file:
                    print(json.dumps(row | {_MADE: made}), file=file)
        yield from (rows[scene.id, level] for level in levels)


_MADE = "made"
"""Key of a row in the file: what it was made by."""


def _made() -> str:
    """Hash of what decides a row besides its scene and level, as of the parts of a run."""
    return content_id([SAMPLES, choose().name, made_by("mitsuba")])


_START = b'{"scene": "'
"""Start of every row: a file that is cut off elsewhere is not one of this study."""


def _kept_rows(path: Path, made: str) -> dict[tuple[str, str], Row]:
    """Rows of an earlier run by scene and level, if `made` by what makes them now.

    A last line that was cut off is removed.

    Raises
    ------
    InputError
        If another line is not a row.
    """
    if not path.exists():
        return {}
    content = path.read_bytes()
    complete = content[: content.rfind(b"\n") + 1]
    lines, rows = complete.splitlines(), {}
    for number, line in enumerate(lines, start=1):
        try:
            row = json.loads(line)
            key = row["scene"], row.get("level", "")
            if row.pop(_MADE, None) == made:
                rows[key] = row
        except (ValueError, TypeError, KeyError) as error:
            raise _not_a_row(path, number, line) from error
    cut_off = content[len(complete) :]
    if not cut_off.startswith(_START[: len(cut_off)]):
        raise _not_a_row(path, len(lines) + 1, cut_off)
    if cut_off:
        path.write_bytes(complete)
    return rows


def _not_a_row(path: Path, number: int, line: bytes) -> InputError:
    shown = line.decode("utf-8", "replace")
    return InputError(f"{path}, line {number}", "a row of this command", shown, "name a new file")


COLOURS = ("blue", "light_skin", "green", "foliage", "red", "yellow", "magenta")
"""Swatches of coloured bodies, some strong, some pale; materials take turns."""
INCIDENCES_DEG = (20.0, 45.0, 60.0, 80.0)
BANDS_NM = (450.0, 550.0, 650.0)


def photo_scenes(shapes: Sequence[str], every: int, resolution: int, coloured: bool) -> list[Scene]:
    """All 24 x 5 x 2 bodies x 4 lights of each shape, or of every n-th material.

    Materials take turns: with every 24th each of them comes up, with every fourth it comes up once
    on each surface and body, under another light on the next surface. The order is shuffled, always
    in the same way, so that a study that is stopped is a fair sample of all scenes.

    Parameters
    ----------
    shapes : 'sphere', 'blob' (seed 0) or 'blobN'
    every : a divisor of 24
    resolution : pixels a side
    coloured : whether bodies have the colours of `COLOURS`; otherwise they are grey

    Examples
    --------
    >>> [len(photo_scenes(["sphere", "blob"], n, 48, coloured=False)) for n in (24, 4, 1)]
    [80, 480, 1920]
    """
    names = list(materials())
    scenes = []
    lit = product(surfaces(), ("unpolarised", "polarised"), INCIDENCES_DEG)
    for turn, (surface, body, incidence) in enumerate(lit):
        # Seven and 24 have no common divisor. Two bodies on a surface make eight turns: they share
        # the light of a material, and the next surface gets another.
        for index in range((7 * turn + turn // 8) % every, len(names), every):
            colour = COLOURS[(index + turn) % len(COLOURS)] if coloured else None
            dielectric = _surface(names[index], surface, body, colour)
            scenes += [_scene(shape, dielectric, incidence, resolution) for shape in shapes]
    random.Random(0).shuffle(scenes)
    return scenes


def _surface(material: str, surface: str, body: Any, colour: str | None) -> Dielectric:
    grey = Dielectric.named(material, surface, body)
    return grey if colour is None else grey.model_copy(update={"albedo": colour})


def _scene(shape: str, surface: Dielectric, incidence: float, resolution: int) -> Scene:
    return Scene(
        shape=Sphere() if shape == "sphere" else Blob(seed=int(shape.removeprefix("blob") or 0)),
        surface=surface,
        light=Distant(incidence_deg=incidence),
        camera=Camera(resolution=resolution),
        wavelengths_nm=BANDS_NM,
    )


def separation_row(truth: Truth) -> Row:
    """RMSE of I_s over its largest value, by method, without and with the tint of dispersion."""
    true, mask = truth.specular[..., 0], truth.mask
    dispersion = specular_tint(BANDS_NM)
    row = _scene_columns(truth)
    for method in SEPARATIONS:
        for label, tint in (("", None), ("+tint", dispersion)):
            try:
                specular = separate(truth.image, mask, None, method, tint).specular
            except Inapplicable as reason:
                return {**row, "failed": str(reason)}
            error = np.sqrt(np.mean(np.square((specular - true)[mask], dtype=np.float64)))
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
    estimated, mask = chain.observation, truth.mask
    cosine = np.clip((estimated.require("normals") * truth.normals)[mask].sum(axis=-1), -1, 1)
    eta, alpha = float(np.mean(estimated.require("eta"))), float(estimated.require("alpha"))
    error, guess, noise = _nmse(chain.components, truth)
    row |= {
        "normals_deg": float(np.degrees(np.arccos(cosine)).mean()),
        "eta_error": abs(eta - float(np.mean(truth.eta.real))),
        "alpha_error": abs(alpha / float(np.mean(truth.alpha)) - 1.0),
        "body_right": float(chain.body == truth.scene.surface.body),
        "light_deg": _light_error_deg(estimated.light, truth.scene.light_in_image),
        "nmse": error,
        "skill": skill(Error(error, noise), Error(guess, noise), int(mask.sum())),
    }
    return row | _convergence_columns(chain.convergence)


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


def _convergence_columns(convergence: Convergence | None) -> Row:
    if convergence is None:
        return {}
    return {
        "converged": float(convergence.converged),
        "residual": convergence.residual,
        "unanimous": float(convergence.agreed == convergence.starts),
        "rival": convergence.rival,
        "decided": float(convergence.decided),
    }


def _nmse(estimate: Components, truth: Truth) -> tuple[float, float, float]:
    """NMSE of an estimate, of the guess I(ϑ) = I/2, and of the noise in both.

    A method that keeps the image has, to first order, the noise of that guess.
    """
    mask, unit = truth.mask, peak(truth)
    true = truth.stokes[mask]
    polarised = np.array([0, 1, 1], dtype=true.dtype)
    draw = (truth.specular_noise + truth.diffuse_noise)[mask]
    differences = (estimate.stokes[mask] - true, true * polarised, draw * polarised)
    error, guess, noise = (Residuals.of(d, unit).nmse() for d in differences)
    return error, guess, noise


def _light_error_deg(estimated: Any, true: Any) -> float:
    """Angle between two distant lights, degrees."""
    assert isinstance(estimated, Distant)
    assert isinstance(true, Distant)
    cosine = float(np.dot(estimated.direction, true.direction))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def megapixels_per_second() -> dict[str, float]:
    """Speed of every separation on two megapixels of 1024 colours; the best of several runs."""
    rng = np.random.default_rng(0)
    side = round(2e6**0.5 / 32)
    colours = np.kron(rng.random((32, 32, 3)), np.ones((side, side, 1)))
    shade = rng.random((32 * side, 32 * side, 1))
    image = (colours * shade + 0.2 * (shade > 0.7)).astype(np.float32)
    mask = np.ones(image.shape[:2], bool)
    speeds = {}
    for method in SEPARATIONS:
        runs = 1 if method == "suv" else 3
        seconds = min(
            timed(lambda method=method: separate(image, mask, None, method)).clock  # type: ignore[misc]
            for _ in range(runs)
        )
        speeds[method] = mask.size / 1e6 / seconds
    return speeds


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
