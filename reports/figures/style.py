"""The style of every figure: colours that colour-blind eyes tell apart, sizes for print.

Imported only where a figure is made, because Matplotlib takes its time.
"""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font

from malus.reports.tables.rows import TRIVIAL
from malus.scenes.core.errors import printable

INK = "#23232b"
SOFT = "#8a8a94"
GRID = "#dcdce2"
BAND = "#f0e3b8"
DPI = 200
_SVG_DPI = 72
"""Units of an SVG to an inch."""

# Okabe and Ito's palette, less its yellow (invisible on white) and with its black kept for text.
PALETTE = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
_MARKERS = ("o", "s", "^", "D", "v", "P")
_FIRST_METHODS = ("eq8", "visible", "half_vector", "shadowed")
_BODY = "+body"

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

RC: Any = {
    "font.family": ["DejaVu Sans"],
    "font.size": 8.5,
    "axes.labelsize": 9,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "lines.markersize": 4.2,
    "svg.fonttype": "none",
    "svg.hashsalt": "malus",
    "text.parse_math": False,  # a dollar sign in a name is a dollar sign
    "legend.title_fontsize": 7,
    "figure.constrained_layout.h_pad": 0.06,
}


@dataclass(frozen=True)
class MethodStyle:
    """Colour, marker and line of a method."""

    colour: str
    marker: str
    line: str
    filled: bool

    @property
    def face(self) -> str:
        """Colour inside the marker."""
        return self.colour if self.filled else "white"


def method_styles(methods: Sequence[str]) -> dict[str, MethodStyle]:
    """Colour, marker and line of every method; the same in every figure of a suite.

    A method that includes the body's polarisation is drawn like the one that does not, but hollow.

    Examples
    --------
    >>> method_styles(["eq8"])["eq8"].colour
    '#d55e00'
    """
    named = dict.fromkeys(method.removesuffix(_BODY) for method in methods if method != TRIVIAL)
    families = list(_FIRST_METHODS)
    for family in named:
        if family in families:
            continue
        absent = [name for name in families if name not in named]
        if len(families) < len(PALETTE) or not absent:
            families.append(family)
        else:  # of a method that is not drawn: two of one colour are told apart less well
            families[families.index(absent[0])] = family
    return {method: _method_style(method, families) for method in methods}


def _method_style(method: str, families: Sequence[str]) -> MethodStyle:
    if method == TRIVIAL:
        return MethodStyle(SOFT, "x", "--", True)
    number = families.index(method.removesuffix(_BODY))
    body = method.endswith(_BODY)
    repetition, kind = divmod(number, len(PALETTE))
    marker = _MARKERS[(kind + repetition) % len(_MARKERS)]
    return MethodStyle(PALETTE[kind], marker, ":" if body else "-", not body)


@contextmanager
def style() -> Iterator[None]:
    """Settings for everything drawn inside the `with` block, whoever changed them before.

    So has a `matplotlibrc` of the user's: LaTeX, sizes and colours of other figures.
    Matplotlib names the parts of an SVG by how NumPy prints numbers, and colour-science changes
    that for the thread that imports it.
    """
    with mpl.rc_context(), np.printoptions(legacy=False):
        mpl.rcdefaults()
        mpl.rcParams.update(RC)
        yield


def drawable(name: str) -> str:
    r"""A name with the characters that the font lacks replaced by \ufffd.

    Examples
    --------
    >>> drawable("η \U00013000")
    'η \ufffd'
    """
    drawn = _characters()
    return "".join(c if ord(c) in drawn else "\ufffd" for c in printable(name))


@cache
def _characters() -> frozenset[int]:
    font = get_font(findfont(FontProperties(family=RC["font.family"])))
    return frozenset(font.get_charmap())


def power_of_ten(value: float, _tick: int | None = None) -> str:
    """A tick label of a logarithmic axis, in plain characters: text in an SVG stays text.

    Examples
    --------
    >>> power_of_ten(0.001)
    '10⁻³'
    """
    exponent = round(math.log10(value))
    return "10" + str(exponent).translate(_SUPERSCRIPTS)


def svg(figure: Figure) -> str:
    """A figure as SVG text, in which letters stay text; equal figures give equal bytes.

    The figure keeps this layout: a PNG of it made afterwards is not laid out again.
    """
    buffer = io.StringIO()
    with style():
        _lay_out(figure)
        metadata = {"Date": None, "Creator": "malus"}
        figure.savefig(buffer, format="svg", metadata=metadata)
    return re.sub(r"[ \t]+\n", "\n", buffer.getvalue())


def _lay_out(figure: Figure) -> None:
    """Lay a figure out for SVG, once: while it has an engine, Matplotlib draws it one time more."""
    engine = figure.get_layout_engine()
    if engine is not None:
        FigureCanvasSVG(figure)  # whose letters have the sizes of the file
        figure.set_dpi(_SVG_DPI)
        with warnings.catch_warnings():
            # A figure without room for its panels is drawn all the same: users cannot mend it.
            warnings.filterwarnings("ignore", "constrained_layout not applied", UserWarning)
            engine.execute(figure)
        figure.set_layout_engine(None)


def png(figure: Figure) -> bytes:
    """A figure as PNG, 200 dots an inch."""
    buffer = io.BytesIO()
    with style():
        figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": "malus"})
    return buffer.getvalue()
