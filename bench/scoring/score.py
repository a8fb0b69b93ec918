"""Score one method, or an estimate that was made elsewhere, on one truth."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from malus.bench.scoring.judge import Judge, Score
from malus.bench.scoring.observe import observe
from malus.reconstruct import Components, Method, Observation, get_method
from malus.reconstruct.methods import guarded
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import FloatArray
from malus.scenes.core.errors import InputError, check_kind


def score(truth: Truth, method: Method | Components | str) -> Score:
    """Score one method, the method of that name, or an estimate that is there, on one truth.

    Parameters
    ----------
    truth : Truth
        What the method is told of, and judged by.
    method : Method, the name of one, or Components
        Components are an estimate that was made elsewhere, such as a network's or another
        renderer's, (height, width, bands) in the truth's unit. Of Stokes vectors (..., 3) they are
        `Components(*numpy.moveaxis(stokes, -1, 0))`.

    Returns
    -------
    Score
        Errors, skill and the noise in them.

    Raises
    ------
    InputError
        No truth or method, an unknown method, or one that returns no picture of the image's shape.
    Inapplicable
        The method cannot work on this scene.

    Examples
    --------
    >>> import malus
    >>> import numpy as np
    >>> scene = malus.Scene(
    ...     shape=malus.Sphere(),
    ...     surface=malus.Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...     light=malus.Distant(incidence_deg=60),
    ...     camera=malus.Camera(resolution=8),
    ... )
    >>> truth = malus.render(scene, renderer="torrance-sparrow")
    >>> round(malus.score(truth, "half_vector").skill, 6)
    1.0
    >>> image, s1, s2 = np.moveaxis(truth.stokes, -1, 0)
    >>> round(malus.score(truth, malus.Components(image, 0.5 * s1, 0.5 * s2)).skill, 6)
    0.75
    """
    check_kind("truth", truth, Truth, "`malus.render` makes one")
    if isinstance(method, Components):
        given = Method("estimate", frozenset(), lambda _: method, "made elsewhere")
        estimate = guarded(given).reconstruct(observe(truth, ()))
        return Judge(truth).score(as_method("estimate", estimate, truth))
    if not isinstance(method, Method | str):
        expected = "a Method, the name of one, or Components"
        hint = "Stokes vectors are malus.Components(*numpy.moveaxis(stokes, -1, 0))"
        found = "None" if method is None else type(method).__name__
        raise InputError("method", expected, found, hint)
    return Judge(truth).score(get_method(method) if isinstance(method, str) else guarded(method))


def as_method(name: str, estimate: Components, truth: Truth) -> Method:
    """An estimate in the form of a method, for the judge that scores methods.

    The judge also asks what a method makes of the picture with another draw of the noise. What
    made the estimate is not at hand; its intensity at least is taken to follow the picture, as
    that of every method does, and its s1 and s2 to stay.
    """
    function = partial(_estimated, estimate=estimate, picture=truth.image)
    return Method(name, frozenset(), function, "images that were made elsewhere")


def _estimated(observation: Observation, estimate: Components, picture: FloatArray) -> Components:
    return replace(estimate, image=estimate.image + (observation.image - picture))
