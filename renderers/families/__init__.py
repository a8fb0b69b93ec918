"""Families: one render for all scenes that differ in refractive index only."""
