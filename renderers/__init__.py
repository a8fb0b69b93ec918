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
    from malus.renderers.datasets.dataset import Dataset, open_dataset

__all__ = ["Dataset", "Truth", "open_dataset", "render"]

_DATASET_NAMES = {"Dataset", "open_dataset"}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _DATASET_NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.datasets.dataset"), name)
    globals()[name] = value
    return value
