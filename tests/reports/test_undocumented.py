"""Matplotlib without the lists of properties in its documentation, as commands import it."""

from __future__ import annotations

import subprocess
import sys

from malus.bench.running.inside_worker import DRAWING

DRAW = """
import hashlib, importlib, sys
for name in sys.argv[1:]:
    importlib.import_module(name)
from malus.reports.figures.drawings import drawings, picture
from malus.reports.tables.sample import table
from matplotlib.lines import Line2D
figures = "".join(picture(drawing.draw).svg for drawing in drawings(table()))
print("markersize" in Line2D.set.__doc__, hashlib.sha256(figures.encode()).hexdigest())
"""


def drawn_after(*modules: str) -> list[str]:
    """Whether a line's documentation lists its properties, and a digest of figures."""
    command = [sys.executable, "-c", DRAW, *modules]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()


def test_figures_are_the_same_and_only_commands_lack_the_lists() -> None:
    without, figures = drawn_after(*DRAWING)
    listed, same_figures = drawn_after("malus.reports.figures.figure5")
    assert (without, listed) == ("False", "True")
    assert figures == same_figures
