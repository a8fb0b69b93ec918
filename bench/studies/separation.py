"""Study of the separations by colour: error of I_s against the exact lobes of renders.

Bodies in seven colours, some strong and some pale, under one distant light of known colour.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from malus.bench.studies.single_image import SAMPLES, photo_scenes, separation_row
from malus.bench.studies.study import Findings
from malus.reconstruct.single_image.separation import SEPARATIONS
from malus.renderers.families.family import render_family
from malus.renderers.variant import Variant, choose
from malus.reports.tables.formats import as_csv
from malus.reports.tables.separation import separation_cells
from malus.scenes.core.files import write_text
from malus.scenes.materials.surface import Dielectric
from malus.scenes.scene import Sampling, Scene


def findings(folder: Path, every: int, resolution: int, backend: str) -> Findings:
    """Run the study and write its table into a folder."""
    table = separation_table(choose(backend), every, resolution)
    write_text(folder / "separation.csv", as_csv(table))
    cells = separation_cells(table)
    lines = (": ".join((line[0], ", ".join(line[2:]))) for line in cells.lines)
    return Findings((", ".join(cells.heads[2:]), *lines, f"written to {folder}"))


def separation_table(variant: Variant, every: int, resolution: int) -> pd.DataFrame:
    """Separate the picture of every scene in every way.

    Parameters
    ----------
    variant : Variant
    every : int
        Every n-th material, a divisor of 24.
    resolution : int
        Pixels a side.

    Returns
    -------
    DataFrame
        Columns shape, body, light, colour (of the body), separation, rmse (of I_s over its largest
        value; NaN where the picture cannot be separated) and why (it cannot).
    """
    scenes = photo_scenes(("sphere", "blob"), every, resolution, coloured=True)
    return pd.DataFrame([row for scene in scenes for row in _rows(scene, variant)])


def _rows(scene: Scene, variant: Variant) -> Iterator[dict[str, Any]]:
    family = render_family([scene], Sampling(samples=SAMPLES), variant, errors=False)
    row = separation_row(family.truth(scene, standard_error=False))
    assert isinstance(scene.surface, Dielectric)
    for name in SEPARATIONS:
        yield {
            "shape": row["shape"],
            "body": row["body"],
            "light": row["light"],
            "colour": scene.surface.albedo,
            "separation": name,
            "rmse": row.get(name, float("nan")),
            "why": row.get("failed", ""),
        }
