"""Render scenes to truths, and store truths as datasets.

The only package that imports Mitsuba, and only when something is rendered.
"""

from malus.renderers.rendering import render
from malus.renderers.truth import Truth

__all__ = ["Truth", "render"]
