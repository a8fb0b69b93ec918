"""What all families of a run came to."""

from __future__ import annotations

from dataclasses import dataclass, field

import pandas as pd

from malus.bench.running.parts import Failure
from malus.bench.running.plan import FamilyPlan


@dataclass
class Collected:
    """What the record of a run tells of its families, gathered while their tables go by.

    Attributes
    ----------
    families : list of FamilyPlan
        Those with a table: done at any time.
    samples : list of int
        Samples a pixel of each.
    """

    families: list[FamilyPlan] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    samples: list[int] = field(default_factory=list)
    scenes: int = 0
    interpolation_rms: float = 0.0
    render_seconds: float = 0.0

    def add(self, family: FamilyPlan, table: pd.DataFrame) -> None:
        """Count a family's table."""
        self.families.append(family)
        self.samples.append(table.attrs["samples"])
        self.scenes += table.scene.nunique()
        self.interpolation_rms = max(self.interpolation_rms, table.attrs["interpolation_rms"])
        self.render_seconds += table.attrs["render_seconds"]
