"""A small random suite that tests change."""

from __future__ import annotations

from typing import Any

from malus.scenes import Suite
from malus.scenes.scene import Scene

BASE: dict[str, Any] = {
    "name": "drawn",
    "wavelengths_nm": [550],
    "methods": ["unpolarised"],
    "camera": {"resolution": 8},
}
AXES: dict[str, Any] = {
    "count": 400,
    "seed": 3,
    "shapes": [
        {"kind": "blob", "seed": {"integers": [0, 99]}},
        {"kind": "superquadric", "e1": {"uniform": [0.2, 1.8]}, "e2": 1},
        {"kind": "sphere"},
    ],
    "materials": ["pmma", "water", "polystyrene", {"eta": {"uniform": [1.3, 1.8]}, "weight": 2}],
    "surfaces": [{"alpha": {"log_uniform": [0.02, 0.5]}, "albedo": {"uniform": [0.1, 0.9]}}],
    "bodies": ["polarised", "unpolarised"],
    "lights": [
        {"kind": "distant", "incidence_deg": {"uniform": [10, 90]}, "weight": 3},
        {"kind": "uniform"},
    ],
    "cameras": [{"roll_deg": {"uniform": [-30, 30]}}],
}
SPLITS = {"train": 0.8, "val": 0.1, "test": 0.1, "disjoint": ["shape", "material", "light"]}


def suite(splits: dict[str, Any] | None = None, **axes: Any) -> Suite:
    parts = {"random": AXES | axes} | ({"splits": splits} if splits else {})
    return Suite.parse(BASE | parts, "test")


def drawn(of: Suite) -> list[Scene]:
    return list(of.scenes())
