"""Error maps: the colour difference of every pixel, scaled as in the paper's Figures 6 to 8."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image

from malus.reports.tables import sentences
from malus.reports.templates.render import render
from malus.reports.viewer.examples import Example
from malus.scenes import polarisation
from malus.scenes.colour import JUST_NOTICEABLE, differences_from, weighted_colours
from malus.scenes.core.arrays import AnyArray, BoolArray, Float64Array
from malus.scenes.core.colour_science import colour_science
from malus.scenes.core.errors import InputError, counted

WHITE = 10.0 * JUST_NOTICEABLE
"""ΔE76 that is shown white: 10 just noticeable differences, as in the paper."""

SIDE = 96
"""Pixels of a map's longer side at most; of a larger image every k-th pixel is shown."""

PHOTOGRAPH_SIDE = 128
"""The same for captures, which are shown beside their maps."""

BUDGET = 3_000_000
"""Characters of maps in a page."""

ByteArray: TypeAlias = NDArray[np.uint8]

_WHITE_QUANTILE = 0.995
"""Share of the object's pixels that are darker than the white of its photographs."""

_NAMES = {"_i_max": "I_max", "_i_min": "I_min"}


@dataclass(frozen=True)
class ErrorMap:
    """ΔE76 (height, width) of one image by a method, NaN off the object.

    So many pixels of the object are `not_finite`.
    """

    method: str
    image: str
    difference: Float64Array
    not_finite: int = 0

    @property
    def spread(self) -> str:
        """Mean ± standard deviation over the object's finite pixels, and how many others it has."""
        finite = self.difference[np.isfinite(self.difference)]
        if not finite.size:
            return "not finite"
        others = f", {counted(self.not_finite, 'pixel')} not finite" if self.not_finite else ""
        return f"{finite.mean():.2f} ± {finite.std():.2f}{others}"


def error_maps(example: Example) -> Iterator[ErrorMap]:
    """Error maps of I_max, I_min and every I(ϑ) of every method.

    Raises
    ------
    InputError
        If no band is visible.
    """
    true = example.truth[example.mask].astype(np.float64)
    peak = float(true[..., 0].max(initial=0.0)) or 1.0
    colours = weighted_colours(true / peak, example.colour_weights)
    for method, stokes in example.methods.items():
        estimated = stokes[example.mask].astype(np.float64) / peak
        for suffix, angle, values in differences_from(colours, estimated):
            difference = np.full(example.mask.shape, np.nan)
            difference[example.mask] = values
            name = _NAMES[suffix] if angle is None else f"I({angle:g}°)"
            yield ErrorMap(method, name, difference, int((~np.isfinite(values)).sum()))


def grey(difference: AnyArray, mask: BoolArray) -> ByteArray:
    """Grey and opacity (height, width, 2): black no error, white `WHITE` and above or not finite.

    Examples
    --------
    >>> grey(np.array([[0.0, 11.5, 99.0, np.nan]]), np.ones((1, 4), bool))[..., 0].tolist()
    [[0, 128, 255, 255]]
    """
    part = np.where(np.isfinite(difference), difference, WHITE) / WHITE
    level = np.rint(255 * np.clip(part, 0.0, 1.0)).astype(np.uint8)
    return np.stack([np.where(mask, level, 0), np.where(mask, 255, 0)], -1).astype(np.uint8)


def png_url(pixels: ByteArray) -> str:
    """Grey and opacity (height, width, 2) as the data URL of a PNG."""
    buffer = io.BytesIO()
    # A tenth of the size more, at half the time of the default.
    Image.fromarray(pixels, "LA").save(buffer, "PNG", compress_level=4)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def gallery(examples: Sequence[Example], budget: int = BUDGET) -> Markup | None:
    """HTML of the error maps of the examples that fit the budget; None without any."""
    tables: list[tuple[str, Markup]] = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for example, table in zip(examples, pool.map(_table_or_none, examples), strict=True):
            if table is None:
                continue
            budget -= len(table)
            if budget < 0:
                pool.shutdown(wait=False, cancel_futures=True)
                break
            tables.append((example.label, table))
    if not tables:
        return None
    left_out = len(examples) - len(tables)
    return render(
        "error_maps.html",
        explanation=sentences.ERROR_MAPS,
        white=f"{WHITE:g}",
        tables=tables,
        more=counted(len(tables) - 1, "more scene"),
        left_out=counted(left_out, "further scene") if left_out else "",
    )


def _table_or_none(example: Example) -> Markup | None:
    """The maps of one example; None where no band is visible, so that there is no colour."""
    try:
        return _table(example)
    except InputError:
        return None


@np.errstate(invalid="ignore")  # pixels that are not finite are counted
def _table(example: Example) -> Markup:
    step = -(-max(example.mask.shape) // (PHOTOGRAPH_SIDE if example.channels else SIDE))
    mask = example.mask[::step, ::step]
    rows: dict[str, list[dict[str, str]]] = {}
    if example.channels:
        rows = {name: list(cells) for name, cells in _photographs(example, step)}
    heading = "{}, ΔE76" if example.channels else "{}"
    for error in error_maps(example):
        src = Markup(png_url(grey(error.difference[::step, ::step], mask)))
        alt = f"error map of {error.image} by {error.method}"
        cell = {"image": error.image, "src": src, "text": error.spread, "alt": alt}
        rows.setdefault(heading.format(error.method), []).append(cell)
    images = dict.fromkeys(cell["image"] for cells in rows.values() for cell in cells)
    height, width = mask.shape
    return render(
        "error_map_table.html",
        label=example.label,
        images=list(images),
        rows=dict(sorted(rows.items(), key=lambda row: _place(row[0], example))),
        width=width,
        height=height,
    )


def _place(heading: str, example: Example) -> int:
    """Place of a row: what was captured, then every method's pictures above its maps."""
    names = ["captured", *example.methods]
    return next(k for k, name in enumerate(names) if heading in (name, f"{name}, ΔE76"))


def _photographs(example: Example, step: int) -> Iterator[tuple[str, Iterator[dict[str, str]]]]:
    """Pictures through the polariser, captured and by every method, as the paper shows them."""
    lit = example.truth[..., 0][example.mask]
    white = float(np.quantile(lit, _WHITE_QUANTILE)) / 2 or 1.0
    for name, stokes in {"captured": example.truth, **example.methods}.items():
        yield name, _pictures(name, stokes[::step, ::step] / white)


def _pictures(name: str, stokes: AnyArray) -> Iterator[dict[str, str]]:
    """Cells of a row: I_max, I_min and every I(ϑ)."""
    i_max, i_min = polarisation.extremes(stokes)
    images = {"I_max": i_max, "I_min": i_min}
    for angle in polarisation.PAPER_ANGLES_DEG:
        images[f"I({angle:g}°)"] = polarisation.polarised(stokes, angle)
    for image, light in images.items():
        alt = f"{image}, {name}"
        yield {"image": image, "src": Markup(_jpeg_url(light)), "text": "", "alt": alt}


def _jpeg_url(light: AnyArray) -> str:
    """Linear light (height, width, 1 or 3), 1 is white, as the data URL of a JPEG.

    What is not finite is magenta, as in the viewer.
    """
    finite = np.isfinite(light)
    shown = np.where(finite, np.clip(light, 0.0, 1.0), 0.0)
    encoded = colour_science().cctf_encoding(shown, "sRGB")
    codes = np.rint(255 * np.broadcast_to(encoded, (*light.shape[:2], 3))).astype(np.uint8)
    codes[~finite.all(axis=-1)] = (255, 0, 255)
    buffer = io.BytesIO()
    Image.fromarray(codes).save(buffer, "JPEG", quality=85)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
