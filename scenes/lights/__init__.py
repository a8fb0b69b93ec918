"""Lights, radiance maps and the sky."""
