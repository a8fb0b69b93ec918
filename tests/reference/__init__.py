"""Slow, literal references, written from physics.md and sharing no code with malus."""
