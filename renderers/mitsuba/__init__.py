"""Scenes as Mitsuba objects, and the kernels that render specular and diffuse light."""
