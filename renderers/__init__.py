"""Scenes to truths. The only folder that imports Mitsuba, and only when something is rendered."""

from malus.renderers.rendering import render
from malus.renderers.truth import Truth

__all__ = ["Truth", "render"]
