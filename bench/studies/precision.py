"""Study of precision: error against run time of R, of rendering, and of whole methods.

Every point of a diagram is a setting that a user could choose: seconds are medians of several runs
after one to warm up, with their spread, and errors are against a far more accurate run of the same
kind. A setting is on the Pareto front when none is both faster and more accurate.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from malus.bench.scoring.judge import Judge
from malus.bench.scoring.observe import observe
from malus.bench.studies.reference import reference_dolp
from malus.bench.studies.study import Findings
from malus.bench.studies.timing import median_and_spread
from malus.reconstruct import get_method, specular_dolp
from malus.reconstruct.facets.table import DolpTable
from malus.renderers.families.family import render_family
from malus.renderers.variant import Variant, choose
from malus.reports.tables.formats import as_csv
from malus.scenes.camera import Camera
from malus.scenes.core.files import write_text
from malus.scenes.lights.lights import Distant, Light, Uniform
from malus.scenes.materials.surface import Dielectric
from malus.scenes.scene import Sampling, Scene
from malus.scenes.shapes.shapes import Sphere

REPEATS = 5
ZENITHS = np.radians(np.linspace(2.0, 88.0, 24))
ETA, SIGMA = 1.5, 11.1
METHODS = ("unpolarised", "eq8", "visible+body", "shadowed+body", "half_vector+body", "lights+body")


def findings(folder: Path, backend: str) -> Findings:
    """Run the study and write its table into a folder."""
    table = precision(choose(backend))
    write_text(folder / "precision.csv", as_csv(table))
    return Findings((f"written to {folder}",), table=table, cells=_cells)


def _cells(row: pd.Series) -> list[str]:
    numbers = {"seconds", "spread", "error"}
    return [f"{value:.2e}" if name in numbers else str(value) for name, value in row.items()]


def precision(variant: Variant, repeats: int = REPEATS) -> pd.DataFrame:
    """Measure all diagrams, as one table.

    Returns
    -------
    DataFrame
        Columns diagram, method, setting, seconds, spread (half the interquartile range of the
        seconds), unit (of work, that the seconds are for), error, pareto.
    """
    rows = [*_ratio_rows(repeats), *_render_rows(variant, repeats), *_method_rows(variant, repeats)]
    table = pd.DataFrame(rows)
    table["pareto"] = False
    for _, points in table.groupby("diagram"):
        table.loc[points.index, "pareto"] = pareto(points["seconds"], points["error"])
    return table


def pareto(seconds: pd.Series, error: pd.Series) -> list[bool]:
    """Whether each point is on the Pareto front: no other is as fast and accurate, better in one.

    Examples
    --------
    >>> pareto(pd.Series([1.0, 2.0, 3.0]), pd.Series([0.3, 0.1, 0.2]))
    [True, True, False]
    """
    points = list(zip(seconds, error, strict=True))
    return [not any(a <= s and b <= e and (a < s or b < e) for a, b in points) for s, e in points]


def _row(
    diagram: str, method: str, setting: str, unit: str, timing: tuple[float, float], error: float
) -> dict[str, Any]:
    seconds, spread = timing
    return {
        "diagram": diagram,
        "method": method,
        "setting": setting,
        "seconds": seconds,
        "spread": spread,
        "unit": unit,
        "error": error,
    }


def _ratio_rows(repeats: int) -> Iterator[dict[str, Any]]:
    """ρ of `visible` at one surface: tolerances of the quadrature, the table, the reference."""
    diagram, unit, count = "ratio", "a value of ρ", len(ZENITHS)
    exact = [reference_dolp(float(z), ETA, SIGMA, "visible") for z in ZENITHS]
    true = np.array([reference.value for reference in exact])
    for exponent in (2, 4, 6, 8, 10):
        tolerance = 10.0**-exponent

        def integrate(tolerance: float = tolerance) -> Any:
            return specular_dolp(ZENITHS, ETA, SIGMA, "visible", tolerance=tolerance)

        error = float(np.abs(integrate() - true).max())
        setting = f"tolerance 1e-{exponent}"
        yield _row(
            diagram,
            "quadrature",
            setting,
            unit,
            median_and_spread(integrate, repeats, count),
            error,
        )
    table = DolpTable(ETA, SIGMA, "visible")
    cosines = np.random.default_rng(1).random(1_000_000).astype(np.float32)
    error = float(np.abs(table(np.cos(ZENITHS)) - true).max())
    timing = median_and_spread(lambda: table(cosines), repeats, len(cosines))
    yield _row(diagram, "table", "already built", unit, timing, error)
    reference = partial(reference_dolp, 1.0, ETA, SIGMA, "visible")
    timing = median_and_spread(reference, max(1, repeats // 2))
    # The change by its last refinement: nothing is more exact to compare it with.
    error = max(value.error for value in exact)
    yield _row(diagram, "adaptive reference", "rings", unit, timing, error)


def _render_rows(variant: Variant, repeats: int) -> Iterator[dict[str, Any]]:
    """Stokes images of 8 indices under uniform light: samples and nodes in η."""
    diagram, unit = "render", "a family of 8 indices, 48² pixels"
    scenes = [_scene(eta, Uniform()) for eta in np.linspace(1.34, 1.68, 8)]
    exact = render_family(scenes, Sampling(samples=4096, seed=99), variant, errors=False)
    true = [exact.truth(scene, standard_error=False).stokes for scene in scenes]
    for samples, nodes in ((4, 6), (16, 6), (64, 6), (256, 6), (4, 2), (64, 2), (256, 2)):
        sampling = Sampling(samples=samples, seed=1)

        def render(sampling: Sampling = sampling, nodes: int = nodes) -> Any:
            return render_family(scenes, sampling, variant, errors=False, nodes=nodes)

        family = render()
        differences = [
            family.truth(scene, standard_error=False).stokes - stokes
            for scene, stokes in zip(scenes, true, strict=True)
        ]
        error = float(np.sqrt(np.mean(np.square(differences))) / np.max(true))
        setting = f"{samples} samples, {nodes} nodes"
        yield _row(diagram, variant.name, setting, unit, median_and_spread(render, repeats), error)


def _method_rows(variant: Variant, repeats: int) -> Iterator[dict[str, Any]]:
    """NMSE without noise of each method that applies, polarised body, seconds a megapixel."""
    for light in (Uniform(), Distant(incidence_deg=60)):
        scene = _scene(1.5, light)
        truth = render_family([scene], Sampling(samples=1024, seed=5), variant).truth(scene)
        judge = Judge(truth)
        for name in METHODS:
            method = get_method(name)
            if name == "half_vector+body" and not isinstance(light, Distant):
                continue
            score = judge.score(method)
            observation = observe(truth, method.needs)

            def reconstruct(method: Any = method, observation: Any = observation) -> Any:
                return method.reconstruct(observation)

            megapixels = truth.mask.size / 1e6
            noise = score.noise.nmse()
            # The smallest measurable error: the difference is uncertain by about that much.
            least = noise / math.sqrt(score.residuals.pixels)
            error = max(score.residuals.nmse() - noise, least)
            timing = median_and_spread(reconstruct, repeats, megapixels)
            yield _row(f"methods, {light.label}", name, "", "a megapixel", timing, error)


def _scene(eta: float, light: Light) -> Scene:
    surface = Dielectric(eta=float(eta), alpha=0.3, albedo=0.5, body="polarised")
    camera = Camera(resolution=48)
    return Scene(shape=Sphere(), surface=surface, light=light, camera=camera)
