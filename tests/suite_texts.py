"""Suites as text, for tests that change a word of them."""

GOOD = """
name = "mine"
shapes = [{ kind = "sphere" }]
materials = ["water"]
surfaces = ["carbon"]
lights = [{ kind = "uniform" }]
wavelengths_nm = [500, 600]
methods = ["eq8"]
# more
"""
BRUSHED = GOOD.replace('"water"', '"gold"').replace('"carbon"', "{ alpha = [0.1, 0.4] }")
"""A metal with two roughnesses."""
