from .facets.ratio import polarisation_ratio as polarisation_ratio, specular_dolp as specular_dolp
from .methods import Method as Method, get_method as get_method, methods as methods
from .observation import (
    Components as Components,
    Inapplicable as Inapplicable,
    Observation as Observation,
)
from .single_image.blind import ChainResult as ChainResult, blind as blind, run_chain as run_chain
from .single_image.illuminant import (
    Illuminant as Illuminant,
    estimate_illuminant as estimate_illuminant,
    illuminants as illuminants,
)
from .single_image.light_direction import estimate_direction as estimate_direction
from .single_image.paper import paper as paper, run_paper as run_paper
from .single_image.parameters import (
    SurfaceParameters as SurfaceParameters,
    fit_parameters as fit_parameters,
)
from .single_image.separation import (
    Separation as Separation,
    separate as separate,
    separations as separations,
)
from .single_image.shape import (
    GivenParameters as GivenParameters,
    RecoveredShape as RecoveredShape,
    recover_shape as recover_shape,
)
