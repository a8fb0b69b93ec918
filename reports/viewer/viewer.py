"""The viewer with the virtual polariser: its HTML and its data; its script is in `assets/`."""

from __future__ import annotations

import base64

import numpy as np
import pandas as pd
from markupsafe import Markup

from malus.reports.tables.formats import counted, scientific, skill_text
from malus.reports.tables.rows import overall_rows
from malus.reports.templates.render import render
from malus.reports.viewer.examples import Example
from malus.reports.viewer.pack import Packer, fitted

_COLOUR_MAPS = {"diverging": "RdBu_r", "sequential": "cividis", "cyclic": "twilight"}
_PANELS = (
    ("truth", "Truth, I(ϑ)", "grey"),
    ("estimate", "Reconstruction, I(ϑ)", "grey"),
    ("difference", "Difference, reconstruction − truth", "diverging"),
    ("dolp-truth", "DoLP, truth", "sequential"),
    ("dolp-estimate", "DoLP, reconstruction", "sequential"),
    ("aolp-truth", "AoLP, truth", "cyclic"),
    ("aolp-estimate", "AoLP, reconstruction", "cyclic"),
)


def viewer(examples: tuple[Example, ...], table: pd.DataFrame) -> Markup:
    """The viewer with its data; `examples` holds at least one scene with a method."""
    shown, left_out = fitted([example for example in examples if example.methods])
    packer = Packer()
    scenes = [packer.scene(example, {"scores": _scores(table, example)}) for example in shown]
    return render(
        "viewer.html",
        panels=_PANELS,
        data={"tables": _colour_maps(), "scenes": scenes},
        blocks=packer.blocks,
        left_out=counted(left_out, "further scene") if left_out else "",
    )


def _scores(table: pd.DataFrame, example: Example) -> dict[str, dict[str, str]]:
    rows = table[table["scene"] == example.scene]
    skills = overall_rows(rows, "skill").set_index("method")["value"].to_dict()
    unmixed = overall_rows(rows, "skill_unmixed").set_index("method")["value"].to_dict()
    errors = overall_rows(rows, "nmse").set_index("method")["value"].to_dict()
    return {
        str(method): {
            "nmse": scientific(error),
            "skill": skill_text(skills.get(method, np.nan)),
            "unmixed": skill_text(unmixed.get(method, np.nan)),
        }
        for method, error in errors.items()
    }


def _colour_maps() -> dict[str, str]:
    """256 RGB colours of every colour map, as base64 text."""
    from matplotlib import colormaps

    levels = np.linspace(0.0, 1.0, 256)
    encoded = {}
    for name, colour_map in _COLOUR_MAPS.items():
        colours = np.rint(255 * colormaps[colour_map](levels)[:, :3]).astype(np.uint8)
        encoded[name] = base64.b64encode(colours.tobytes()).decode("ascii")
    return encoded


def example_scenes(
    examples: tuple[Example, ...], table: pd.DataFrame
) -> dict[tuple[str, str, str], str]:
    """For every (light, surface, body) of the viewer's scenes, one of them."""
    ids = {example.scene for example in fitted([e for e in examples if e.methods])[0]}
    rows = table[table["scene"].isin(ids)].drop_duplicates("scene")
    columns = zip(rows["light"], rows["surface"], rows["body"], rows["scene"], strict=True)
    return {(light, surface, body): scene for light, surface, body, scene in columns}
