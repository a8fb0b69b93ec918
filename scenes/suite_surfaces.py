"""Materials and surfaces as the axes of a suite name them."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, Tag

from malus.scenes.core.model import Model
from malus.scenes.core.registry import lookup
from malus.scenes.materials.albedo import Albedo
from malus.scenes.materials.materials import materials, surface, surfaces
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.metals import metals
from malus.scenes.materials.surface import Body, Conductor, Dielectric, Patterned, Surface
from malus.scenes.shapes.patterns import Pattern


class Index(Model):
    """A material that is only a refractive index, the same in every band."""

    eta: float = Field(gt=1, le=4)


class MetalIndex(Model):
    """A metal that is only a complex index `eta` + i `k`, the same in every band."""

    eta: float = Field(gt=0, le=20)
    k: float = Field(ge=0, le=20)


def _material_name(name: str) -> str:
    lookup(name, {**materials(), **metals()}, "material")
    return name


def _surface_name(name: str) -> str:
    lookup(name, surfaces(), "surface")
    return name


SubstanceName = Annotated[str, AfterValidator(_material_name), Tag("name")]
FinishName = Annotated[str, AfterValidator(_surface_name), Tag("name")]


def _substance(value: Any) -> str | None:
    match value:
        case str():
            return "name"
        case Measured() | {"path": _}:
            return "measured"
        case MetalIndex() | {"k": _}:
            return "metal"
        case Index() | dict():
            return "index"
    return None


_INDICES = "a name, { eta = … } or { eta = …, k = … }"
Modelled = Annotated[
    SubstanceName | Annotated[Index, Tag("index")] | Annotated[MetalIndex, Tag("metal")],
    Discriminator(_substance, "choice", _INDICES),
]
Substance = Annotated[
    SubstanceName
    | Annotated[Index, Tag("index")]
    | Annotated[MetalIndex, Tag("metal")]
    | Annotated[Measured, Tag("measured")],
    Discriminator(_substance, "choice", f"{_INDICES}, or {{ path = … }}"),
]


class Roughness(Model):
    """A surface that is only a roughness and the albedo of the body below it."""

    alpha: float = Field(gt=0, le=1)
    albedo: Albedo = 0.5


def _finish(value: Any) -> str | None:
    match value:
        case str():
            return "name"
        case Patchwork() | {"pattern": _} | {"parts": _}:
            return "patchwork"
        case Part() | {"surface": _} | {"material": _}:
            return "part"
        case Roughness() | dict():
            return "roughness"
    return None


PlainFinish = Annotated[
    FinishName | Annotated[Roughness, Tag("roughness")],
    Discriminator(_finish, "choice", "a name or { alpha = … }"),
]


class Part(Model):
    """One surface of a pattern; without a material of its own it has the scene's."""

    surface: PlainFinish
    material: Modelled | None = None


class Patchwork(Model):
    """Several surfaces on one object, where a pattern puts them."""

    pattern: Pattern
    parts: tuple[
        Annotated[
            FinishName | Annotated[Roughness, Tag("roughness")] | Annotated[Part, Tag("part")],
            Discriminator(_finish, "choice", "a name, { alpha = … } or { surface = … }"),
        ],
        ...,
    ] = Field(min_length=2, max_length=8)


Finish = Annotated[
    FinishName | Annotated[Roughness, Tag("roughness")] | Annotated[Patchwork, Tag("patchwork")],
    Discriminator(_finish, "choice", "a name, { alpha = … } or { pattern = …, parts = […] }"),
]


def coated(substance: Substance, finish: Finish, body: Body) -> Surface:
    """The surface of a scene; a metal has no body, and no finish changes what was measured.

    Examples
    --------
    >>> coated("gold", "carbon", "polarised").kind
    'conductor'
    """
    if isinstance(substance, Measured):
        return substance
    if not isinstance(finish, Patchwork):
        return _plain(substance, finish, body)
    parts = [_part(part) for part in finish.parts]
    surfaces = [_plain(part.material or substance, part.surface, body) for part in parts]
    return Patterned(pattern=finish.pattern, surfaces=tuple(surfaces))


def _part(part: Part | str | Roughness) -> Part:
    return part if isinstance(part, Part) else Part(surface=part)


def _plain(substance: Modelled, finish: str | Roughness, body: Body) -> Dielectric | Conductor:
    rough = surface(finish) if isinstance(finish, str) else finish
    made_of = {"material": substance} if isinstance(substance, str) else substance.model_dump()
    name = finish if isinstance(finish, str) else None
    coat = made_of | {"roughness": name, "alpha": rough.alpha}
    if isinstance(substance, MetalIndex) or substance in metals():
        return Conductor(**coat)
    return Dielectric(**coat, albedo=rough.albedo, body=body)
