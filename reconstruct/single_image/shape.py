"""Normals and surface of one object from one picture, its outline and the direction of its light.

The sum of squares of `shape_solver` has many minima. Three things lead to a good one: the search
starts from the shape that the outline alone suggests, from several roughnesses and both kinds of
body; smoothness is strong at first and is lowered only until the picture is explained (Morozov's
discrepancy principle), so that a sphere stays a sphere; and it runs on a small copy of the picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from malus.reconstruct.observation import Image, Inapplicable, checked_picture
from malus.reconstruct.single_image.convergence import UNDECIDED, Convergence
from malus.reconstruct.single_image.outline import Outline, outline_of
from malus.reconstruct.single_image.parameters import (
    TYPICAL_ETA,
    SurfaceParameters,
    check_body,
    check_positive,
    fit_parameters,
)
from malus.reconstruct.single_image.reduced import ReducedPicture, reduce
from malus.reconstruct.single_image.shading import (
    BodyKind,
    facet_reflectance,
    index_of,
    unit_direction,
)
from malus.reconstruct.single_image.shape_solver import (
    MaskedPicture,
    ResidualWeights,
    ShapeEstimate,
    ShapeProblem,
)
from malus.reconstruct.single_image.value_range import finite_pixels, unit_scale
from malus.scenes.core.arrays import BoolArray, Float64Array
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.errors import InputError

SMOOTHNESS = (3e-3, 3e-4, 3e-5, 3e-6, 3e-7)
"""Weight of smoothness at each stage of the search, from the outline's shape to the picture's."""
STOP = 0.0012
"""Error of the irradiance at which the search ends: below it, the shape would explain noise."""
INTEGRABILITY = 0.1
PLAUSIBLE_LEVEL, PLAUSIBLE_ALPHA = 1e-5, 3e-6
USUAL_ALPHA = 0.3
JUDGED = 3e-4
"""Smoothness at which the error must be below `FAILED`: a less smooth shape explains even noise."""
FAILED = 0.1
"""Error above which the picture is not explained: blobs leave 0.04 at that stage, noise 0.28."""
SAME_COST, SAME_ALPHA = 1.02, 0.1
"""Two starts ended at one minimum where costs differ by 2 % and alphas by a tenth at most."""
_STARTING_ALPHAS = (0.12, 0.4)
_STEPS = 30
_SAMPLE = 8_000
"""Pixels that the parameters are fitted to in the end, or up to twice as many: a handful of numbers
needs no more."""
_TOLERANCE = 1e-3


@dataclass(frozen=True)
class RecoveredShape:
    """Normals and surface parameters of an object, recovered from one picture.

    Attributes
    ----------
    normals : (height, width, 3)
        Unit normals on the mask, zero off it, in the image frame.
    parameters : SurfaceParameters
        Fitted to the whole picture with these normals.
    convergence : Convergence
        How the search ended.

    Examples
    --------
    >>> y, x = np.mgrid[1:-1:16j, -1:1:16j]
    >>> mask = x**2 + y**2 < 0.8
    >>> facing = np.sqrt(np.clip(1 - (x**2 + y**2) / 0.8, 0, None))
    >>> given = GivenParameters(alpha=0.3, body="unpolarised")
    >>> shape = recover_shape(facing[..., None], mask, np.array([0.0, 0.0, 1.0]), given)
    >>> shape.parameters.alpha, shape.convergence.converged
    (0.3, True)
    """

    __repr__ = brief_repr

    normals: Image
    parameters: SurfaceParameters
    convergence: Convergence


@dataclass(frozen=True)
class GivenParameters:
    """Parameters of light and surface that are given and need not be found; None is unknown.

    Attributes
    ----------
    irradiance : float or None
        Of the distant light, W m⁻² nm⁻¹ for radiances in W m⁻² sr⁻¹ nm⁻¹.
    eta, alpha : float or None
        Relative refractive index and Beckmann roughness.
    body : 'unpolarised', 'polarised' or None

    Raises
    ------
    InputError
        For a number that is not above 0, or an unknown body.

    Examples
    --------
    >>> GivenParameters(eta=1.5).alpha is None
    True
    """

    irradiance: float | None = None
    eta: float | None = None
    alpha: float | None = None
    body: BodyKind | None = None

    def __post_init__(self) -> None:
        """Refuse what nothing can be."""
        check_positive(irradiance=self.irradiance, eta=self.eta, alpha=self.alpha)
        if self.body is not None:
            check_body(self.body)


@dataclass(frozen=True)
class _Candidate:
    """One of several searches: its estimate so far, cost, and number of starts that ended there."""

    estimate: ShapeEstimate
    body: BodyKind
    eta: float
    cost: float = np.inf
    error: float = np.inf
    at_minimum: bool = False
    starts: int = 1

    def agrees(self, other: _Candidate) -> bool:
        """True if both are at the same minimum: their costs and roughnesses are about equal."""
        same_alpha = abs(np.log(self.estimate.alpha / other.estimate.alpha)) < SAME_ALPHA
        return self.body == other.body and same_alpha and self.cost < SAME_COST * other.cost


def recover_shape(
    image: Image,
    mask: BoolArray,
    direction: Float64Array,
    given: GivenParameters | None = None,
    specular: Image | None = None,
    size: int = 48,
    refuse: bool = True,
) -> RecoveredShape:
    """Recover normals, roughness, index and albedo of one object from its picture.

    Parameters
    ----------
    image : (height, width, bands) linear radiance under white light
    mask : (height, width) bool, the object
    direction : (3,) vector towards a distant light, in the image frame
    given : GivenParameters, optional
        Irradiance of the light, and parameters that need not be found.
    specular : (height, width, bands), optional
        Specular light, where it was separated by colour.
    size : int
        Pixels along the longer side of the copy on which normals are searched.
    refuse : bool
        False returns a smooth shape also where it does not explain the picture; its `convergence`
        warns of it.

    Returns
    -------
    RecoveredShape
        Its `normals` are (height, width, 3), in the image frame and the dtype of the image, but
        float32 at least.

    Raises
    ------
    Inapplicable
        If the object is too small, dark or without outline, or no shape explains the picture.
    InputError
        For arrays that do not belong together, or a direction that is none.

    Notes
    -----
    After Huynh and Robles-Kelly, "Simultaneous photometric invariance and shape recovery", ICCV
    (2009), and Ikeuchi and Horn, "Numerical shape from shading and occluding boundaries",
    Artificial Intelligence 17 (1981). See `malus.reconstruct.single_image.shape_solver`.

    Examples
    --------
    A Lambertian sphere, lit from the viewer:

    >>> y, x = np.mgrid[1:-1:16j, -1:1:16j]
    >>> mask = x**2 + y**2 < 0.8
    >>> facing = np.sqrt(np.clip(1 - (x**2 + y**2) / 0.8, 0, None))
    >>> given = GivenParameters(body="unpolarised")
    >>> shape = recover_shape(facing[..., None], mask, np.array([0.0, 0.0, 1.0]), given)
    >>> shape.normals.shape
    (16, 16, 3)
    """
    given = given or GivenParameters()
    image, mask = checked_picture(image, mask)
    mask = mask & finite_pixels(image, mask)
    if specular is not None:
        specular = np.asarray(specular)
        if specular.shape != image.shape:
            expected, hint = f"shape {image.shape}, as the image has", "give that of this picture"
            raise InputError("specular", expected, f"{specular.shape}", hint)
        mask = mask & finite_pixels(specular, mask)
    direction = unit_direction(direction)
    unit = unit_scale(float(image[mask].max(initial=0)))
    if unit == 1.0:
        return _searched(image, mask, direction, given, specular, size, refuse)
    irradiance = None if given.irradiance is None else given.irradiance * unit
    lobe = None if specular is None else specular.astype(np.float64) * unit
    scaled, given = image.astype(np.float64) * unit, replace(given, irradiance=irradiance)
    shape = _searched(scaled, mask, direction, given, lobe, size, refuse)
    dtype = np.result_type(image.dtype, np.float32)
    albedo, level = shape.parameters.albedo / unit, shape.parameters.level / unit
    parameters = replace(shape.parameters, albedo=albedo, level=level)
    return replace(shape, normals=shape.normals.astype(dtype), parameters=parameters)


def _searched(
    image: Image,
    mask: BoolArray,
    direction: Float64Array,
    given: GivenParameters,
    specular: Image | None,
    size: int,
    refuse: bool,
) -> RecoveredShape:
    """`recover_shape` for a picture in a unit near its peak: the search's bounds are absolute."""
    reduced = reduce(image, mask, specular, size)
    outline = outline_of(reduced.mask)
    candidates = _starts(reduced, outline, direction, given)
    for smoothness in SMOOTHNESS:
        candidates = [
            _refined(candidate, reduced.pictures, outline, direction, given, smoothness)
            for candidate in candidates
        ]
        candidates = _distinct(candidates)
        error = candidates[0].error
        unexplained = smoothness <= JUDGED and not error < FAILED
        if unexplained and (refuse or not np.isfinite(error)):
            residual = f"{error:.0%} of" if error < 10.0 else "more than ten times"
            raise Inapplicable(
                f"no shape explains the picture: residual {residual} its largest value"
            )
        if unexplained or error < STOP:
            break
    best, rival = _chosen(candidates)
    starts = sum(c.starts for c in candidates if c.body == best.body)
    convergence = Convergence(best.at_minimum, best.error, best.starts, starts, rival)
    normals = reduced.enlarged(best.estimate.normals, mask)
    if given.irradiance is not None:
        # The index of the search, which a usual level kept plausible; with slightly wrong normals
        # the level alone would give another.
        given = replace(given, eta=best.eta)
    parameters = _fitted(image, mask, direction, given, normals, best.body)
    return RecoveredShape(
        normals.astype(np.result_type(image.dtype, np.float32)), parameters, convergence
    )


def _starts(
    reduced: ReducedPicture, outline: Outline, direction: Float64Array, given: GivenParameters
) -> list[_Candidate]:
    """Starts of the search: the outline's shape with every kind of body and several roughnesses."""
    components = outline.inflated()
    n_z = np.sqrt(np.clip(1.0 - (components**2).sum(axis=1), 0.0, None))
    normals = np.column_stack([components, n_z])
    total = reduced.total[:, None]
    if not total.max() > 0:
        raise Inapplicable("the object is dark: no shading to recover a shape from")
    bodies = get_args(BodyKind) if given.body is None else (given.body,)
    alphas = _STARTING_ALPHAS if given.alpha is None else (given.alpha,)
    candidates = []
    for body in bodies:
        for alpha in alphas:
            eta = given.eta or TYPICAL_ETA
            start = fit_parameters(total, normals, direction, body, None, eta, alpha)
            albedo = max(float(start.albedo[0]), 0.1 * float(total.max()))
            level = _usual_level(direction, given) or 0.1 * albedo
            estimate = ShapeEstimate(normals, albedo, level, alpha)
            candidates.append(_Candidate(estimate, body, eta))
    return candidates


def _refined(
    candidate: _Candidate,
    pictures: list[MaskedPicture],
    outline: Outline,
    direction: Float64Array,
    given: GivenParameters,
    smoothness: float,
) -> _Candidate:
    """The candidate after one stage: the minimum at this smoothness, and the index of its level."""
    usual_level = _usual_level(direction, given)
    weights = ResidualWeights(
        smoothness,
        INTEGRABILITY,
        PLAUSIBLE_LEVEL if usual_level else 0.0,
        usual_level if usual_level else 1.0,
        PLAUSIBLE_ALPHA,
        USUAL_ALPHA,
    )
    problem = ShapeProblem(
        pictures, outline, direction, candidate.body, candidate.eta, weights, given.alpha
    )
    estimate, minimum = problem.solve(candidate.estimate, _STEPS, _TOLERANCE)
    eta = candidate.eta
    if given.eta is None and given.irradiance is not None:
        eta = index_of(direction, estimate.level / given.irradiance)
    return replace(
        candidate,
        estimate=estimate,
        eta=eta,
        cost=float(minimum.cost),
        error=problem.error(estimate),
        at_minimum=bool(minimum.success),
    )


def _usual_level(direction: Float64Array, given: GivenParameters) -> float | None:
    """Specular level of the given index or a typical one; None if no irradiance is given."""
    if given.irradiance is None:
        return None
    return given.irradiance * facet_reflectance(direction, given.eta or TYPICAL_ETA)


def _distinct(candidates: list[_Candidate]) -> list[_Candidate]:
    """One candidate for each minimum, that of least cost, in order of cost; starts are added up."""
    distinct: list[_Candidate] = []
    for candidate in sorted(candidates, key=lambda c: c.cost):
        same = next((i for i, c in enumerate(distinct) if candidate.agrees(c)), None)
        if same is None:
            distinct.append(candidate)
        else:
            starts = distinct[same].starts + candidate.starts
            distinct[same] = replace(distinct[same], starts=starts)
    return distinct


def _chosen(candidates: list[_Candidate]) -> tuple[_Candidate, float]:
    """The candidate of least cost, and the cost of the other kind of body over its own.

    An unpolarised body is preferred where both kinds cost about the same.
    """
    best = candidates[0]
    other = next((c for c in candidates if c.body != best.body), None)
    if other is None:
        return best, np.inf
    if other.body == "unpolarised" and other.cost < UNDECIDED * best.cost:
        best, other = other, best
    return best, other.cost / best.cost


def _fitted(
    image: Image,
    mask: BoolArray,
    direction: Float64Array,
    given: GivenParameters,
    normals: Float64Array,
    body: BodyKind,
) -> SurfaceParameters:
    """Surface parameters fitted to all bands of the whole picture with these normals."""
    step = max(1, int(mask.sum()) // _SAMPLE)
    pixels, normals = image[mask][::step].astype(np.float64), normals[mask][::step]
    return fit_parameters(
        pixels, normals, direction, body, given.irradiance, given.eta, given.alpha
    )
