"""Numbers of Mitsuba objects that scenes have in common, so that they share kernels.

Dr.Jit numbers all BSDFs and all shapes of a process, and a kernel that calls them holds tables as
long as their numbers. Objects of no scene fill these up to multiples: kernels of scenes with the
same kinds of objects, lights and surfaces are then the same, and are compiled once for all. What a
ray meets, and so every truth, stays the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

from malus.renderers.mitsuba.placed import SurfaceBSDF
from malus.scenes.materials.surface import Dielectric

BSDFS, SHAPES = 12, 4
"""Numbers that those of a scene's BSDFs and shapes are made multiples of."""


def padding(mi: ModuleType, bsdfs: Sequence[Sequence[SurfaceBSDF]]) -> list[Any]:
    """Objects that make the numbers of a scene multiples; they are to live as long as it does.

    `bsdfs` are those of the surfaces of each object, which several surfaces blend.
    """
    bsdf = {"bsdf": _spare_bsdf(mi)}
    shapes = [mi.load_dict({"type": "rectangle"} | bsdf) for _ in range(-len(bsdfs) % SHAPES)]
    count = 1 + sum(len(own) - 1 + sum(part.count for part in own) for own in bsdfs)
    return [*shapes, bsdf, *(_spare_bsdf(mi) for _ in range(-count % BSDFS))]


def _spare_bsdf(mi: ModuleType) -> Any:
    """A BSDF like those of dielectrics, whose values are data as theirs are."""
    spare = SurfaceBSDF(mi, Dielectric(eta=1.5, alpha=0.3))
    spare.set_band(1.5, 0.5)
    return spare.bsdf
