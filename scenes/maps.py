"""Maps that a dataset can hold beside its Stokes images, and what each of them means.

All maps of a pixel are of one object: the one that most of the pixel's rays hit, 4 x 4 of them on
a regular grid, so that maps depend on no seed and nothing at an outline lies between two objects.
Values are means over the rays that hit that object; ids and texture coordinates, which have no
mean, are taken as `MAPS` says. Off all objects every map is zero, and `object_id` tells where.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator

from malus.scenes.materials.surface import Surface, surfaces_on
from malus.scenes.scene import Scene

MapName = Literal[
    "depth", "position", "shading_normals", "geometric_normals", "object_id", "material_id",
    "albedo", "eta", "alpha", "uv", "coverage",
]  # fmt: skip


@dataclass(frozen=True)
class MapDefinition:
    """What a map holds.

    Attributes
    ----------
    summary : str
    unit : str
    frame : str
        'world', 'image' or ''.
    shape : str
        After (height, width): '' for one number a pixel.
    dtype : str
    partly_covered : str
        The value of a pixel that the object covers in part.
    """

    summary: str
    unit: str
    frame: str
    shape: str
    dtype: str
    partly_covered: str = "mean over the rays that hit the object"


_FIRST = "that of the ray nearest to the pixel's centre which hits the object"

MAPS: dict[MapName, MapDefinition] = {
    "depth": MapDefinition(
        "distance along the camera's axis, from the pinhole; under an orthographic camera from the"
        " plane through the origin, negative before it",
        "scene units", "", "", "float32",
    ),
    "position": MapDefinition("point of the surface", "scene units", "world", "3", "float32"),
    "shading_normals": MapDefinition(
        "unit normals that shading uses, interpolated on meshes", "1", "image", "3", "float32",
        "the mean, scaled to length 1",
    ),
    "geometric_normals": MapDefinition(
        "unit normals of the triangles themselves", "1", "image", "3", "float32",
        "the mean, scaled to length 1",
    ),
    "object_id": MapDefinition(
        "1 for the scene's own shape, then its surroundings in their order; 0 off all", "", "",
        "", "uint16", "the object that most of the pixel's rays hit, of several the first",
    ),
    "material_id": MapDefinition(
        "number from 1 in the list of the scene's different surfaces; 0 off all", "", "", "",
        "uint16", "the surface of the largest share, of several the first",
    ),
    "albedo": MapDefinition(
        "reflectance of the body in every band; 0 for metals, NaN where it is unknown", "1", "",
        "bands", "float32",
    ),
    "eta": MapDefinition(
        "relative refractive index in every band, complex where any surface is a metal; NaN where"
        " it is unknown",
        "1", "", "bands", "float32 or complex64",
    ),
    "alpha": MapDefinition(
        "roughness of the facets, Beckmann's or GGX's, of brushed metal the geometric mean of both;"
        " NaN where it is unknown",
        "1", "", "", "float32",
    ),
    "uv": MapDefinition(
        "texture coordinates, u to the right and v up: those of a mesh file that has some; of other"
        " shapes longitude (0 to 1, from -z) and latitude (0 to 1, from -y) of the object, of"
        " planes its square",
        "1", "", "2", "float32", _FIRST,
    ),
    "coverage": MapDefinition(
        "share of the pixel's rays that hit the object", "1", "", "", "float32", "that share"
    ),
}  # fmt: skip
"""Every map by its name, in the order in which they are stored."""

_STOKES = "mean over all of the pixel, what lies off the objects being dark"

ALWAYS: dict[str, MapDefinition] = {
    "stokes": MapDefinition(
        "linear Stokes vectors, sum of both lobes", "W m^-2 sr^-1 nm^-1", "image", "bands, 3",
        "float32 or float64", _STOKES,
    ),
    "specular": MapDefinition(
        "those of the light that facets of the surface mirror; all of it where nobody can tell the"
        " lobes apart",
        "W m^-2 sr^-1 nm^-1", "image", "bands, 3", "float32 or float64", _STOKES,
    ),
    "diffuse": MapDefinition(
        "those of the light that left the body; 0 where nobody can tell the lobes apart",
        "W m^-2 sr^-1 nm^-1", "image", "bands, 3", "float32 or float64", _STOKES,
    ),
    "standard_error": MapDefinition(
        "standard error of `stokes`", "W m^-2 sr^-1 nm^-1", "image", "bands, 3",
        "float32 or float64", _STOKES,
    ),
    "normals": MapDefinition(
        "unit shading normals over the samples of the render, which may be of several objects",
        "1", "image", "3", "float32 or float64", "the mean over hits, scaled to length 1",
    ),
    "mask": MapDefinition(
        "whether one object covers the pixel entirely", "", "", "", "bool", "False"
    ),
}  # fmt: skip
"""What every dataset holds as a truth's arrays; a suite's `maps` may name them to no effect."""


def _all_of(value: Any) -> Any:
    if value == "all":
        return tuple(MAPS)
    if isinstance(value, tuple | list):
        return tuple(name for name in value if not isinstance(name, str) or name not in ALWAYS)
    return value


def _once(names: tuple[MapName, ...]) -> tuple[MapName, ...]:
    if len(set(names)) < len(names):
        raise ValueError("every map once")
    return tuple(name for name in MAPS if name in names)


MapNames = Annotated[tuple[MapName, ...], BeforeValidator(_all_of), AfterValidator(_once)]
"""Names of maps, or `"all"`; they are sorted, as their order means nothing."""


def different_surfaces(scene: Scene) -> tuple[Surface, ...]:
    """The different surfaces of a scene's objects, which the map `material_id` counts from 1.

    Examples
    --------
    >>> from malus.scenes import Checker, Dielectric, Patterned, Sphere, Uniform
    >>> red, blue = (Dielectric(eta=1.5, alpha=0.3, albedo=a) for a in ("red", "blue"))
    >>> ball = Patterned(surfaces=(red, blue), pattern=Checker(size=0.5))
    >>> different_surfaces(Scene(shape=Sphere(), surface=ball, light=Uniform())) == (red, blue)
    True
    """
    parts = (part for placed in scene.objects for part in surfaces_on(placed.surface))
    return tuple({part.id: part for part in parts}.values())
