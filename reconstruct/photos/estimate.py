"""What a user knows about a photograph, and the polarisation that follows from it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from malus.reconstruct import Components, Inapplicable, Observation
from malus.reconstruct.image import from_lobes
from malus.reconstruct.lobe_models import diffuse, microfacets
from malus.reconstruct.photos.masks_and_normals import read_mask, read_normals
from malus.reconstruct.photos.picture import Image
from malus.reconstruct.single_image.blind import run_chain
from malus.reconstruct.single_image.illuminant import ILLUMINANTS
from malus.reconstruct.single_image.parameters import TYPICAL_ETA
from malus.reconstruct.single_image.separation import separate
from malus.scenes.core.errors import InputError
from malus.scenes.lights.lights import Distant
from malus.scenes.materials.materials import material

Mask = NDArray[np.bool_]

TYPICAL_ALPHA = 0.2


class Preset(NamedTuple):
    """Index, roughness, and whether all light is mirrored, as by water and window panes."""

    eta: float
    alpha: float
    mirror: bool


PRESETS = {
    "water": Preset(1.333, 0.05, True),
    "glass": Preset(1.52, 0.02, True),
    "foliage": Preset(1.45, 0.3, False),
    "skin": Preset(1.40, 0.35, False),
    "plastic": Preset(1.50, 0.2, False),
}
"""Indices of Jacquemoud and Baret (1990) for leaves and Tearney et al. (1995) for skin; the
roughnesses are middling values of such surfaces, not measurements of one."""


@dataclass(frozen=True)
class Knowledge:
    """What is given besides the picture; None is estimated or assumed.

    Attributes
    ----------
    normals : (height, width, 3) float32, zero where there is none
    mask : (height, width) bool
    light : (x, y, z) towards a distant light, in the image frame
    eta, alpha : refractive index and Beckmann roughness
    mirror : all light is mirrored
    illuminant : name of an estimator of the light's colour
    """

    normals: Image | None = None
    mask: Mask | None = None
    light: tuple[float, float, float] | None = None
    eta: float | None = None
    alpha: float | None = None
    mirror: bool = False
    illuminant: str = "neutral"


class Estimate(NamedTuple):
    """Components of a photograph, and in words what they rest on and why not to believe them."""

    components: Components
    statements: tuple[str, ...]
    warnings: tuple[str, ...] = ()


def gather(
    shape: tuple[int, int],
    normals: Path | None = None,
    mask: Path | None = None,
    light: tuple[float, float, float] | None = None,
    material_name: str | None = None,
    alpha: float | None = None,
    preset: str | None = None,
    illuminant: str = "neutral",
) -> Knowledge:
    """Read what belongs to a picture of `shape` (height, width).

    Raises
    ------
    InputError
        Files of another size, a light of no direction, unknown names, alpha outside (0, 1], a
        mirror without normals or with a light.
    """
    known = PRESETS.get(preset or "")
    if preset is not None and known is None:
        raise InputError("--preset", f"one of {', '.join(PRESETS)}", preset, "choose one of them")
    if known is not None and known.mirror and (normals is None or light is not None):
        raise InputError(
            f"--preset {preset}",
            "--normals and no --light, as a mirror shows what is around it",
            "no --normals" if normals is None else "--light",
            "a mirror's shading tells neither shape nor light",
        )
    if alpha is not None and not 0 < alpha <= 1:
        raise InputError("--alpha", "a roughness in (0, 1]", f"{alpha:g}", "correct this value")
    if light is not None and not 1e-6 < float(np.linalg.norm(light)) < np.inf:
        raise InputError("--light", "a direction X,Y,Z that is not zero", f"{light}", "correct it")
    eta = material(material_name).eta_d if material_name else known.eta if known else None
    return Knowledge(
        read_normals(normals, shape) if normals else None,
        read_mask(mask, shape) if mask else None,
        light,
        eta,
        alpha if alpha is not None else known.alpha if known else None,
        bool(known and known.mirror),
        illuminant,
    )


def estimate(image: Image, known: Knowledge, where: str) -> Estimate:
    """Components of a photograph (height, width, 1 or 3) in linear light.

    With a light, or without normals, there is one distant light and `blind` does it all. With
    normals and no light, light comes from all around: facets are weighted by what the viewer sees.

    Raises
    ------
    InputError
        Where no method works on this picture, with the method's reason.
    """
    if not image.max() > 0:
        raise InputError(where, "a picture with some light in it", "an all-dark one", "check it")
    mask = known.mask if known.mask is not None else np.ones(image.shape[:2], bool)
    if known.normals is not None:
        mask = mask & (known.normals[..., 2] > 0)
    warnings: tuple[str, ...] = ()
    try:
        light = ILLUMINANTS[known.illuminant](image, mask)
        colour = light.colour.astype(np.float32)
        balanced = np.maximum(image, 0) / colour
        observation = Observation(
            balanced,
            mask,
            normals=known.normals,
            eta=None if known.eta is None else np.full(image.shape[-1], known.eta),
            alpha=known.alpha,
            light=None if known.light is None else Distant.towards(known.light),
        )
        if known.normals is not None and known.light is None:
            found, said = _surrounded(observation, known)
        else:
            chain = run_chain(observation, calibrated=False)
            found, said, warnings = chain.components, chain.statements, chain.warnings
    except Inapplicable as reason:
        raise InputError(
            where, "a picture that this can be told from", str(reason), _advice(known)
        ) from None
    if (invalid := found.invalid(mask)) > 0:
        flagged = f"{invalid} pixels of the object have no valid intensity or normal: not polarised"
        warnings = (*warnings, flagged)
    coloured = replace(found, image=image, s1=found.s1 * colour, s2=found.s2 * colour)
    return Estimate(coloured, (light.assumption, *said), warnings)


def _advice(known: Knowledge) -> str:
    missing = [
        option
        for option, value in (
            ("--normals", known.normals),
            ("--mask", known.mask),
            ("--light", known.light),
        )
        if value is None
    ]
    return f"give {', '.join(missing)}" if missing else "give another picture or light"


def _surrounded(observation: Observation, known: Knowledge) -> tuple[Components, tuple[str, ...]]:
    """Light from all around: the visible facets about the normal, and the body's interface."""
    if known.mirror:
        specular = np.where(observation.mask[..., None], observation.image, 0)
        how = "all light is taken for mirrored"
    else:
        specular = separate(observation.image, observation.mask).specular
        how = "separated by colour, under light of one colour"
    eta, alpha = known.eta or TYPICAL_ETA, known.alpha or TYPICAL_ALPHA
    filled = replace(
        observation,
        specular=specular,
        diffuse=observation.image - specular,
        eta=np.full(observation.image.shape[-1], eta),
        alpha=alpha,
    )
    found = from_lobes(filled, microfacets("visible"), diffuse)
    return found, (how, "light comes from all around", f"eta {eta:g}, alpha {alpha:g}")
