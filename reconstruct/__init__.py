"""An unpolarised image to its polarisation components. Never sees a truth."""

from malus.reconstruct.facets.ratio import polarisation_ratio, specular_dolp
from malus.reconstruct.methods import Method, get_method, methods
from malus.reconstruct.observation import Components, Inapplicable, Observation

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
