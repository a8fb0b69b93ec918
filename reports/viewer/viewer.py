"""The viewer's markup and data; what it does is in `assets/`."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pandas as pd

from malus.reports.html import Markup, join, tag
from malus.reports.tables.formats import counted, scientific, script_json, skill_text
from malus.reports.tables.rows import overall_rows
from malus.reports.viewer.examples import Example
from malus.reports.viewer.pack import Packer, fitted

_TABLES = {"diverging": "RdBu_r", "sequential": "cividis", "cyclic": "twilight"}
_PANELS = (
    ("truth", "Truth, I(ϑ)", "grey"),
    ("estimate", "Reconstruction, I(ϑ)", "grey"),
    ("difference", "Difference, reconstruction − truth", "diverging"),
    ("dolp-truth", "DoLP, truth", "sequential"),
    ("dolp-estimate", "DoLP, reconstruction", "sequential"),
    ("aolp-truth", "AoLP, truth", "cyclic"),
    ("aolp-estimate", "AoLP, reconstruction", "cyclic"),
)
_NUMBERS = ("I(ϑ)", "I_max", "I_min", "ψ", "DoLP", "AoLP")
_HELP = (
    "Arrow keys turn the polariser by 1°, Page Up and Down by 10°, the space bar plays."
    " Shift and arrow keys move the pixel that is read out; + and − zoom, 0 shows everything."
    " Drag to pan, pinch or turn the wheel to zoom, click to hold a pixel."
)


def viewer(examples: tuple[Example, ...], table: pd.DataFrame) -> Markup:
    """The viewer with its data; `examples` holds at least one scene with a method."""
    shown, left_out = fitted([example for example in examples if example.methods])
    packer = Packer()
    scenes = [packer.scene(example, {"scores": _scores(table, example)}) for example in shown]
    data = {"tables": _tables(), "scenes": scenes}
    note = f"{counted(left_out, 'further scene')} of the run would have made the page too large."
    blocks = (
        tag("script", Markup(text), type="text/plain", id=f"block-{number}")
        for number, text in enumerate(packer.blocks)
    )
    return join(
        tag("div", _controls(), _panels(), id="viewer"),
        tag("p", _HELP, class_="note"),
        tag("p", note, class_="note") if left_out else Markup(""),
        tag("script", Markup(script_json(data)), type="application/json", id="viewer-data"),
        *blocks,
    )


def _scores(table: pd.DataFrame, example: Example) -> dict[str, dict[str, str]]:
    rows = table[table["scene"] == example.scene]
    skills = overall_rows(rows, "skill").set_index("method")["value"].to_dict()
    errors = overall_rows(rows, "nmse").set_index("method")["value"].to_dict()
    return {
        str(method): {"nmse": scientific(error), "skill": skill_text(skills.get(method, np.nan))}
        for method, error in errors.items()
    }


def _tables() -> dict[str, str]:
    """256 RGB colours of every colour map, as base64."""
    from matplotlib import colormaps

    places = np.linspace(0.0, 1.0, 256)
    found = {}
    for name, source in _TABLES.items():
        colours = np.rint(255 * colormaps[source](places)[:, :3]).astype(np.uint8)
        found[name] = base64.b64encode(colours.tobytes()).decode("ascii")
    return found


def _controls() -> Markup:
    slider = tag(
        "input", type="range", id="angle", min="0", max="180", step="0.1", value="0",
        aria_valuetext="0° anticlockwise from the vertical",
    )  # fmt: skip
    exposure = tag("input", type="range", id="exposure", min="-3", max="6", step="0.25", value="0")
    turn = (
        tag(
            "label", "Polariser ", tag("output", "0°", id="angle-text", for_="angle"), for_="angle"
        ),
        slider,
        _DIAL,
        tag("button", "▶ Play", id="play", type="button", aria_pressed="false"),
    )
    zoom = [
        tag("button", text, id=f"zoom-{name}", type="button", aria_label=label)
        for name, text, label in (
            ("out", "−", "zoom out"), ("reset", "1:1", "show everything"), ("in", "+", "zoom in"),
        )
    ]  # fmt: skip
    return tag(
        "div",
        *(_choice(name) for name in ("scene", "method", "band")),
        tag("div", *turn, class_="turn"),
        tag("div", tag("label", "Exposure", for_="exposure"), exposure, class_="exposure"),
        tag("div", *zoom, class_="zoom", role="group", aria_label="Zoom"),
        tag("p", id="score", aria_live="polite"),
        class_="controls",
    )


def _choice(name: str) -> Markup:
    return tag(
        "div", tag("label", name.capitalize(), for_=name), tag("select", id=name),
        class_=f"choice {name}",
    )  # fmt: skip


_DIAL = Markup(
    '<svg class="dial" viewBox="-12 -12 24 24" role="img" aria-label="the polariser\'s axis">'
    '<circle r="10.5"/><g id="axis"><path d="M0-10.5V10.5"/></g></svg>'
)


def _panels() -> Markup:
    figures = [_panel(*panel) for panel in _PANELS]
    return tag("div", *figures[:3], _readout(), *figures[3:], class_="panels")


def _panel(name: str, title: str, colours: str) -> Markup:
    canvas = tag("canvas", role="img", tabindex="0", aria_label=title)
    caption = tag("figcaption", title, " ", _method(name))
    return tag("figure", caption, canvas, _legend(name, colours), data_panel=name)


def _method(name: str) -> Markup:
    shows = name.endswith("estimate")
    return tag("span", class_="method-name") if shows else Markup("")


def _legend(name: str, colours: str) -> Markup:
    if colours == "cyclic":
        wheel = tag("canvas", class_="wheel", width="96", height="96", aria_hidden="true")
        words = "direction of the light's vibration; grey: DoLP below 0.5 %"
        return tag("div", wheel, tag("span", words), class_="legend")
    ends = {
        "grey": (Markup("0"), tag("span", class_="white")),
        "diverging": (tag("span", id="diff-least"), tag("span", id="diff-most")),
        "sequential": (Markup("0 %"), tag("span", class_="dolp-most")),
    }[colours]
    bar = tag("canvas", class_="bar", data_table=colours, aria_hidden="true")
    return tag("div", ends[0], bar, ends[1], class_="legend")


def _readout() -> Markup:
    heads = tag(
        "tr", tag("td", ""), tag("th", "truth", scope="col"), tag("th", "estimate", scope="col")
    )
    lines = [
        tag("tr", tag("th", name, scope="row"), tag("td", "–"), tag("td", "–")) for name in _NUMBERS
    ]
    return tag(
        "section",
        tag("p", "", class_="place", aria_live="polite"),
        _PLOT,
        tag("table", tag("thead", heads), tag("tbody", *lines)),
        id="readout",
        aria_label="Pixel read-out",
    )


def _ticks() -> str:
    return "".join(
        f'<text x="{50 + 1.35 * angle}" y="123" text-anchor="middle">{angle}°</text>'
        for angle in (0, 45, 90, 135, 180)
    )


_PLOT = Markup(
    '<svg viewBox="0 0 310 130" role="img" aria-label="radiance over the polariser angle, truth and'
    ' estimate"><path class="axes" d="M50 6V110H294"/>'
    '<text class="least" x="46" y="111" text-anchor="end"></text>'
    '<text class="most" x="46" y="15" text-anchor="end"></text>'
    f"{_ticks()}"
    '<line class="now" y1="6" y2="110"/><path class="truth"/><path class="estimate"/>'
    '<circle class="dot-truth" r="3.4"/><circle class="dot-estimate" r="3.4"/></svg>'
)


def place_of_scenes(examples: tuple[Example, ...], table: pd.DataFrame) -> dict[Any, str]:
    """For every (light, surface, body) of the viewer's scenes, one of them."""
    ids = {example.scene for example in fitted([e for e in examples if e.methods])[0]}
    rows = table[table["scene"].isin(ids)].drop_duplicates("scene")
    columns = zip(rows["light"], rows["surface"], rows["body"], rows["scene"], strict=True)
    return {(light, surface, body): scene for light, surface, body, scene in columns}
