"""The viewer with the virtual polariser: its HTML and its data; its script is in `assets/`."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import pandas as pd
from markupsafe import Markup

from malus.reports.tables.formats import error_text, skill_text
from malus.reports.tables.rows import overall_rows
from malus.reports.templates.render import asset, render
from malus.reports.viewer.pack import Packer, Shown
from malus.scenes.core.errors import counted, printable

_PANELS = (
    ("truth", "Truth, I(ϑ)", "grey"),
    ("estimate", "Reconstruction, I(ϑ)", "grey"),
    ("difference", "Difference, reconstruction − truth", "diverging"),
    ("dolp-truth", "DoLP, truth", "sequential"),
    ("dolp-estimate", "DoLP, reconstruction", "sequential"),
    ("aolp-truth", "AoLP, truth", "cyclic"),
    ("aolp-estimate", "AoLP, reconstruction", "cyclic"),
)

_COLOURS = {
    False: "all bands are seen through the CIE 1931 standard observer",
    True: "channels are taken for the primaries of sRGB",
}
"""How bands, and channels of a photograph, become the colour that is shown."""


def viewer(shown: Sequence[Shown], left_out: int, table: pd.DataFrame) -> Markup:
    """The viewer with its data: at least one scene; so many have been left out."""
    packer = Packer()
    skills, unmixed, errors = (
        overall_rows(table, metric) for metric in ("skill", "skill_unmixed", "nmse")
    )
    scenes = [
        packer.scene(one, {"scores": _scores(skills, unmixed, errors, one.example.scene)})
        for one in shown
    ]
    return render(
        "viewer.html",
        panels=_PANELS,
        data={"tables": _colour_maps(), "scenes": scenes},
        blocks=packer.blocks,
        colours=" and ".join(dict.fromkeys(_COLOURS[bool(one.example.channels)] for one in shown)),
        left_out=counted(left_out, "further scene") if left_out else "",
        bands_left_out=any(len(one.bands) < len(one.example.band_names) for one in shown),
        surroundings_left_out=not all(one.with_surroundings for one in shown),
    )


def _scores(
    skills: pd.DataFrame, unmixed: pd.DataFrame, errors: pd.DataFrame, scene: str
) -> dict[str, dict[str, str]]:
    """Error and skill of every method on a scene, as text."""
    skill, of_unmixed, error = (
        rows[rows["scene"] == scene].set_index("method")["value"].to_dict()
        for rows in (skills, unmixed, errors)
    )
    return {
        printable(method): {
            "nmse": error_text(value),
            "skill": skill_text(skill.get(method, np.nan)),
            "unmixed": skill_text(of_unmixed.get(method, np.nan)),
        }
        for method, value in error.items()
    }


def _colour_maps() -> dict[str, str]:
    """256 RGB colours of every colour map, as base64 text: Matplotlib's, which loads slowly."""
    tables: dict[str, str] = json.loads(asset("colour_maps.json"))
    return tables


def example_scenes(shown: Sequence[Shown], table: pd.DataFrame) -> dict[tuple[str, str, str], str]:
    """For every (light, surface, body) of the viewer's scenes, one of them."""
    ids = {one.example.scene for one in shown}
    rows = table[table["scene"].isin(ids)].drop_duplicates("scene")
    columns = zip(rows["light"], rows["surface"], rows["body"], rows["scene"], strict=True)
    return {(light, surface, body): scene for light, surface, body, scene in columns}
