"""Error maps: the colour difference of every pixel, scaled as in the paper's Figures 6 to 8."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from malus.reports.html import Markup, folded, join, scrolling, tag
from malus.reports.tables.formats import counted
from malus.reports.viewer.examples import Example
from malus.scenes.colour import JUST_NOTICEABLE, delta_e_maps
from malus.scenes.core.errors import InputError

WHITE = 10.0 * JUST_NOTICEABLE
"""ΔE76 that is shown white: 10 just noticeable differences, as in the paper."""

SIDE = 96
"""Pixels of a map's longer side at most; of a larger image every k-th pixel is shown."""

BUDGET = 3_000_000
"""Characters of maps in a page."""

_NAMES = {"_i_max": "I_max", "_i_min": "I_min"}


@dataclass(frozen=True)
class ErrorMap:
    """ΔE76 of one image of a method: what it is of, and (height, width), NaN off the object."""

    method: str
    image: str
    difference: NDArray[np.float64]

    @property
    def spread(self) -> str:
        """Mean ± standard deviation over the object's finite pixels."""
        found = self.difference[np.isfinite(self.difference)]
        return f"{found.mean():.2f} ± {found.std():.2f}" if found.size else "not finite"


def error_maps(example: Example) -> Iterator[ErrorMap]:
    """I_max, I_min and every I(ϑ) of every method, as `colour_error` compares them.

    Raises
    ------
    InputError
        If no band is visible.
    """
    true = example.truth[example.mask].astype(np.float64)
    peak = float(true[..., 0].max(initial=0.0)) or 1.0
    for method, stokes in example.methods.items():
        estimated = stokes[example.mask].astype(np.float64) / peak
        found = delta_e_maps(estimated, true / peak, example.wavelengths_nm)
        for suffix, angle, values in found:
            difference = np.full(example.mask.shape, np.nan)
            difference[example.mask] = values
            name = _NAMES[suffix] if angle is None else f"I({angle:g}°)"
            yield ErrorMap(method, name, difference)


def grey(difference: NDArray[Any], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Grey and opacity (height, width, 2): black no error, white `WHITE` and above or not finite.

    Examples
    --------
    >>> grey(np.array([[0.0, 11.5, 99.0, np.nan]]), np.ones((1, 4), bool))[..., 0].tolist()
    [[0, 128, 255, 255]]
    """
    part = np.where(np.isfinite(difference), difference, WHITE) / WHITE
    level = np.rint(255 * np.clip(part, 0.0, 1.0)).astype(np.uint8)
    return np.stack([np.where(mask, level, 0), np.where(mask, 255, 0)], -1).astype(np.uint8)


def png_address(pixels: NDArray[np.uint8]) -> str:
    """A picture of grey and opacity as an address that holds it."""
    buffer = io.BytesIO()
    Image.fromarray(pixels, "LA").save(buffer, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def gallery(examples: Sequence[Example], budget: int = BUDGET) -> Markup | None:
    """Every example's maps, one line a method, as far as the budget goes; None without any."""
    parts: list[Markup] = []
    for example in examples:
        try:
            made = _table(example)
        except InputError:  # no band is visible: there is no colour
            continue
        budget -= len(made)
        if budget < 0:
            break
        parts.append(folded(example.label, made, open=not parts, class_="error-maps"))
    if not parts:
        return None
    first, *others = parts
    more = folded(counted(len(others), "more scene"), *others) if others else ""
    left_out = len(examples) - len(parts)
    note = f"{counted(left_out, 'further scene')} would have made the page too large."
    return join(first, more, tag("p", note, class_="note") if left_out else "")


def _table(example: Example) -> Markup:
    found = list(error_maps(example))
    images = list(dict.fromkeys(one.image for one in found))
    step = -(-max(example.mask.shape) // SIDE)
    mask = example.mask[::step, ::step]
    heads = tag("tr", tag("td"), *(tag("th", image, scope="col") for image in images))
    lines = [
        tag(
            "tr",
            tag("th", method, scope="row"),
            *(_cell(one, mask, step) for one in found if one.method == method),
        )
        for method in example.methods
    ]
    caption = f"ΔE76 of {example.label}: mean ± standard deviation over the pixels"
    whole = tag("table", tag("caption", caption), tag("thead", heads), tag("tbody", *lines))
    return scrolling(whole, caption)


def _cell(one: ErrorMap, mask: NDArray[np.bool_], step: int) -> Markup:
    picture = tag(
        "img",
        src=png_address(grey(one.difference[::step, ::step], mask)),
        alt=f"error map of {one.image} by {one.method}",
        width=str(mask.shape[1]),
        height=str(mask.shape[0]),
    )
    return tag("td", picture, tag("span", one.spread))
