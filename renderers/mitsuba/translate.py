"""Mitsuba objects and dictionaries from the data of a scene."""

from __future__ import annotations

import contextlib
import functools
import math
import threading
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np

from malus.renderers.mitsuba.lighting import environment_emitter
from malus.scenes.camera import Camera
from malus.scenes.core.arrays import Float32Array
from malus.scenes.core.errors import InputError
from malus.scenes.lights.lights import Area, Distant, Light, Uniform
from malus.scenes.lights.sky import parts
from malus.scenes.materials.surface import AnyBody, Facets, anisotropic
from malus.scenes.scene import Scene
from malus.scenes.shapes import geometry
from malus.scenes.shapes.geometry import TriangleMesh
from malus.scenes.shapes.lathe import lathe
from malus.scenes.shapes.shapes import (
    Blob,
    Lathe,
    MeshFile,
    Shape,
    Sphere,
    Superquadric,
    Torus,
)

ORTHOGRAPHIC_DISTANCE = 3.0
NEAR_CLIP, FAR_CLIP = 1e-2, 1e4
"""Where rays of Mitsuba's cameras begin and end if nothing else is said."""
LAMP_DISTANCE = 1000.0
"""Distance of a lamp in radii of the objects: its direction differs by 0.06° at most."""

DUST = 1e-9
"""Components of normals that are taken for 0, a sixtieth of the rounding of others. The square of
what interpolation makes of smaller ones is 0 in float32: Mitsuba then divides by no length, and
light from a face that faces the camera has no number for s1 and s2."""


def sensor(
    mi: ModuleType, camera: Camera, distance: float = ORTHOGRAPHIC_DISTANCE
) -> dict[str, Any]:
    """The camera as a Mitsuba sensor with a box filter, so that pixels are independent.

    `distance` is that of an orthographic camera from the origin; images do not depend on it.
    """
    if camera.distance is not None:
        distance, lens = camera.distance, {"type": "perspective", "fov": camera.fov_deg}
        # The far end enters the rounding of all rays: it stays where it is for cameras nearby.
        lens["far_clip"] = max(FAR_CLIP, 2 * distance)
        # Half-way to the unit sphere: rays that begin inside an object see its back, which is dark.
        lens["near_clip"] = min(NEAR_CLIP, 0.5 * (distance - 1.0))
    else:
        lens = {"type": "orthographic"}
    to_world = mi.ScalarTransform4f().look_at(
        origin=(distance * camera.axes[2]).tolist(), target=[0, 0, 0], up=camera.axes[1].tolist()
    )
    if camera.projection == "orthographic":
        to_world = to_world @ mi.ScalarTransform4f().scale(
            [camera.half_width, camera.half_width, 1]
        )
    return lens | {
        "to_world": to_world,
        "film": {
            "type": "hdrfilm",
            "width": camera.resolution,
            "height": camera.resolution,
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
        "sampler": {"type": "independent"},
    }


def shape_object(mi: ModuleType, shape: Shape, bsdf: Any) -> Any:
    """A shape as a Mitsuba object with `bsdf`."""
    if isinstance(shape, Sphere):
        return mi.load_dict({"type": "sphere", "bsdf": bsdf})
    return mesh_object(mi, tessellated(shape), bsdf)


@functools.lru_cache(maxsize=4)
def tessellated(shape: Shape) -> TriangleMesh:
    """The mesh of any shape but a sphere, which Mitsuba intersects analytically."""
    match shape:
        case Torus():
            return geometry.torus(shape.major, shape.minor, math.radians(shape.tilt_deg))
        case Blob():
            return geometry.blob(shape.seed)
        case Superquadric():
            return geometry.superquadric(shape.e1, shape.e2, shape.stretch)
        case Lathe():
            return lathe(shape.seed)
        case MeshFile():
            from malus.scenes.shapes.meshes import load_mesh

            return load_mesh(shape.checked(), shape.shading, shape.up)[0]
    raise TypeError(f"no mesh for {shape!r}")


def check_tangents(scene: Scene) -> None:
    """Check that meshes with anisotropic facets have coordinates, whose tangent these refer to.

    Raises
    ------
    InputError
        If a mesh file has none: Mitsuba would take any tangent, another one for each face.
    """
    for placed in scene.objects:
        shape = placed.shape
        if not (isinstance(shape, MeshFile) and anisotropic(placed.surface)):
            continue
        if tessellated(shape).uv is None:
            hint = "export them with the mesh, or give one number as alpha"
            expected = "texture coordinates, as two alphas need them"
            raise InputError(str(shape.file), expected, "a mesh without", hint)


@contextlib.contextmanager
def tessellated_ahead(shape: Shape | None) -> Iterator[None]:
    """Make the mesh of a shape in a thread while the block renders another; None makes nothing.

    What is wrong with it is told when it is its turn.
    """
    if shape is None or isinstance(shape, Sphere):
        yield
        return

    def make() -> None:
        with contextlib.suppress(Exception):
            tessellated(shape)

    thread = threading.Thread(target=make, name="malus-mesh")
    thread.start()
    try:
        yield
    finally:
        # The next family finds the mesh whole, and does not make it beside this thread.
        thread.join()


def mesh_object(mi: ModuleType, mesh: TriangleMesh, bsdf: Any) -> Any:
    """A mesh as a Mitsuba object with `bsdf`."""
    properties = mi.Properties()
    properties["mesh_bsdf"] = bsdf
    result = mi.Mesh(
        "shape",
        len(mesh.vertices),
        len(mesh.faces),
        props=properties,
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=mesh.uv is not None,
    )
    parameters = mi.traverse(result)
    parameters["vertex_positions"] = np.ravel(mesh.vertices)
    parameters["faces"] = np.ravel(mesh.faces)
    if mesh.normals is not None:
        parameters["vertex_normals"] = _without_dust(np.ravel(mesh.normals))
    if mesh.uv is not None:
        parameters["vertex_texcoords"] = np.ravel(mesh.uv)
    parameters.update()
    return result


def _without_dust(components: Float32Array) -> Float32Array:
    """Components of unit vectors, 0 where they are below `DUST`."""
    return np.where(np.abs(components) < DUST, np.float32(0.0), components)


def emitters(mi: ModuleType, light: Light, lamp_distance: float = LAMP_DISTANCE) -> dict[str, Any]:
    """The parts of a light as emitters of a Mitsuba scene, by name; see `emitter`."""
    return {f"light{k}": emitter(mi, part, lamp_distance) for k, part in enumerate(parts(light))}


def emitter(mi: ModuleType, light: Light, lamp_distance: float = LAMP_DISTANCE) -> dict[str, Any]:
    """A light of one part as an emitter with a flat spectrum.

    An area light becomes a disk `lamp_distance` from the origin, far beyond all objects.
    """
    if isinstance(light, Uniform):
        return {"type": "constant", "radiance": _flat(light.radiance)}
    if isinstance(light, Distant):
        return {
            "type": "directional",
            "direction": [-c for c in light.direction],
            "irradiance": _flat(light.irradiance),
        }
    if isinstance(light, Area):
        return _lamp(mi, light, lamp_distance)
    return environment_emitter(mi, light)


def _lamp(mi: ModuleType, light: Area, distance: float) -> dict[str, Any]:
    """A disk so far away that its direction is the same all over the objects."""
    away = [distance * c for c in light.direction]
    radius = distance * math.tan(math.radians(light.half_angle_deg))
    to_world = mi.ScalarTransform4f().look_at(origin=away, target=[0, 0, 0], up=_upward(light))
    return {
        "type": "disk",
        "to_world": to_world @ mi.ScalarTransform4f().scale([radius, radius, 1]),
        "emitter": {"type": "area", "radiance": _flat(light.radiance)},
    }


def _upward(light: Area) -> list[float]:
    """A direction that is not parallel to that of the lamp."""
    return [1.0, 0.0, 0.0] if abs(light.direction[1]) > 0.9 else [0.0, 1.0, 0.0]


def specular_bsdf(eta: float | complex, facets: Facets) -> dict[str, Any]:
    """The specular lobe alone: `pplastic` over a black body; of a metal, `roughconductor`."""
    if not isinstance(eta, complex):
        return _pplastic(eta, facets) | {"diffuse_reflectance": _flat(0.0)}
    along, across = facets.alphas
    alphas = {"alpha": along} if along == across else {"alpha_u": along, "alpha_v": across}
    return {
        "type": "roughconductor",
        "eta": _flat(eta.real),
        "k": _flat(eta.imag),
        **alphas,
        "distribution": facets.distribution,
    }


def diffuse_bsdf(eta: float | complex, facets: Facets, body: AnyBody) -> dict[str, Any]:
    """The diffuse lobe alone at albedo 1; both bodies are linear in the albedo.

    'polarised' is `pplastic` without its specular term; 'unpolarised' is Lambertian, which is the
    paper's assumption. A conductor has no diffuse light: its albedo is zero, so that what is
    rendered here does not count.
    """
    if body != "polarised":
        return {"type": "diffuse", "reflectance": _flat(1.0)}
    assert not isinstance(eta, complex)
    return _pplastic(eta, facets) | {
        "diffuse_reflectance": _flat(1.0),
        "specular_reflectance": _flat(0.0),
    }


def _pplastic(eta: float, facets: Facets) -> dict[str, Any]:
    return {
        "type": "pplastic",
        "int_ior": float(eta),
        "ext_ior": 1.0,
        "alpha": facets.alphas[0],
        "distribution": facets.distribution,
    }


def _flat(value: float) -> dict[str, Any]:
    return {"type": "uniform", "value": float(value)}
