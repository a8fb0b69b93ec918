"""The package colour-science, imported where colours are computed: that takes a second."""

from __future__ import annotations

from types import ModuleType

import numpy as np


def colour_science() -> ModuleType:
    """The module `colour`; importing it leaves how NumPy prints numbers as it was.

    It asks NumPy for the format of version 1.13, which has 12 digits. Tables that are written as
    text would have no more, and neither would what the user prints.

    Examples
    --------
    >>> float(colour_science().delta_E([0, 0, 0], [3, 4, 0], method="CIE 1976"))
    5.0
    """
    with np.printoptions():
        import colour
    return colour
