"""Study of the paper's Figure 5: what its "normalised" may mean, and in which scenes it is reached.

Every reading of `malus.bench.scoring.readings` is applied to the same estimates: of `eq8`, which is
told lobes, normals, index and roughness, of the paper's whole chain, which is told nothing, and of
the guess I(ϑ) = I/2. A data set is one light and one albedo, with 24 materials on 5 surfaces, as in
the paper. Truths are the paper's own Torrance-Sparrow renders; under light from all around, which
these cannot do, they are Mitsuba's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from malus.bench.scoring.image_sums import image_sums
from malus.bench.scoring.metrics import peak
from malus.bench.scoring.observe import observe
from malus.bench.scoring.readings import READINGS, DatasetSums
from malus.bench.studies.study import Findings
from malus.reconstruct import Components, Inapplicable, get_method
from malus.renderers.families.family import render_family
from malus.renderers.torrance_sparrow import render_torrance_sparrow
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, choose
from malus.reports.tables.formats import as_csv
from malus.reports.tables.readings import by_dataset, verdicts
from malus.scenes.camera import Camera
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.files import write_text
from malus.scenes.lights.lights import Distant, Light, Uniform
from malus.scenes.materials.materials import materials, surfaces
from malus.scenes.materials.surface import Dielectric
from malus.scenes.scene import Sampling, Scene
from malus.scenes.shapes.shapes import Sphere

LIGHTS: tuple[Light, ...] = (Uniform(), *(Distant(incidence_deg=d) for d in (20, 45, 60, 80)))
ALBEDOS = (0.0, 0.1, 0.3, 0.8)
BANDS_NM = (450.0, 550.0, 650.0)
ORACLE, CHAIN, GUESS = "eq8", "paper", "unpolarised"
CHAIN_EVERY = 10
"""The chain searches for half a second: it gets every tenth object, all materials and surfaces in
turns over the data sets."""
SAMPLES = 256
"""Of the renders under light from all around."""


@dataclass
class _Scored:
    """Estimates of one method on one data set: what they are of, and their sums."""

    about: list[dict[str, Any]] = field(default_factory=list)
    sums: list[Float64Array] = field(default_factory=list)
    pictures: list[tuple[float, float, float]] = field(default_factory=list)
    failed: int = 0

    def add(self, about: dict[str, Any], truth: Truth, estimate: Components) -> None:
        """Keep the sums of an estimate."""
        mask, stokes = truth.mask, truth.stokes
        planes = estimate.image[mask], estimate.s1[mask], estimate.s2[mask]
        true = tuple(stokes[..., k][mask] for k in range(3))
        (sums,) = image_sums(planes, (true[0], true[1], true[2]))
        self.about.append(about)
        self.sums.append(sums)
        self.pictures.append((true[0].size, peak(truth), float(true[0].mean(dtype=np.float64))))

    def errors(self) -> pd.DataFrame:
        """What each estimate is of, and its error in every reading."""
        counts, peaks, means = np.array(self.pictures, dtype=np.float64).T
        dataset = DatasetSums(np.stack(self.sums), counts, peaks, means)
        return pd.DataFrame(self.about).assign(**{name: dataset.errors(name) for name in READINGS})


def findings(folder: Path, every: int, resolution: int, backend: str) -> Findings:
    """Run the study and write its table into a folder."""
    table = paper_readings(choose(backend), every, resolution)
    write_text(folder / "readings.csv", as_csv(table))
    return Findings((*verdicts(by_dataset(table)), f"written to {folder}"))


def paper_readings(variant: Variant, every: int, resolution: int) -> pd.DataFrame:
    """Errors of every method on every data set in every reading.

    Parameters
    ----------
    variant : Variant
        Of the renders under light from all around.
    every : int
        Every n-th material.
    resolution : int
        Pixels a side.

    Returns
    -------
    DataFrame
        Columns reading, light, albedo, method, panel ("eta", "alpha" or "all"), name and x (of the
        material or surface), mean, std (over the objects), objects, and failed (objects of which
        the method told nothing).
    """
    tables = []
    for number, light in enumerate(LIGHTS):
        scored: dict[tuple[float, str], _Scored] = {}
        for truth, about, turn in _truths(light, variant, every, resolution):
            albedo = about["albedo"]
            for method in (ORACLE, CHAIN, GUESS):
                if method != CHAIN or (turn + number) % CHAIN_EVERY == 0:
                    _score(scored.setdefault((albedo, method), _Scored()), method, truth, about)
        for (albedo, method), one in scored.items():
            common = {"light": light.label, "albedo": albedo, "method": method}
            tables.append(pd.DataFrame(list(_rows(one))).assign(**common))
    table = pd.concat(tables, ignore_index=True)
    return table[["reading", "light", "albedo", "method", *_COLUMNS]]


_COLUMNS = ("panel", "name", "x", "mean", "std", "objects", "failed")


def _score(one: _Scored, method: str, truth: Truth, about: dict[str, Any]) -> None:
    chosen = get_method(method)
    try:
        one.add(about, truth, chosen.reconstruct(observe(truth, chosen.needs)))
    except Inapplicable:
        one.failed += 1


def _rows(one: _Scored) -> Iterator[dict[str, Any]]:
    """Means over the objects of each index, of each roughness, and of all, in every reading."""
    if not one.about:
        for name in READINGS:
            yield _row(name, "all", "all", 0.0, np.array([]), one.failed)
        return
    errors = one.errors()
    for name in READINGS:
        for panel, label in (("eta", "material"), ("alpha", "surface")):
            for (of, x), group in errors.groupby([label, panel], sort=False):
                yield _row(name, panel, str(of), float(x), group[name].to_numpy(), 0)
        yield _row(name, "all", "all", 0.0, errors[name].to_numpy(), one.failed)


def _row(
    reading: str, panel: str, name: str, x: float, values: Float64Array, failed: int
) -> dict[str, Any]:
    mean, std = (float(values.mean()), float(values.std())) if values.size else (np.nan, np.nan)
    cells = READINGS[reading].title, panel, name, x, mean, std, values.size, failed
    return dict(zip(("reading", *_COLUMNS), cells, strict=True))


def _truths(
    light: Light, variant: Variant, every: int, resolution: int
) -> Iterator[tuple[Truth, dict[str, Any], int]]:
    """Every truth under a light, what it is of, and its number among the turns of the chain."""
    camera = Camera(resolution=resolution)
    names = list(materials())[::every]
    for j, surface in enumerate(surfaces()):
        scenes = [
            (_scene(light, camera, material, surface, albedo), i + j + k, albedo)
            for k, albedo in enumerate(ALBEDOS)
            for i, material in enumerate(names)
        ]
        for (scene, turn, albedo), truth in zip(
            scenes, _rendered([scene for scene, *_ in scenes], variant), strict=True
        ):
            about = {
                "albedo": albedo,
                "material": scene.surface.material_label,
                "eta": float(scene.eta.real.mean()),
                "surface": surface,
                "alpha": scene.surface.alpha,
            }
            yield truth, about, turn


def _rendered(scenes: Sequence[Scene], variant: Variant) -> Iterator[Truth]:
    if isinstance(scenes[0].light, Distant):
        yield from map(render_torrance_sparrow, scenes)
        return
    family = render_family(scenes, Sampling(samples=SAMPLES, seed=1), variant, errors=False)
    for scene in scenes:
        yield family.truth(scene, standard_error=False)


def _scene(light: Light, camera: Camera, material: str, surface: str, albedo: float) -> Scene:
    named = Dielectric.named(material, surface, "unpolarised")
    grey = named.model_copy(update={"albedo": albedo})
    return Scene(shape=Sphere(), surface=grey, light=light, camera=camera, wavelengths_nm=BANDS_NM)
