"""Shapes of objects, their meshes, and the patterns on them."""
