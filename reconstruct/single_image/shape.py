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
from numpy.typing import NDArray

from malus.reconstruct.observation import Image, Inapplicable
from malus.reconstruct.single_image.convergence import UNDECIDED, Convergence
from malus.reconstruct.single_image.outline import Outline, outline_of
from malus.reconstruct.single_image.parameters import TYPICAL_ETA, Parameters, fit_parameters
from malus.reconstruct.single_image.reduced import Reduction, reduce
from malus.reconstruct.single_image.shading import BodyKind, facet_reflectance, index_of
from malus.reconstruct.single_image.shape_solver import Guess, Picture, ShapeProblem, Weights

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

SMOOTHNESS = (3e-3, 3e-4, 3e-5, 3e-6, 3e-7)
"""Stages of the search, from the outline's shape to the picture's."""
STOP = 0.0012
"""Error of the irradiance at which bending further would explain noise."""
INTEGRABILITY = 0.1
PLAUSIBLE_LEVEL, PLAUSIBLE_ALPHA = 1e-5, 3e-6
USUAL_ALPHA = 0.3
JUDGED = 3e-4
"""Stage at which a picture must be explained roughly: bent further, a shape explains even noise."""
FAILED = 0.1
"""Error above which a shape is no shape then: blobs leave 0.04, noise leaves 0.28."""
SAME_COST, SAME_ALPHA = 1.02, 0.1
"""Two starts ended at one minimum where costs differ by 2 % and alphas by a tenth at most."""
_STARTING_ALPHAS = (0.12, 0.4)
_STEPS = 30
_SAMPLE = 8_000
"""Pixels that the parameters are fitted to in the end: a handful of numbers needs no more."""
_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Recovered:
    """What one picture told about an object.

    Attributes
    ----------
    normals : (height, width, 3)
        Unit normals on the mask, zero off it.
    parameters : Parameters
        Fitted to the whole picture with these normals.
    convergence : Convergence
        How the search ended.
    """

    normals: Image
    parameters: Parameters
    convergence: Convergence


@dataclass(frozen=True)
class Known:
    """What is known besides the picture; None is unknown."""

    irradiance: float | None = None
    eta: float | None = None
    alpha: float | None = None
    body: BodyKind | None = None


@dataclass(frozen=True)
class _Candidate:
    guess: Guess
    body: BodyKind
    eta: float
    cost: float = np.inf
    error: float = np.inf
    at_minimum: bool = False
    starts: int = 1

    def agrees(self, other: _Candidate) -> bool:
        """Whether both are at one minimum: as cheap, and as rough."""
        same_alpha = abs(np.log(self.guess.alpha / other.guess.alpha)) < SAME_ALPHA
        return self.body == other.body and same_alpha and self.cost < SAME_COST * other.cost


def recover_shape(
    image: Image,
    mask: Mask,
    direction: Floats,
    known: Known | None = None,
    specular: Image | None = None,
    size: int = 48,
) -> Recovered:
    """Normals, roughness, index and albedo of one object.

    Parameters
    ----------
    image : (height, width, bands) linear radiance under white light
    mask : (height, width) bool, the object
    direction : (3,) unit vector towards a distant light
    known : Known, optional
        Irradiance of the light, and parameters that need not be found.
    specular : (height, width, bands), optional
        Mirrored light, where a separation by colour found it.
    size : int
        Pixels along the longer side of the copy on which normals are searched.

    Raises
    ------
    Inapplicable
        If the object is too small, dark or without outline, or the search explains nothing.
    """
    known = known or Known()
    reduced = reduce(image, mask, specular, size)
    outline = outline_of(reduced.mask)
    candidates = _starts(reduced, outline, direction, known)
    for smoothness in SMOOTHNESS:
        candidates = [
            _refined(c, reduced.pictures, outline, direction, known, smoothness) for c in candidates
        ]
        candidates = _distinct(candidates)
        error = candidates[0].error
        if smoothness <= JUDGED and not error < FAILED:
            raise Inapplicable(
                f"no shape explains the picture: residual {error:.0%} of its largest value"
            )
        if error < STOP:
            break
    best, rival = _chosen(candidates)
    starts = sum(c.starts for c in candidates if c.body == best.body)
    convergence = Convergence(best.at_minimum, best.error, best.starts, starts, rival)
    normals = reduced.enlarged(best.guess.normals, mask)
    if known.irradiance is not None:
        # From the search, where what is usual counts: on a bent shape the level alone says little.
        known = replace(known, eta=best.eta)
    parameters = _finished(image, mask, direction, known, normals, best.body)
    return Recovered(normals.astype(image.dtype), parameters, convergence)


def _starts(
    reduced: Reduction, outline: Outline, direction: Floats, known: Known
) -> list[_Candidate]:
    """The outline's shape with every kind of body and several roughnesses."""
    components = outline.inflated()
    n_z = np.sqrt(np.clip(1.0 - (components**2).sum(axis=1), 0.0, None))
    normals = np.column_stack([components, n_z])
    total = reduced.total[:, None]
    if not total.max() > 0:
        raise Inapplicable("the object is dark: no shading to recover a shape from")
    bodies = get_args(BodyKind) if known.body is None else (known.body,)
    alphas = _STARTING_ALPHAS if known.alpha is None else (known.alpha,)
    found = []
    for body in bodies:
        for alpha in alphas:
            eta = known.eta or TYPICAL_ETA
            start = fit_parameters(total, normals, direction, body, None, eta, alpha)
            albedo = max(float(start.albedo[0]), 0.1 * float(total.max()))
            usual = _usual_level(direction, known) or 0.1 * albedo
            found.append(_Candidate(Guess(normals, albedo, usual, alpha), body, eta))
    return found


def _refined(
    candidate: _Candidate,
    pictures: list[Picture],
    outline: Outline,
    direction: Floats,
    known: Known,
    smoothness: float,
) -> _Candidate:
    """One stage: minimise at this smoothness, then read the index off the level found."""
    usual = _usual_level(direction, known)
    weights = Weights(
        smoothness,
        INTEGRABILITY,
        PLAUSIBLE_LEVEL if usual else 0.0,
        usual if usual else 1.0,
        PLAUSIBLE_ALPHA,
        USUAL_ALPHA,
    )
    problem = ShapeProblem(
        pictures, outline, direction, candidate.body, candidate.eta, weights, known.alpha
    )
    guess, found = problem.solve(candidate.guess, _STEPS, _TOLERANCE)
    eta = candidate.eta
    if known.eta is None and known.irradiance is not None:
        eta = index_of(direction, guess.level / known.irradiance)
    return replace(
        candidate,
        guess=guess,
        eta=eta,
        cost=float(found.cost),
        error=problem.error(guess),
        at_minimum=bool(found.success),
    )


def _usual_level(direction: Floats, known: Known) -> float | None:
    """Level of mirrored light of a typical dielectric, or of the known one."""
    if known.irradiance is None:
        return None
    return known.irradiance * facet_reflectance(direction, known.eta or TYPICAL_ETA)


def _distinct(candidates: list[_Candidate]) -> list[_Candidate]:
    """The cheapest of those that agree, with the number of their starts; cheapest first."""
    found: list[_Candidate] = []
    for candidate in sorted(candidates, key=lambda c: c.cost):
        same = next((i for i, c in enumerate(found) if candidate.agrees(c)), None)
        if same is None:
            found.append(candidate)
        else:
            found[same] = replace(found[same], starts=found[same].starts + candidate.starts)
    return found


def _chosen(candidates: list[_Candidate]) -> tuple[_Candidate, float]:
    """The cheapest, or the safer body beside it, and the other body's cost over its cost."""
    best = candidates[0]
    other = next((c for c in candidates if c.body != best.body), None)
    if other is None:
        return best, np.inf
    if other.body == "unpolarised" and other.cost < UNDECIDED * best.cost:
        best, other = other, best
    return best, other.cost / best.cost


def _finished(
    image: Image, mask: Mask, direction: Floats, known: Known, normals: Floats, body: BodyKind
) -> Parameters:
    """The parameters fitted to the whole picture, all its bands, with these normals."""
    every = max(1, int(mask.sum()) // _SAMPLE)
    pixels, normals = image[mask][::every].astype(np.float64), normals[mask][::every]
    return fit_parameters(
        pixels, normals, direction, body, known.irradiance, known.eta, known.alpha
    )
