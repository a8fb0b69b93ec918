"""Surfaces of a scene's objects: dielectric, conductor, measured, or several in a pattern."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag, model_validator

from malus.scenes.core.arrays import Float64Array, NumberArray
from malus.scenes.core.model import Model
from malus.scenes.materials.albedo import Albedo, reflectance
from malus.scenes.materials.index import (
    DielectricIndex,
    Extinction,
    MetalIndex,
    index_by_band,
    index_label,
)
from malus.scenes.materials.materials import material, surface
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.metals import metal
from malus.scenes.shapes.patterns import Pattern

Distribution = Literal["beckmann", "ggx"]
"""Distribution of the normals of a rough surface's facets."""

Alpha = Annotated[float, Field(gt=0, le=1)]


def _kind_of_alpha(value: Any) -> str | None:
    match value:
        case int() | float():
            return "isotropic"
        case tuple() | list():
            return "anisotropic"
    return None


AnyAlpha = Annotated[
    Annotated[Alpha, Tag("isotropic")] | Annotated[tuple[Alpha, Alpha], Tag("anisotropic")],
    Discriminator(_kind_of_alpha, "choice", "a number, or two for a metal, [u, v]"),
]
"""Roughness: the same all around, or along dp/du of the surface and across it."""

Body = Literal["unpolarised", "polarised"]
AnyBody = Literal["unpolarised", "polarised", "none"]
"""How the body below the surface scatters light; a conductor has none."""

_OTHER_BODIES = {"none": "no body (metal)", "mixed": "mixed bodies"}


def body_text(body: str) -> str:
    """A body as text for readers: a metal has none, and surfaces that differ may have several.

    Examples
    --------
    >>> body_text("polarised"), body_text("none"), body_text("mixed")
    ('polarised body', 'no body (metal)', 'mixed bodies')
    """
    return _OTHER_BODIES.get(body, f"{body} body")


class Facets(NamedTuple):
    """How a surface's facets stand: roughness along dp/du and across, and distribution."""

    alphas: tuple[float, float]
    distribution: Distribution = "beckmann"


class RoughSurface(Model):
    """Base of rough surfaces: how their facets are distributed, and the name of the roughness.

    `distribution` is that of the facets' normals: "beckmann" (Gaussian slopes) or "ggx" (Trowbridge
    and Reitz, JOSA 65, 1975), which has more of steep facets.
    """

    roughness: str | None = None
    distribution: Distribution = Field(
        default="beckmann", exclude_if=lambda name: name == "beckmann"
    )

    @property
    def alphas(self) -> tuple[float, float]:
        """Roughness along dp/du and across it, on the surface; equal where it is isotropic."""
        raise NotImplementedError

    @property
    def facets(self) -> Facets:
        """Roughness and distribution of the facets."""
        return Facets(self.alphas, self.distribution)

    @property
    def isotropic_alpha(self) -> float:
        """The one roughness that methods are told: √(α_u α_v), of as many facets per slope."""
        along, across = self.alphas
        return along if along == across else math.sqrt(along * across)

    @property
    def sigma(self) -> float:
        """Exponent σ = 1/α² of the paper's Equation 2."""
        return 1.0 / self.isotropic_alpha**2

    @property
    def label(self) -> str:
        """Name of the roughness in tables, with the distribution unless it is Beckmann's."""
        along, across = self.alphas
        number = f"{along:g}" if along == across else f"{along:g} x {across:g}"
        name = self.roughness or f"alpha {number}"
        return name if self.distribution == "beckmann" else f"{self.distribution} {name}"


class Dielectric(RoughSurface):
    """A rough dielectric over a body that scatters.

    Exactly one of `material` (a name with dispersion) and `eta` (the relative index: a number for
    all bands, or one a band). `alpha` is the roughness of its facets, `albedo` the reflectance of
    the body below the surface: a number, the name of a swatch, or one number a band. An
    `unpolarised` body is Lambertian: the paper's assumption.

    Examples
    --------
    >>> Dielectric(eta=1.5, alpha=0.3, albedo="red", body="polarised").label
    'alpha 0.3, red'
    """

    kind: Literal["dielectric"] = "dielectric"
    material: str | None = None
    eta: DielectricIndex | None = None
    alpha: Alpha
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
    def alphas(self) -> tuple[float, float]:
        """The roughness, twice: facets of a dielectric are the same all around."""
        return self.alpha, self.alpha

    @property
    def label(self) -> str:
        """Name of the roughness in tables, with the body's colour where it has one."""
        name = super().label
        if isinstance(self.albedo, float):
            return name
        return f"{name}, {self.albedo if isinstance(self.albedo, str) else 'coloured'}"

    @property
    def material_label(self) -> str:
        """Name of the material in tables."""
        return self.material or f"eta {index_label(self.eta or math.nan)}"

    def indices(self, wavelengths_nm: tuple[float, ...]) -> Float64Array:
        """Relative refractive index of every band.

        Examples
        --------
        >>> Dielectric(eta=1.5, alpha=0.3).indices((450.0, 550.0)).tolist()
        [1.5, 1.5]
        """
        if self.material is None:
            return index_by_band("eta", self.eta or math.nan, wavelengths_nm)
        return material(self.material).eta(np.asarray(wavelengths_nm))

    def albedos(self, wavelengths_nm: tuple[float, ...]) -> Float64Array:
        """Reflectance of the body in every band.

        Examples
        --------
        >>> Dielectric(eta=1.5, alpha=0.3, albedo="blue").albedos((450.0, 650.0)).tolist()
        [0.309, 0.042]
        """
        return reflectance(self.albedo, wavelengths_nm)

    @classmethod
    def named(cls, material: str, roughness: str, body: Body) -> Self:
        """A surface from the names of one of the 24 materials and one of the 5 surfaces.

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


class Conductor(RoughSurface):
    """A rough metal: all reflected light is specular, and there is no body.

    Either `material`, a metal with dispersion, or a complex index `eta` + i `k`, each a number for
    all bands or one a band.
    `alpha` is the roughness of its facets, or two of them, as of brushed metal: along the tangent
    dp/du of the shape, as Mitsuba has it, and across. On a sphere dp/du runs around its z axis, the
    world's; on a plane, along its x axis; on a mesh file, along the first texture coordinate. The
    projection of dp/du perpendicular to the shading normal counts.

    Examples
    --------
    >>> Conductor(material="gold", alpha=0.2).body
    'none'
    """

    kind: Literal["conductor"] = "conductor"
    material: str | None = None
    eta: MetalIndex | None = None
    k: Extinction | None = None
    alpha: AnyAlpha

    @model_validator(mode="after")
    def _one_index(self) -> Self:
        numbers = (self.eta is not None, self.k is not None)
        if numbers not in ((True, True), (False, False)) or all(numbers) == bool(self.material):
            raise ValueError("either material, or eta and k")
        if self.material is not None:
            metal(self.material)
        return self

    @property
    def alphas(self) -> tuple[float, float]:
        """Roughness along dp/du and across it; equal where it is isotropic."""
        return self.alpha if isinstance(self.alpha, tuple) else (self.alpha, self.alpha)

    @property
    def body(self) -> AnyBody:
        """'none': no light comes back from inside a metal."""
        return "none"

    @property
    def material_label(self) -> str:
        """Name of the material in tables."""
        if self.eta is None or self.k is None:
            return str(self.material)
        return f"eta {index_label(self.eta)} + {index_label(self.k)}i"

    def indices(self, wavelengths_nm: tuple[float, ...]) -> NDArray[np.complex128]:
        """Complex index n + ik of every band.

        Examples
        --------
        >>> Conductor(eta=0.2, k=3.0, alpha=0.1).indices((450.0, 550.0)).tolist()
        [(0.2+3j), (0.2+3j)]
        """
        if self.material is not None:
            return metal(self.material).eta(wavelengths_nm)
        assert self.eta is not None
        assert self.k is not None
        real = index_by_band("eta", self.eta, wavelengths_nm)
        return real + 1j * index_by_band("k", self.k, wavelengths_nm)

    def albedos(self, wavelengths_nm: tuple[float, ...]) -> Float64Array:
        """Zeros (bands,): there is no diffuse light."""
        return np.zeros(len(wavelengths_nm))


def _kind(value: Any) -> Any:
    if isinstance(value, dict):
        return value.get("kind", "dielectric")
    return getattr(value, "kind", None)


UniformSurface = Annotated[
    Annotated[Dielectric, Tag("dielectric")] | Annotated[Conductor, Tag("conductor")],
    Discriminator(_kind),
]
"""A surface of one material, roughness and colour."""


class Patterned(Model):
    """Several surfaces on one object, distributed by a pattern.

    Examples
    --------
    >>> from malus.scenes import Stripes
    >>> parts = (Dielectric(eta=1.5, alpha=0.1), Dielectric(eta=1.5, alpha=0.4))
    >>> Patterned(pattern=Stripes(), surfaces=parts).label
    'stripes y of alpha 0.1 and alpha 0.4'
    """

    kind: Literal["patterned"] = "patterned"
    pattern: Pattern
    surfaces: tuple[UniformSurface, ...] = Field(min_length=2, max_length=8)

    @property
    def label(self) -> str:
        """Pattern and roughnesses in tables."""
        return f"{self.pattern.label} of {' and '.join(part.label for part in self.surfaces)}"

    @property
    def material_label(self) -> str:
        """Names of the materials in tables."""
        return " and ".join(dict.fromkeys(part.material_label for part in self.surfaces))

    @property
    def roughness(self) -> None:
        """None: there are several."""

    @property
    def alpha(self) -> float:
        """Mean roughness, for tables; a truth's `alpha` has that of every pixel."""
        return float(np.mean([part.isotropic_alpha for part in self.surfaces]))

    @property
    def isotropic_alpha(self) -> float:
        """`alpha`."""
        return self.alpha

    @property
    def distribution(self) -> Distribution | None:
        """Distribution of the facets of all surfaces, None where they differ."""
        names = {part.distribution for part in self.surfaces}
        return names.pop() if len(names) == 1 else None

    @property
    def body(self) -> str:
        """The body of all surfaces, or 'mixed' where they differ."""
        bodies = {part.body for part in self.surfaces}
        return bodies.pop() if len(bodies) == 1 else "mixed"

    def indices(self, wavelengths_nm: tuple[float, ...]) -> NumberArray:
        """Mean index of every band, for tables; a truth's `eta` has that of every pixel."""
        indices = [part.indices(wavelengths_nm) for part in self.surfaces]
        return np.asarray(np.mean(indices, axis=0))

    def albedos(self, wavelengths_nm: tuple[float, ...]) -> Float64Array:
        """Mean albedo of every band."""
        albedos = [part.albedos(wavelengths_nm) for part in self.surfaces]
        return np.asarray(np.mean(albedos, axis=0))


Surface = Annotated[
    Annotated[Dielectric, Tag("dielectric")]
    | Annotated[Conductor, Tag("conductor")]
    | Annotated[Measured, Tag("measured")]
    | Annotated[Patterned, Tag("patterned")],
    Discriminator(_kind),
]


def surfaces_on(surface: Surface) -> tuple[Dielectric | Conductor | Measured, ...]:
    """The surfaces of an object: one, or those of its pattern."""
    return surface.surfaces if isinstance(surface, Patterned) else (surface,)


def has_metal(surface: Surface) -> bool:
    """Whether a surface, or any part of it, is a metal given by its index.

    Examples
    --------
    >>> has_metal(Conductor(material="gold", alpha=0.1))
    True
    """
    return any(isinstance(part, Conductor) for part in surfaces_on(surface))


def by_band(surface: Surface) -> bool:
    """Whether the index of a surface, or of any part of it, is given as numbers, one a band.

    Examples
    --------
    >>> by_band(Dielectric(eta=(1.52, 1.51), alpha=0.1)), by_band(Dielectric(eta=1.5, alpha=0.1))
    (True, False)
    """
    if isinstance(surface, Patterned):
        return any(map(by_band, surface.surfaces))
    given = surface.eta, getattr(surface, "k", None)
    return any(isinstance(number, tuple) for number in given)


def anisotropic(surface: Surface) -> bool:
    """Whether the roughness of a surface, or of any part of it, depends on the direction.

    Examples
    --------
    >>> anisotropic(Conductor(material="gold", alpha=(0.1, 0.4)))
    True
    """
    parts = surfaces_on(surface)
    return any(isinstance(part, Conductor) and isinstance(part.alpha, tuple) for part in parts)
