"""Shapes of objects, all of which fit the unit sphere at the origin."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from malus.scenes.core.model import Model
from malus.scenes.core.named_file import NamedFile


class Crease(Model):
    """Normals that are smooth but for edges whose two faces turn by more than an angle.

    Examples
    --------
    >>> Crease(crease_deg=40).crease_deg
    40.0
    """

    crease_deg: float = Field(gt=0, lt=180)


Shading = Literal["smooth", "flat", "file"] | Crease
Axis = Literal["x", "y", "z"]
Stretch = Annotated[float, Field(ge=0.02, le=1)]


class Sphere(Model):
    """The unit sphere, intersected analytically.

    Examples
    --------
    >>> Sphere().label
    'sphere'
    """

    kind: Literal["sphere"] = "sphere"

    @property
    def label(self) -> str:
        """Name in tables."""
        return self.kind


class Torus(Model):
    """A torus about the viewing axis, tilted; radii before scaling to the unit sphere.

    Examples
    --------
    >>> Torus(tilt_deg=30).label
    'torus'
    """

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
    """A smooth closed star-shaped blob with exact normals.

    Examples
    --------
    >>> Blob(seed=2).label
    'blob-2'
    """

    kind: Literal["blob"] = "blob"
    seed: int = Field(default=0, ge=0)

    @property
    def label(self) -> str:
        """Name in tables."""
        return self.kind if self.seed == 0 else f"{self.kind}-{self.seed}"


class Superquadric(Model):
    """A superquadric with exact normals; exponents of 1 make a sphere.

    `stretch` are the factors of its three axes, whose ratios alone count: it is scaled to the unit
    sphere.

    Examples
    --------
    >>> Superquadric(e1=0.5, e2=1).label
    'superquadric-0.5-1'
    """

    kind: Literal["superquadric"] = "superquadric"
    e1: float = Field(default=0.5, ge=0.1, le=2)
    e2: float = Field(default=0.5, ge=0.1, le=2)
    stretch: tuple[Stretch, Stretch, Stretch] = Field(
        default=(1.0, 1.0, 1.0), exclude_if=lambda stretch: stretch == (1.0, 1.0, 1.0)
    )

    @property
    def label(self) -> str:
        """Name in tables."""
        name = f"{self.kind}-{self.e1:g}-{self.e2:g}"
        if self.stretch == (1.0, 1.0, 1.0):
            return name
        return f"{name} {' x '.join(f'{part:g}' for part in self.stretch)}"


class Lathe(Model):
    """A turned object of a profile drawn at random: bottle, vase and pot, or bowl, cup and glass.

    Its axis is the vertical, its normals are exact: see `malus.scenes.shapes.lathe`.

    Examples
    --------
    >>> Lathe(seed=2).label
    'lathe-2'
    """

    kind: Literal["lathe"] = "lathe"
    seed: int = Field(default=0, ge=0)

    @property
    def label(self) -> str:
        """Name in tables."""
        return self.kind if self.seed == 0 else f"{self.kind}-{self.seed}"


class MeshFile(NamedFile):
    """A mesh file, centred and scaled to the unit sphere; `digest` is the hash of its bytes.

    `up` is the axis of the file that stands upright in the scene. From files with z upright, as CAD
    and Blender have them, one looks along +y, at what these programs call the front. Units mean
    nothing, because every size becomes that of the unit sphere.

    Its normals are by default averages that do not cross edges of more than 40°. On a block of CAD
    the averages over all faces are 38° off (root mean square over the surface), on a cylinder of
    48 sides 30°, and these 0° and 0.6°; on a scan of 2900 points with few sharp edges both are
    about 2° from the surface refined by Loop's rule.

    Examples
    --------
    >>> MeshFile(path="vase.obj").label
    'vase'
    """

    kind: Literal["mesh"] = "mesh"
    path: str = Field(min_length=1)
    shading: Shading = Crease(crease_deg=40)
    up: Axis = Field(default="y", exclude_if=lambda axis: axis == "y")
    file_kind: ClassVar[str] = "mesh file"

    @property
    def file_name(self) -> str:
        """The file's path."""
        return self.path

    @property
    def label(self) -> str:
        """Name in tables: the file's name without its folder and suffix."""
        return self.path.replace("\\", "/").rsplit("/", 1)[-1].rsplit(".", 1)[0]


class Plane(Model):
    """A square of half width 1 that faces up (+y): a floor, or tilted by 90° a wall.

    Examples
    --------
    >>> Plane().label
    'plane'
    """

    kind: Literal["plane"] = "plane"

    @property
    def label(self) -> str:
        """Name in tables."""
        return self.kind


Shape = Annotated[
    Sphere | Torus | Blob | Superquadric | Lathe | MeshFile, Field(discriminator="kind")
]
ShapeOrPlane = Annotated[
    Sphere | Torus | Blob | Superquadric | Lathe | MeshFile | Plane, Field(discriminator="kind")
]

CONVEX = frozenset({"sphere"})
"""Kinds of shape that cast neither shadow nor light on themselves."""
