"""Methods that estimate polarisation components from one unpolarised image; none sees a truth.

Names whose modules take long to import are imported when they are first used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from malus.reconstruct.methods import Method, get_method, methods
from malus.reconstruct.observation import Components, Inapplicable, Observation

if TYPE_CHECKING:
    from malus.reconstruct.facets.ratio import polarisation_ratio, specular_dolp
    from malus.reconstruct.single_image.blind import ChainResult, blind, run_chain
    from malus.reconstruct.single_image.illuminant import (
        Illuminant,
        estimate_illuminant,
        illuminants,
    )
    from malus.reconstruct.single_image.light_direction import estimate_direction
    from malus.reconstruct.single_image.paper import paper, run_paper
    from malus.reconstruct.single_image.parameters import SurfaceParameters, fit_parameters
    from malus.reconstruct.single_image.separation import Separation, separate, separations
    from malus.reconstruct.single_image.shape import (
        GivenParameters,
        RecoveredShape,
        recover_shape,
    )

__all__ = [
    "ChainResult",
    "Components",
    "GivenParameters",
    "Illuminant",
    "Inapplicable",
    "Method",
    "Observation",
    "RecoveredShape",
    "Separation",
    "SurfaceParameters",
    "blind",
    "estimate_direction",
    "estimate_illuminant",
    "fit_parameters",
    "get_method",
    "illuminants",
    "methods",
    "paper",
    "polarisation_ratio",
    "recover_shape",
    "run_chain",
    "run_paper",
    "separate",
    "separations",
    "specular_dolp",
]

_MODULES = {
    "ChainResult": "single_image.blind",
    "GivenParameters": "single_image.shape",
    "Illuminant": "single_image.illuminant",
    "RecoveredShape": "single_image.shape",
    "Separation": "single_image.separation",
    "SurfaceParameters": "single_image.parameters",
    "blind": "single_image.blind",
    "estimate_direction": "single_image.light_direction",
    "estimate_illuminant": "single_image.illuminant",
    "fit_parameters": "single_image.parameters",
    "illuminants": "single_image.illuminant",
    "paper": "single_image.paper",
    "polarisation_ratio": "facets.ratio",
    "recover_shape": "single_image.shape",
    "run_chain": "single_image.blind",
    "run_paper": "single_image.paper",
    "separate": "single_image.separation",
    "separations": "single_image.separation",
    "specular_dolp": "facets.ratio",
}
"""Module of each name that is imported when it is first used."""


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Public names, those not imported yet among them."""
    return sorted({*globals(), *__all__})
