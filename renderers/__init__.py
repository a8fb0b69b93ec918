"""Render scenes to truths, and store truths as datasets.

The only package that imports Mitsuba, and only when something is rendered. Datasets are imported
when their names are first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from malus.renderers.rendering import render
from malus.renderers.truth import Truth

if TYPE_CHECKING:
    from malus.renderers.datasets.dataset import Dataset
    from malus.renderers.datasets.opened import open_dataset

__all__ = ["Dataset", "Truth", "open_dataset", "render"]

_MODULES = {"Dataset": "datasets.dataset", "open_dataset": "datasets.opened"}
"""Module of each name that is imported when it is first used."""


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value
