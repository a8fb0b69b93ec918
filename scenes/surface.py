"""Surfaces: what a scene's object is made of."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from malus.scenes.albedo import Albedo, reflectance
from malus.scenes.materials import material, surface
from malus.scenes.model import Model

Body = Literal["unpolarised", "polarised"]


class Dielectric(Model):
    """A rough dielectric over a body that scatters.

    Exactly one of `material` (a name with dispersion) and `eta` (one relative index for every
    band). `alpha` is the Beckmann roughness, `albedo` the reflectance of the body inside the
    interface: a number, the name of a swatch, or one number a band. An `unpolarised` body is
    Lambertian: the paper's assumption.
    """

    kind: Literal["dielectric"] = "dielectric"
    material: str | None = None
    eta: float | None = Field(default=None, gt=1, le=4)
    roughness: str | None = None
    alpha: float = Field(gt=0, le=1)
    albedo: Albedo = 0.5
    body: Body = "polarised"

    @model_validator(mode="after")
    def _one_index(self) -> Self:
        if (self.material is None) == (self.eta is None):
            raise ValueError("exactly one of material and eta")
        if self.material is not None:
            material(self.material)
        return self

    @property
    def sigma(self) -> float:
        """Exponent σ = 1/m² of the paper's Equation 2."""
        return 1.0 / self.alpha**2

    @property
    def label(self) -> str:
        """Name of the roughness in tables, with the body's colour where it has one."""
        name = self.roughness or f"alpha {self.alpha:g}"
        if isinstance(self.albedo, float):
            return name
        return f"{name}, {self.albedo if isinstance(self.albedo, str) else 'coloured'}"

    @property
    def material_label(self) -> str:
        """Name of the material in tables."""
        return self.material or f"eta {self.eta:g}"

    def indices(self, wavelengths_nm: tuple[float, ...]) -> NDArray[np.float64]:
        """Relative refractive index of every band.

        Examples
        --------
        >>> Dielectric(eta=1.5, alpha=0.3).indices((450.0, 550.0)).tolist()
        [1.5, 1.5]
        """
        if self.material is None:
            return np.full(len(wavelengths_nm), self.eta, dtype=np.float64)
        return material(self.material).eta(np.asarray(wavelengths_nm))

    def albedos(self, wavelengths_nm: tuple[float, ...]) -> NDArray[np.float64]:
        """Reflectance of the body in every band.

        Examples
        --------
        >>> Dielectric(eta=1.5, alpha=0.3, albedo="blue").albedos((450.0, 650.0)).tolist()
        [0.309, 0.042]
        """
        return reflectance(self.albedo, wavelengths_nm)

    @classmethod
    def named(cls, material: str, roughness: str, body: Body) -> Self:
        """One of the suite's 24 materials with one of its 5 surfaces.

        Examples
        --------
        >>> Dielectric.named("water", "carbon", "polarised").alpha
        0.4
        """
        rough = surface(roughness)
        return cls(
            material=material,
            roughness=roughness,
            alpha=rough.alpha,
            albedo=rough.albedo,
            body=body,
        )
