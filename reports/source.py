"""What the page is made from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from malus.reports.figures.drawings import Drawing
from malus.reports.viewer.examples import Example, read_examples


@dataclass(frozen=True)
class Source:
    """The results, the folder in which other files of the run may lie, and the figures made.

    `ladders` are the figures of the error budget, `beside` folders of
    studies whose sections the page shows too.
    """

    table: pd.DataFrame
    run: dict[str, Any]
    folder: Path
    drawings: tuple[Drawing, ...]
    ladders: tuple[Drawing, ...] = ()
    beside: tuple[Path, ...] = ()

    @cached_property
    def examples(self) -> tuple[Example, ...]:
        """Scenes whose images the run kept, in the order of the suite."""
        order = {scene: place for place, scene in enumerate(self.table["scene"].unique())}
        found = read_examples(self.folder / "examples")
        return tuple(sorted(found, key=lambda example: order.get(example.scene, len(order))))
