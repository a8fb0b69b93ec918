"""Scenes as Mitsuba objects, and the kernels that render both lobes."""
