"""Materials and surfaces as the axes of a suite name them."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import Field

from malus.scenes.albedo import Albedo
from malus.scenes.materials import material, surface
from malus.scenes.metals import metals
from malus.scenes.model import Model
from malus.scenes.patterns import Pattern
from malus.scenes.surface import Body, Conductor, Dielectric, Patterned, Surface


class Index(Model):
    """A material that is only a refractive index, the same in every band."""

    eta: float = Field(gt=1, le=4)


class MetalIndex(Model):
    """A metal that is only a complex index `eta` + i `k`, the same in every band."""

    eta: float = Field(gt=0, le=20)
    k: float = Field(ge=0, le=20)


Substance = str | Index | MetalIndex


class Roughness(Model):
    """A surface that is only a roughness and the albedo of the body below it."""

    alpha: float = Field(gt=0, le=1)
    albedo: Albedo = 0.5


class Part(Model):
    """One surface of a pattern; without a material of its own it has the scene's."""

    surface: str | Roughness
    material: Substance | None = None


class Patchwork(Model):
    """Several surfaces on one object, where a pattern puts them."""

    pattern: Pattern
    parts: tuple[Part | str | Roughness, ...] = Field(min_length=2, max_length=8)


Finish = str | Roughness | Patchwork


def known_names(substances: Iterable[Substance], finishes: Iterable[Finish]) -> None:
    """Check names of materials and surfaces.

    Raises
    ------
    InputError
        If a material is neither a dielectric nor a metal, or a surface is none.
    """
    for substance in substances:
        if isinstance(substance, str) and substance not in metals():
            material(substance)
    for finish in finishes:
        if isinstance(finish, str):
            surface(finish)
        elif isinstance(finish, Patchwork):
            parts = [_part(part) for part in finish.parts]
            named = [part.material for part in parts if part.material is not None]
            known_names(named, [part.surface for part in parts])


def coated(substance: Substance, finish: Finish, body: Body) -> Surface:
    """The surface of a scene; a metal has no body.

    Examples
    --------
    >>> coated("gold", "carbon", "polarised").kind
    'conductor'
    """
    if not isinstance(finish, Patchwork):
        return _plain(substance, finish, body)
    parts = [_part(part) for part in finish.parts]
    surfaces = [_plain(part.material or substance, part.surface, body) for part in parts]
    return Patterned(pattern=finish.pattern, surfaces=tuple(surfaces))


def _part(part: Part | str | Roughness) -> Part:
    return part if isinstance(part, Part) else Part(surface=part)


def _plain(substance: Substance, finish: str | Roughness, body: Body) -> Dielectric | Conductor:
    rough = surface(finish) if isinstance(finish, str) else finish
    made_of = {"material": substance} if isinstance(substance, str) else substance.model_dump()
    name = finish if isinstance(finish, str) else None
    coat = made_of | {"roughness": name, "alpha": rough.alpha}
    if isinstance(substance, MetalIndex) or substance in metals():
        return Conductor(**coat)
    return Dielectric(**coat, albedo=rough.albedo, body=body)
