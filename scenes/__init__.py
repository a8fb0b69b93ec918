"""Scenes as frozen data, suites of them, and the conventions of polarisation.

Imports no package beside it.
"""

from malus.scenes.camera import Camera, Views
from malus.scenes.core.errors import InputError
from malus.scenes.lights.lights import (
    Area,
    Distant,
    Environment,
    Interior,
    Light,
    Polariser,
    Sky,
    SkyPolarisation,
    Uniform,
)
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.surface import Conductor, Dielectric, Patterned
from malus.scenes.scene import Sampling, Scene
from malus.scenes.shapes.patterns import Checker, ImageTexture, Noise, Spots, Stripes
from malus.scenes.shapes.shapes import (
    Blob,
    Crease,
    Lathe,
    MeshFile,
    Plane,
    Shape,
    Sphere,
    Superquadric,
    Torus,
)
from malus.scenes.suite import Suite, load_suite, suite_names
from malus.scenes.surroundings import Placed, Surroundings

__all__ = [
    "Area",
    "Blob",
    "Camera",
    "Checker",
    "Conductor",
    "Crease",
    "Dielectric",
    "Distant",
    "Environment",
    "ImageTexture",
    "InputError",
    "Interior",
    "Lathe",
    "Light",
    "Measured",
    "MeshFile",
    "Noise",
    "Patterned",
    "Placed",
    "Plane",
    "Polariser",
    "Sampling",
    "Scene",
    "Shape",
    "Sky",
    "SkyPolarisation",
    "Sphere",
    "Spots",
    "Stripes",
    "Suite",
    "Superquadric",
    "Surroundings",
    "Torus",
    "Uniform",
    "Views",
    "load_suite",
    "suite_names",
]
