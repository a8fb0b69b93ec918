"""Render scenes to truths, and store truths as datasets.

The only package that imports Mitsuba, and only when something is rendered. `__init__.pyi` lists the
names; they are imported when they are first used.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
