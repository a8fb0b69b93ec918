"""What is known about a photograph, and the polarisation that follows from it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from malus.reconstruct.image import from_lobes
from malus.reconstruct.lobe_models import diffuse, microfacets
from malus.reconstruct.observation import Components, Inapplicable, Observation
from malus.reconstruct.photos.masks_and_normals import read_mask, read_normals
from malus.reconstruct.single_image.blind import run_chain
from malus.reconstruct.single_image.illuminant import ILLUMINANTS
from malus.reconstruct.single_image.parameters import TYPICAL_ETA
from malus.reconstruct.single_image.separation import SEPARATIONS, separate
from malus.scenes.core.arrays import BoolArray, Float32Array
from malus.scenes.core.errors import InputError
from malus.scenes.lights.lights import Distant
from malus.scenes.materials.materials import material

TYPICAL_ALPHA = 0.2
"""Roughness where nothing is known of the surface: that of moulded plastic."""


class Preset(NamedTuple):
    """Index, roughness, and whether all light is specular, as from water and window panes."""

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
    mirror : all light is specular
    illuminant : name of an estimator of the light's colour
    separation : name of the method that tells the lobes apart by colour

    Examples
    --------
    >>> Knowledge(light=(1.0, 1.0, 2.0), eta=1.5).illuminant
    'neutral'
    """

    normals: Float32Array | None = None
    mask: BoolArray | None = None
    light: tuple[float, float, float] | None = None
    eta: float | None = None
    alpha: float | None = None
    mirror: bool = False
    illuminant: str = "neutral"
    separation: str = "ratio"

    def __post_init__(self) -> None:
        """Refuse unknown names."""
        for parameter, name, names in (
            ("illuminant", self.illuminant, tuple(ILLUMINANTS)),
            ("separation", self.separation, tuple(SEPARATIONS)),
        ):
            if name not in names:
                expected = f"one of {', '.join(names)}"
                raise InputError(parameter, expected, name, "choose one of them")


class Estimate(NamedTuple):
    """Components of a photograph, what was assumed and estimated, and reasons not to believe it."""

    components: Components
    statements: tuple[str, ...]
    warnings: tuple[str, ...] = ()


def read_knowledge(
    shape: tuple[int, int],
    normals: Path | str | None = None,
    mask: Path | str | None = None,
    light: tuple[float, float, float] | None = None,
    material_name: str | None = None,
    alpha: float | None = None,
    preset: str | None = None,
    illuminant: str = "neutral",
    separation: str = "ratio",
) -> Knowledge:
    """Read and check what is given besides a picture of `shape` (height, width).

    Parameters
    ----------
    shape : (height, width)
    normals, mask : path, optional
        Files of the picture's size, see `malus filter --help`.
    light : (x, y, z), optional
        Towards a distant light: right, up, to the viewer.
    material_name : str, optional
        A material of `list_materials`, for its refractive index.
    alpha : float, optional
        Beckmann roughness, in (0, 1].
    preset : str, optional
        A name of `PRESETS`, for index, roughness, and whether all light is mirrored.
    illuminant, separation : str
        Names of the estimator of the light's colour and of the separation of the lobes.

    Returns
    -------
    Knowledge

    Raises
    ------
    InputError
        Files of another size, a light of no direction, unknown names, alpha outside (0, 1], a
        mirror without normals or with a light.

    Examples
    --------
    >>> read_knowledge((48, 64), light=(1.0, 1.0, 2.0), material_name="pmma").eta is not None
    True
    """
    typical = PRESETS.get(preset or "")
    if preset is not None and typical is None:
        raise InputError("preset", f"one of {', '.join(PRESETS)}", preset, "choose one of them")
    if typical is not None and typical.mirror and (normals is None or light is not None):
        raise InputError(
            "preset",
            f"`normals` and no `light` for {preset}, as a mirror shows what is around it",
            "no `normals`" if normals is None else "`light`",
            "a mirror's shading tells neither shape nor light",
        )
    if alpha is not None and not 0 < alpha <= 1:
        raise InputError("alpha", "a roughness in (0, 1]", f"{alpha:g}", "correct this value")
    if light is not None and not 1e-6 < float(np.linalg.norm(light)) < np.inf:
        raise InputError("light", "a direction X,Y,Z that is not zero", f"{light}", "correct it")
    eta = material(material_name).eta_d if material_name else typical.eta if typical else None
    return Knowledge(
        read_normals(normals, shape) if normals else None,
        read_mask(mask, shape) if mask else None,
        light,
        eta,
        alpha if alpha is not None else typical.alpha if typical else None,
        bool(typical and typical.mirror),
        illuminant,
        separation,
    )


def estimate(image: Float32Array, knowledge: Knowledge, where: str) -> Estimate:
    """Components of a photograph (height, width, 1 or 3) in linear light; `where` names it.

    With a light, or without normals, there is one distant light and `blind` does it all. With
    normals and no light, light comes from all around: facets are weighted by what the viewer sees.

    Raises
    ------
    InputError
        Where no method works on this picture, with the method's reason.
    """
    if not image.max() > 0:
        raise InputError(where, "a picture with some light in it", "an all-dark one", "check it")
    mask = knowledge.mask if knowledge.mask is not None else np.ones(image.shape[:2], bool)
    if knowledge.normals is not None:
        mask = mask & (knowledge.normals[..., 2] > 0)
    warnings: tuple[str, ...] = ()
    try:
        light = ILLUMINANTS[knowledge.illuminant](image, mask)
        colour = light.colour.astype(np.float32)
        balanced = np.maximum(image, 0) / colour
        observation = Observation(
            balanced,
            mask,
            normals=knowledge.normals,
            eta=None if knowledge.eta is None else np.full(image.shape[-1], knowledge.eta),
            alpha=knowledge.alpha,
            light=None if knowledge.light is None else Distant.towards(knowledge.light),
        )
        if knowledge.normals is not None and knowledge.light is None:
            components, statements = _surrounded(observation, knowledge)
        else:
            chain = run_chain(observation, calibrated=False, separation=knowledge.separation)
            components, statements = chain.components, chain.statements
            warnings = chain.warnings
    except Inapplicable as reason:
        raise InputError(
            where, "a picture that this can be told from", str(reason), _advice(knowledge)
        ) from None
    if (invalid := components.invalid(mask)) > 0:
        flagged = f"{invalid} pixels of the object have no valid intensity or normal: not polarised"
        warnings = (*warnings, flagged)
    coloured = replace(
        components, image=image, s1=components.s1 * colour, s2=components.s2 * colour
    )
    return Estimate(coloured, (light.assumption, *statements), warnings)


def _advice(knowledge: Knowledge) -> str:
    missing = [name for name in ("normals", "mask", "light") if getattr(knowledge, name) is None]
    listed = ", ".join(f"`{name}`" for name in missing)
    return f"give {listed}" if missing else "give another picture or light"


def _surrounded(
    observation: Observation, knowledge: Knowledge
) -> tuple[Components, tuple[str, ...]]:
    """Components under light from all around, and what was assumed."""
    if knowledge.mirror:
        specular = np.where(observation.mask[..., None], observation.image, 0)
        statement = "all light is taken for mirrored"
    else:
        specular = separate(
            observation.image, observation.mask, method=knowledge.separation
        ).specular
        statement = "separated by colour, under light of one colour"
    eta, alpha = knowledge.eta or TYPICAL_ETA, knowledge.alpha or TYPICAL_ALPHA
    filled = replace(
        observation,
        specular=specular,
        diffuse=observation.image - specular,
        eta=np.full(observation.image.shape[-1], eta),
        alpha=alpha,
    )
    components = from_lobes(filled, microfacets("visible"), diffuse)
    return components, (statement, "light comes from all around", f"eta {eta:g}, alpha {alpha:g}")
