"""Materials and surfaces as a suite names them, and the surface of a scene made from both."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag

from malus.scenes.core.errors import InputError
from malus.scenes.core.model import Model
from malus.scenes.core.registry import lookup
from malus.scenes.materials.albedo import Albedo
from malus.scenes.materials.index import DielectricIndex, Extinction, MetalIndex
from malus.scenes.materials.materials import materials, surface, surfaces
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.metals import metals
from malus.scenes.materials.surface import (
    AnyAlpha,
    Body,
    Conductor,
    Dielectric,
    Distribution,
    Patterned,
    Surface,
)
from malus.scenes.shapes.patterns import Pattern


class RefractiveIndex(Model):
    """A material given by its refractive index alone: one for all bands, or one a band."""

    eta: DielectricIndex


class ComplexIndex(Model):
    """A metal given by its complex index `eta` + i `k` alone, each for all bands or one a band."""

    eta: MetalIndex
    k: Extinction


def _material_name(name: str) -> str:
    lookup(name, {**materials(), **metals()}, "material")
    return name


def _surface_name(name: str) -> str:
    lookup(name, surfaces(), "surface")
    return name


MaterialName = Annotated[str, AfterValidator(_material_name), Tag("name")]
SurfaceName = Annotated[str, AfterValidator(_surface_name), Tag("name")]


def _material_kind(value: Any) -> str | None:
    match value:
        case str():
            return "name"
        case Measured() | {"path": _}:
            return "measured"
        case ComplexIndex() | {"k": _}:
            return "metal"
        case RefractiveIndex() | dict():
            return "index"
    return None


_NAME_OR_INDEX = "a name, { eta = … } or { eta = …, k = … }"
ModelledMaterial = Annotated[
    MaterialName | Annotated[RefractiveIndex, Tag("index")] | Annotated[ComplexIndex, Tag("metal")],
    Discriminator(_material_kind, "choice", _NAME_OR_INDEX),
]
SuiteMaterial = Annotated[
    MaterialName
    | Annotated[RefractiveIndex, Tag("index")]
    | Annotated[ComplexIndex, Tag("metal")]
    | Annotated[Measured, Tag("measured")],
    Discriminator(_material_kind, "choice", f"{_NAME_OR_INDEX}, or {{ path = … }}"),
]


ALL_MATERIALS = BeforeValidator(lambda value: tuple(materials()) if value == "all" else value)
ALL_SURFACES = BeforeValidator(lambda value: tuple(surfaces()) if value == "all" else value)
"""Let `"all"` stand for every material, or surface, that malus brings."""


class Roughness(Model):
    """A surface given by its roughness and the albedo of the body below it.

    Two numbers as `alpha`, along dp/du and across, fit metals only.
    """

    alpha: AnyAlpha
    albedo: Albedo = 0.5
    distribution: Distribution = Field(
        default="beckmann", exclude_if=lambda name: name == "beckmann"
    )


def _surface_kind(value: Any) -> str | None:
    match value:
        case str():
            return "name"
        case PatternedSurface() | {"pattern": _} | {"parts": _}:
            return "patchwork"
        case PatternPart() | {"surface": _} | {"material": _}:
            return "part"
        case Roughness() | dict():
            return "roughness"
    return None


def _whole_surface_kind(value: Any) -> str | None:
    """As `_surface_kind` where no part can stand: `material` is a key too many there."""
    kind = _surface_kind(value)
    return "roughness" if kind == "part" else kind


SuiteUniformSurface = Annotated[
    SurfaceName | Annotated[Roughness, Tag("roughness")],
    Discriminator(_whole_surface_kind, "choice", "a name or { alpha = … }"),
]


class PatternPart(Model):
    """One surface of a pattern, of the scene's material unless it names its own."""

    surface: SuiteUniformSurface
    material: ModelledMaterial | None = None


class PatternedSurface(Model):
    """Several surfaces on one object, distributed by a pattern."""

    pattern: Pattern
    parts: tuple[
        Annotated[
            SurfaceName
            | Annotated[Roughness, Tag("roughness")]
            | Annotated[PatternPart, Tag("part")],
            Discriminator(_surface_kind, "choice", "a name, { alpha = … } or { surface = … }"),
        ],
        ...,
    ] = Field(min_length=2, max_length=8)


SuiteSurface = Annotated[
    SurfaceName
    | Annotated[Roughness, Tag("roughness")]
    | Annotated[PatternedSurface, Tag("patchwork")],
    Discriminator(
        _whole_surface_kind, "choice", "a name, { alpha = … } or { pattern = …, parts = […] }"
    ),
]


def scene_surface(material: SuiteMaterial, suite_surface: SuiteSurface, body: Body) -> Surface:
    """The surface of a scene from a suite's material, surface and body.

    A metal ignores the body, a measured material ignores the surface and the body.

    Examples
    --------
    >>> scene_surface("gold", "carbon", "polarised").kind
    'conductor'
    """
    if isinstance(material, Measured):
        return material
    if not isinstance(suite_surface, PatternedSurface):
        return _uniform_surface(material, suite_surface, body)
    parts = [_pattern_part(part) for part in suite_surface.parts]
    surfaces = [_uniform_surface(part.material or material, part.surface, body) for part in parts]
    return Patterned(pattern=suite_surface.pattern, surfaces=tuple(surfaces))


def _pattern_part(part: PatternPart | str | Roughness) -> PatternPart:
    return part if isinstance(part, PatternPart) else PatternPart(surface=part)


def _uniform_surface(
    material: ModelledMaterial, suite_surface: str | Roughness, body: Body
) -> Dielectric | Conductor:
    rough = surface(suite_surface) if isinstance(suite_surface, str) else suite_surface
    made_of = {"material": material} if isinstance(material, str) else material.model_dump()
    name = suite_surface if isinstance(suite_surface, str) else None
    coat = made_of | {"roughness": name, "alpha": rough.alpha}
    if isinstance(rough, Roughness):
        coat["distribution"] = rough.distribution
    if is_metal(material):
        return Conductor(**coat)
    if isinstance(rough.alpha, tuple):
        hint = "choose metals, or one number as alpha"
        raise InputError(f"alpha {list(rough.alpha)}", "metals only", "a dielectric", hint)
    return Dielectric(**coat, albedo=rough.albedo, body=body)


def is_metal(material: SuiteMaterial) -> bool:
    """Whether a suite's material is a metal that is given by its index.

    Examples
    --------
    >>> is_metal("gold"), is_metal("water")
    (True, False)
    """
    return isinstance(material, ComplexIndex) or material in metals()


def stand_in(materials: Iterable[SuiteMaterial]) -> ModelledMaterial:
    """A material of any wavelength that surfaces have to fit: a metal where no other is meant."""
    others = [item for item in materials if not isinstance(item, Measured)]
    if others and all(map(is_metal, others)):
        return ComplexIndex(eta=1.5, k=1.0)
    return RefractiveIndex(eta=1.5)
