"""A scene: what to look at, as plain frozen data."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from malus.scenes.materials import material, surface
from malus.scenes.model import Model

Body = Literal["unpolarised", "polarised"]
Shading = Literal["smooth", "flat", "file"]


class Sphere(Model):
    """The unit sphere, intersected analytically."""

    kind: Literal["sphere"] = "sphere"

    @property
    def label(self) -> str:
        """Name in tables."""
        return self.kind


class Torus(Model):
    """A torus about the viewing axis, tilted; radii before scaling to the unit sphere."""

    kind: Literal["torus"] = "torus"
    major: float = Field(default=0.7, gt=0, le=1)
    minor: float = Field(default=0.3, gt=0, le=1)
    tilt_deg: float = Field(default=50.0, ge=-180, le=180)

    @model_validator(mode="after")
    def _ring(self) -> Self:
        if self.minor >= self.major:
            raise ValueError("minor radius below the major one")
        return self

    @property
    def label(self) -> str:
        """Name in tables."""
        return self.kind


class Blob(Model):
    """A smooth closed star-shaped blob with exact normals."""

    kind: Literal["blob"] = "blob"
    seed: int = Field(default=0, ge=0)

    @property
    def label(self) -> str:
        """Name in tables."""
        return self.kind if self.seed == 0 else f"{self.kind}-{self.seed}"


class Superquadric(Model):
    """A superquadric with exact normals; exponents of 1 make a sphere."""

    kind: Literal["superquadric"] = "superquadric"
    e1: float = Field(default=0.5, ge=0.1, le=2)
    e2: float = Field(default=0.5, ge=0.1, le=2)

    @property
    def label(self) -> str:
        """Name in tables."""
        return f"{self.kind}-{self.e1:g}-{self.e2:g}"


class MeshFile(Model):
    """A mesh file, centred and scaled to the unit sphere; `digest` is the hash of its bytes."""

    kind: Literal["mesh"] = "mesh"
    path: str = Field(min_length=1)
    shading: Shading = "smooth"
    digest: str = ""

    @property
    def label(self) -> str:
        """Name in tables: the file's name without its folder and suffix."""
        return self.path.replace("\\", "/").rsplit("/", 1)[-1].rsplit(".", 1)[0]


Shape = Annotated[
    Sphere | Torus | Blob | Superquadric | MeshFile, Field(discriminator="kind")
]


class Uniform(Model):
    """Unpolarised light of equal radiance from every direction."""

    kind: Literal["uniform"] = "uniform"
    radiance: float = Field(default=1.0, gt=0)

    @property
    def label(self) -> str:
        """Name in tables."""
        return self.kind


class Distant(Model):
    """Unpolarised parallel light.

    `incidence_deg` is the angle between the direction to the light and the viewer, `azimuth_deg`
    that of its projection on the image, anticlockwise from +x. An irradiance of π makes a white
    Lambertian surface that faces the light as bright as under the uniform light of radiance 1.
    """

    kind: Literal["distant"] = "distant"
    incidence_deg: float = Field(ge=0, lt=180)
    azimuth_deg: float = Field(default=35.0, ge=-360, le=360)
    irradiance: float = Field(default=math.pi, gt=0)

    @property
    def label(self) -> str:
        """Name in tables."""
        return f"distant {self.incidence_deg:g}°"

    @property
    def direction(self) -> tuple[float, float, float]:
        """Unit vector towards the light in the image frame.

        Examples
        --------
        >>> Distant(incidence_deg=90, azimuth_deg=90).direction[1]
        1.0
        """
        incidence, azimuth = math.radians(self.incidence_deg), math.radians(self.azimuth_deg)
        sine = math.sin(incidence)
        return sine * math.cos(azimuth), sine * math.sin(azimuth), math.cos(incidence)


Light = Annotated[Uniform | Distant, Field(discriminator="kind")]


class Dielectric(Model):
    """A rough dielectric over a body that scatters.

    Exactly one of `material` (a name with dispersion) and `eta` (one relative index for every
    band). `alpha` is the Beckmann roughness, `albedo` the reflectance of the body inside the
    interface. An `unpolarised` body is Lambertian: the paper's assumption.
    """

    kind: Literal["dielectric"] = "dielectric"
    material: str | None = None
    eta: float | None = Field(default=None, gt=1, le=4)
    roughness: str | None = None
    alpha: float = Field(gt=0, le=1)
    albedo: float = Field(default=0.5, ge=0, le=1)
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
        """Name of the roughness in tables."""
        return self.roughness or f"alpha {self.alpha:g}"

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


class Camera(Model):
    """An orthographic camera on +z that frames the unit sphere; square images."""

    resolution: int = Field(default=128, ge=1, le=8192)
    half_width: float = Field(default=1.05, gt=0)


def _increasing(wavelengths_nm: tuple[float, ...]) -> tuple[float, ...]:
    if any(b <= a for a, b in zip(wavelengths_nm, wavelengths_nm[1:], strict=False)):
        raise ValueError("wavelengths in increasing order")
    return wavelengths_nm


Wavelength = Annotated[float, Field(gt=100, lt=20_000)]
Wavelengths = Annotated[
    tuple[Wavelength, ...], Field(min_length=1, max_length=512), AfterValidator(_increasing)
]


class Scene(Model):
    """What to look at: shape, surface, light, camera and the centres of narrow bands in nm.

    Examples
    --------
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3), light=Uniform())
    >>> len(scene.id)
    16
    """

    shape: Shape
    surface: Dielectric
    light: Light
    camera: Camera = Camera()
    wavelengths_nm: Wavelengths = (550.0,)

    @property
    def eta(self) -> NDArray[np.float64]:
        """Relative refractive index of every band, shape (bands,)."""
        return self.surface.indices(self.wavelengths_nm)


class Sampling(Model):
    """Monte Carlo effort: samples a pixel (even, for two independent halves) and the seed."""

    samples: int = Field(default=64, ge=2, le=1 << 20, multiple_of=2)
    seed: int = Field(default=1, ge=0, lt=1 << 31)
