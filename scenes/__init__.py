"""What to look at: plain frozen data and the conventions. Imports no folder beside it."""

from malus.scenes.errors import InputError
from malus.scenes.scene import (
    Blob,
    Camera,
    Dielectric,
    Distant,
    MeshFile,
    Sampling,
    Scene,
    Sphere,
    Superquadric,
    Torus,
    Uniform,
)
from malus.scenes.suite import Suite, load_suite, suite_names

__all__ = [
    "Blob",
    "Camera",
    "Dielectric",
    "Distant",
    "InputError",
    "MeshFile",
    "Sampling",
    "Scene",
    "Sphere",
    "Suite",
    "Superquadric",
    "Torus",
    "Uniform",
    "load_suite",
    "suite_names",
]
