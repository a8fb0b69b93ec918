"""The polarisation that follows from a photograph and from what is known about it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from malus.reconstruct.image import from_lobes, joined_deviation
from malus.reconstruct.learned.net import is_network
from malus.reconstruct.lobe_models import diffuse, microfacets
from malus.reconstruct.methods import get_method, source_of
from malus.reconstruct.observation import Components, Inapplicable, Observation
from malus.reconstruct.photos.by_network import DEFAULT, by_network
from malus.reconstruct.photos.knowledge import Knowledge
from malus.reconstruct.single_image.blind import BLIND_METHODS, ChainResult, run_chain
from malus.reconstruct.single_image.illuminant import ILLUMINANTS
from malus.reconstruct.single_image.paper import PAPER_SEPARATIONS, run_paper
from malus.reconstruct.single_image.parameters import TYPICAL_ETA
from malus.reconstruct.single_image.separation import separate
from malus.scenes.core.arrays import BoolArray, Float32Array, Float64Array
from malus.scenes.core.errors import InputError, counted, first_line, kind_of
from malus.scenes.lights.lights import Distant

TYPICAL_ALPHA = 0.2
"""Roughness where nothing is known of the surface: that of moulded plastic."""
SEPARATION = "ratio"
"""Separation of every method but the paper's, unless another is asked for."""
_FULLY = 1.0 + 1e-4
"""More polarised light than this share of all is no rounding of single precision."""
_BLIND = {name: needs for name, needs, *_ in BLIND_METHODS}


class Estimate(NamedTuple):
    """Components of a photograph, what was assumed and estimated, and reasons not to believe it."""

    components: Components
    statements: tuple[str, ...]
    warnings: tuple[str, ...] = ()


def estimate(
    image: Float32Array,
    knowledge: Knowledge,
    where: str,
    wavelengths_nm: tuple[float, ...] | None = None,
) -> Estimate:
    """Components of a photograph (height, width, 1 or 3) in linear light; `where` names it.

    Channels that are bands of a spectrum have `wavelengths_nm`; without, three are red, green and
    blue.

    A method that is named is used. Otherwise, of a picture alone `net` tells it; with a light or
    without normals, there is one distant light and `blind` does it all; with normals and no light,
    light comes from all around: facets are weighted by what the viewer sees. Every object that has
    a label is estimated on its own; one of which nothing can be told is left unpolarised, with a
    warning.

    Raises
    ------
    InputError
        Where no method works on this picture, with the method's reason.
    """
    _check_given(image, knowledge, where)
    if not image.max() > 0:
        raise InputError(where, "a picture with some light in it", "an all-dark one", "check it")
    if knowledge.is_nothing:
        knowledge = replace(knowledge, method=DEFAULT)
    mask = knowledge.mask if knowledge.mask is not None else np.ones(image.shape[:2], bool)
    # A network does not use normals: they do not hide anything from it.
    if knowledge.normals is not None and not is_network(knowledge.method):
        mask = mask & (knowledge.normals[..., 2] > 0)
    try:
        name = knowledge.illuminant
        of_itself = knowledge.method in PAPER_SEPARATIONS or is_network(knowledge.method)
        own = name is None and of_itself
        light = ILLUMINANTS[name or "neutral"](image, mask)
        observed = _observation(image, mask, light.colour, knowledge, own)
        whole = replace(observed, wavelengths_nm=wavelengths_nm)
        results, failed = _of_objects(whole, knowledge)
    except Inapplicable as reason:
        raise InputError(
            where, "a picture that this can be told from", str(reason), _advice(knowledge)
        ) from None
    components = _together(whole, results)
    coloured = replace(
        components,
        image=image,
        s1=components.s1 * light.colour.astype(np.float32),
        s2=components.s2 * light.colour.astype(np.float32),
    )
    about_light = () if own else (light.assumption,)
    statements = (*about_light, *(s for _, result in results for s in result.statements))
    warnings = (*failed, *(w for _, result in results for w in result.warnings))
    return Estimate(coloured, statements, warnings)


def _check_given(image: Float32Array, knowledge: Knowledge, where: str) -> None:
    """Refuse pictures that are not finite; masks, labels and normals of another size than theirs.

    Raises
    ------
    InputError
        With the number of values, or what is of another size.
    """
    if not np.isfinite(image).all():
        bad = int(np.count_nonzero(~np.isfinite(image)))
        raise InputError(where, "finite values", counted(bad, "other"), "repair the picture")
    size = image.shape[:2]
    told = {"labels": knowledge.labels, "mask": knowledge.mask, "normals": knowledge.normals}
    for name, array in told.items():
        expected = (*size, 3) if name == "normals" else size
        if array is not None and np.shape(array) != expected:
            hint = "make it of the picture's size"
            raise InputError(name, f"shape {expected}", f"{np.shape(array)}", hint)


def _observation(
    image: Float32Array,
    mask: BoolArray,
    colour: Float64Array,
    knowledge: Knowledge,
    untold: bool,
) -> Observation:
    """The picture under white light with all that is known; `untold`: the light's colour is not."""
    bands = image.shape[-1]
    return Observation(
        np.maximum(image, 0) / colour.astype(np.float32),
        mask,
        normals=knowledge.normals,
        eta=None if knowledge.eta is None else np.full(bands, knowledge.eta),
        alpha=knowledge.alpha,
        light=None if knowledge.light is None else Distant.towards(knowledge.light),
        illuminant=None if untold else np.ones(bands),
    )


def _of_objects(
    whole: Observation, knowledge: Knowledge
) -> tuple[list[tuple[BoolArray, Estimate]], list[str]]:
    """Mask and estimate of every object, and which ones nothing can be told of, in words.

    Raises
    ------
    Inapplicable
        If nothing can be told of any.
    """
    if knowledge.labels is None:
        return [(whole.mask, _estimate_of(whole, knowledge))], []
    results, failed = [], {}
    for label in np.unique(knowledge.labels[whole.mask]).tolist():
        mask = whole.mask & (knowledge.labels == label)
        try:
            result = _estimate_of(replace(whole, mask=mask), knowledge)
        except Inapplicable as reason:
            failed[label] = reason
            continue
        told, warned = (
            tuple(f"object {label}: {text}" for text in texts)
            for texts in (result.statements, result.warnings)
        )
        results.append((mask, Estimate(result.components, told, warned)))
    words = [f"object {label} is left unpolarised: {why}" for label, why in failed.items()]
    if not results:
        reasons = dict.fromkeys(map(str, failed.values()))
        # What holds for all is told once: a message has little room.
        raise Inapplicable("; ".join(reasons if len(reasons) == 1 else words) or "no object")
    return results, words


def _estimate_of(observation: Observation, knowledge: Knowledge) -> Estimate:
    """Estimate of one object, in the light of its picture."""
    chain: ChainResult | None = None
    warnings: tuple[str, ...] = ()
    if is_network(knowledge.method):
        components, statements, warnings = by_network(
            observation, knowledge.method or DEFAULT, knowledge.net_size, knowledge.physical
        )
    elif knowledge.method in PAPER_SEPARATIONS:
        separation = knowledge.separation or PAPER_SEPARATIONS[knowledge.method]
        chain = run_paper(observation, separation, calibrated=False)
    elif knowledge.method is not None and knowledge.method not in _BLIND:
        components, statements = _by_method(observation, knowledge)
        components, warnings = _as_light(components, observation)
    elif knowledge.method is None and knowledge.normals is not None and knowledge.light is None:
        components, statements = _surrounded(observation, knowledge)
    else:
        _require(observation, _BLIND.get(knowledge.method or "", frozenset()))
        separation = knowledge.separation or SEPARATION
        chain = run_chain(observation, calibrated=False, separation=separation)
    if chain is not None:
        components, statements, warnings = chain.components, chain.statements, chain.warnings
    if (invalid := components.invalid(observation.mask)) > 0:
        pixels = counted(invalid, "pixel")
        flagged = f"{pixels} of the object without valid intensity or normal: not polarised"
        warnings = (*warnings, flagged)
    return Estimate(components, statements, warnings)


def _together(whole: Observation, results: list[tuple[BoolArray, Estimate]]) -> Components:
    """The components of all objects in one picture; what is off all of them is unpolarised."""
    s1, s2 = np.zeros_like(whole.image), np.zeros_like(whole.image)
    parts = [(mask, result.components) for mask, result in results]
    for mask, found in parts:
        s1[mask], s2[mask] = found.s1[mask], found.s2[mask]
    deviation = joined_deviation(whole.image, whole.mask, parts)
    return Components(whole.image, s1, s2, deviation=deviation)


def _require(observation: Observation, needs: frozenset[str]) -> None:
    """Raise Inapplicable for the first thing that a method needs and that is not given."""
    for need in sorted(needs):
        observation.require(need)


def _by_method(
    observation: Observation, knowledge: Knowledge
) -> tuple[Components, tuple[str, ...]]:
    """Components by the method that is named, and what was assumed."""
    method = get_method(knowledge.method or "")
    filled = observation
    statements: tuple[str, ...] = ()
    if method.needs & {"specular", "diffuse"}:
        filled, statements = _with_lobes(observation, knowledge)
    _require(filled, method.needs - {"distribution"})  # untold it is Beckmann's
    try:
        components = method.reconstruct(filled)
    except (InputError, Inapplicable):
        raise
    except Exception as error:
        if source_of(knowledge.method or "") is None:
            raise
        where, found = f"method {method.name}", f"{kind_of(error)}: {first_line(error)}"
        raise InputError(where, "an estimate of the picture", found, "correct it") from error
    return components, (f"method {method.name}: {method.summary}", *statements)


def _as_light(
    components: Components, observation: Observation
) -> tuple[Components, tuple[str, ...]]:
    """Components without numbers that are not finite, and warnings of what is no light."""
    inside = observation.mask[..., None]
    finite = np.isfinite(components.s1) & np.isfinite(components.s2)
    s1, s2 = (np.where(finite, values, 0) for values in (components.s1, components.s2))
    over = inside & (np.hypot(s1, s2) > _FULLY * observation.image)
    counts = {
        "with no finite estimate: not polarised": ~finite & inside,
        "more than fully polarised, which no light is": over,
    }
    warnings = tuple(
        f"{counted(count, 'pixel')} of the object {what}"
        for what, where in counts.items()
        if (count := int(np.count_nonzero(where.any(axis=-1))))
    )
    return replace(components, s1=s1, s2=s2), warnings


def _advice(knowledge: Knowledge) -> str:
    """What else could be given: what a method that is named cannot do without, if that is it."""
    if is_network(knowledge.method):
        return "give a larger `net_size`, mask or picture"
    needs = get_method(knowledge.method).needs if knowledge.method is not None else frozenset()
    useful = [name for name in ("normals", "light") if name in needs] or ("normals", "mask")
    missing = [name for name in useful if getattr(knowledge, name) is None]
    listed = ", ".join(f"`{name}`" for name in missing)
    return f"give {listed}" if missing else "give another picture or light"


def _surrounded(
    observation: Observation, knowledge: Knowledge
) -> tuple[Components, tuple[str, ...]]:
    """Components under light from all around, and what was assumed."""
    filled, (about_lobes, about_surface) = _with_lobes(observation, knowledge)
    components = from_lobes(filled, microfacets("visible"), diffuse)
    return components, (about_lobes, "light comes from all around", about_surface)


def _with_lobes(
    observation: Observation, knowledge: Knowledge
) -> tuple[Observation, tuple[str, str]]:
    """The observation with lobes, η and α, separated or assumed where they are not known."""
    if knowledge.mirror:
        specular = np.where(observation.mask[..., None], observation.image, 0)
        statement = "all light is taken for mirrored"
    else:
        separation = knowledge.separation or SEPARATION
        specular = separate(observation.image, observation.mask, method=separation).specular
        statement = "separated by colour, under light of one colour"
    eta, alpha = knowledge.eta or TYPICAL_ETA, knowledge.alpha or TYPICAL_ALPHA
    filled = replace(
        observation,
        specular=specular,
        diffuse=observation.image - specular,
        eta=np.full(observation.image.shape[-1], eta),
        alpha=alpha,
    )
    return filled, (statement, f"eta {eta:g}, alpha {alpha:g}")
