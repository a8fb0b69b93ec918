"""Materials and surfaces as the axes of a suite name them."""

from __future__ import annotations

from pydantic import Field

from malus.scenes.albedo import Albedo
from malus.scenes.materials import material, surface
from malus.scenes.metals import metals
from malus.scenes.model import Model
from malus.scenes.surface import Body, Conductor, Dielectric


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


def known(substance: Substance) -> None:
    """Check a material's name.

    Raises
    ------
    InputError
        If it is neither a dielectric nor a metal.
    """
    if isinstance(substance, str) and substance not in metals():
        material(substance)


def coated(substance: Substance, rough: str | Roughness, body: Body) -> Dielectric | Conductor:
    """The surface of a scene; a metal has no body.

    Examples
    --------
    >>> coated("gold", "carbon", "polarised").kind
    'conductor'
    """
    name = rough if isinstance(rough, str) else None
    finish = surface(rough) if isinstance(rough, str) else rough
    made_of = {"material": substance} if isinstance(substance, str) else substance.model_dump()
    coat = made_of | {"roughness": name, "alpha": finish.alpha}
    if isinstance(substance, MetalIndex) or substance in metals():
        return Conductor(**coat)
    return Dielectric(**coat, albedo=finish.albedo, body=body)
