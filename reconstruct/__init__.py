"""An unpolarised image to its polarisation components. Never sees a truth."""

from malus.reconstruct.methods import Method, get_method, methods
from malus.reconstruct.observation import Components, Inapplicable, Observation
from malus.reconstruct.ratio import polarisation_ratio, specular_dolp

__all__ = [
    "Components",
    "Inapplicable",
    "Method",
    "Observation",
    "get_method",
    "methods",
    "polarisation_ratio",
    "specular_dolp",
]
