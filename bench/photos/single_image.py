"""What one ordinary image tells, stage by stage, on truths.

To run it: `python -m malus.bench.photos.single_image`.

Every stage is measured against the truth of the same scenes: separation by colour on coloured
bodies; shape, parameters and polarisation on grey ones, where separation has to come from the
shape, or with `--coloured` on the same coloured bodies.
"""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Iterator, Sequence
from typing import Any

import click
import numpy as np
from numpy.typing import NDArray

from malus.bench.scoring.metrics import Error, Residuals, peak, skill
from malus.bench.scoring.view import observe
from malus.reconstruct import Components, Inapplicable
from malus.reconstruct.single_image.blind import run_chain
from malus.reconstruct.single_image.convergence import Convergence
from malus.reconstruct.single_image.illuminant import ILLUMINANTS, mirrored_tint
from malus.reconstruct.single_image.separation import SEPARATIONS, separate
from malus.renderers.family import render_family
from malus.renderers.truth import Truth
from malus.scenes import Blob, Camera, Dielectric, Distant, Sampling, Scene, Sphere
from malus.scenes.lights import Distant as DistantLight
from malus.scenes.materials import materials, surfaces

Image = NDArray[np.floating[Any]]
Row = dict[str, Any]

COLOURS = ("blue", "light_skin", "green", "foliage", "red", "yellow", "magenta")
"""Swatches of coloured bodies, some strong, some pale; scenes take turns."""
INCIDENCES_DEG = (20.0, 45.0, 60.0, 80.0)
BANDS_NM = (450.0, 550.0, 650.0)
LEVELS = {
    "blind": frozenset[str](),
    "blind-light": frozenset({"light"}),
    "blind-normals": frozenset({"light", "normals"}),
}


def truths(shapes: Sequence[str], every: int, resolution: int, coloured: bool) -> Iterator[Truth]:
    """All 24 x 5 x 2 bodies x 4 lights of each shape, or every n-th of them.

    Materials and colours take turns, so that a part of the scenes stands for all of them.
    """
    colours = itertools.cycle(COLOURS if coloured else (None,))
    lit = itertools.product(surfaces(), ("unpolarised", "polarised"), INCIDENCES_DEG)
    for turn, (surface, body, incidence) in enumerate(lit):
        # Seven and 24 have no common divisor: the first material of a turn is each one in turn.
        names = list(materials())[7 * turn % every :: every]
        for shape in shapes:
            scenes = [
                _scene(shape, name, surface, body, incidence, resolution, next(colours))
                for name in names
            ]
            family = render_family(scenes, Sampling(samples=64))
            yield from (family.truth(scene) for scene in scenes)


def _scene(
    shape: str,
    material: str,
    surface: str,
    body: Any,
    incidence: float,
    resolution: int,
    colour: str | None,
) -> Scene:
    made = Dielectric.named(material, surface, body)
    return Scene(
        shape=Sphere() if shape == "sphere" else Blob(seed=int(shape.removeprefix("blob") or 0)),
        surface=made if colour is None else made.model_copy(update={"albedo": colour}),
        light=Distant(incidence_deg=incidence),
        camera=Camera(resolution=resolution),
        wavelengths_nm=BANDS_NM,
    )


def separation_row(truth: Truth) -> Row:
    """RMSE of I_s over its largest value, by method, without and with the tint of dispersion."""
    true, mask = truth.specular[..., 0], truth.mask
    tint = mirrored_tint(BANDS_NM)
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
    assert isinstance(found, DistantLight)
    assert isinstance(true, DistantLight)
    cosine = float(np.dot(found.direction, true.direction))
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _scene_columns(truth: Truth) -> Row:
    scene = truth.scene
    return {
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


def _summary(rows: list[Row], group: Sequence[str]) -> None:
    import pandas as pd

    table = pd.DataFrame(rows)
    numbers = [c for c in table.columns if table[c].dtype.kind == "f"]
    with pd.option_context("display.width", 200, "display.max_columns", 40):
        for statistic in ("median", "mean"):
            click.echo(f"{statistic}:")
            grouped = table.groupby(list(group))[numbers]
            click.echo(grouped.agg(statistic).to_string(float_format="{:.4g}".format))
    if "failed" in table:
        click.echo(f"failed: {table['failed'].notna().sum()} of {len(table)}")


@click.command()
@click.option("--stage", type=click.Choice(["separation", "chain", "speed"]), required=True)
@click.option("--shape", "shapes", multiple=True, default=("sphere", "blob"), show_default=True)
@click.option("--every", type=click.IntRange(1, 24), default=1, help="Every n-th material.")
@click.option("--level", "levels", multiple=True, default=("blind-light",), show_default=True)
@click.option("--resolution", default=48, show_default=True)
@click.option("--coloured", is_flag=True, help="Coloured bodies for the chain too.")
@click.option("--rows", "out", type=click.File("w"), help="Write every row as a line of JSON.")
def main(
    stage: str,
    shapes: tuple[str, ...],
    every: int,
    levels: tuple[str, ...],
    resolution: int,
    coloured: bool,
    out: Any,
) -> None:
    """Measure one stage of the single-image chain on 24 materials x 5 surfaces x 2 bodies."""
    if stage == "speed":
        click.echo(json.dumps(megapixels_per_second(), indent=1))
        return
    rows = []
    for truth in truths(shapes, every, resolution, coloured or stage == "separation"):
        for level in levels if stage == "chain" else ("",):
            row = chain_row(truth, level) if level else separation_row(truth)
            rows.append(row)
            if out is not None:
                # A line at once, so that a run that is stopped keeps what it measured.
                print(json.dumps(row), file=out, flush=True)
    _summary(rows, ["shape", "body", "level"] if stage == "chain" else ["shape", "body"])


if __name__ == "__main__":
    main()
