"""The paper's own ground truth: the Torrance-Sparrow formulas, without Mitsuba.

Source: Torrance and Sparrow, "Theory for off-specular reflection from roughened surfaces",
JOSA 57 (1967), with the facet distribution of Cook and Torrance, "A reflectance model for computer
graphics", ACM TOG 1 (1982), which is Beckmann's: the one that Mitsuba's rough surfaces use.
Fresnel reflectances are coded here again, on purpose: a truth that shared them with the methods
would not see their mistakes.
"""

from __future__ import annotations

import numpy as np

from malus.renderers.truth import Truth
from malus.scenes.camera import Camera
from malus.scenes.core.arrays import BoolArray, Float64Array
from malus.scenes.core.errors import InputError
from malus.scenes.lights.lights import Distant
from malus.scenes.lights.polarised import is_polarised
from malus.scenes.polarisation import stokes_from_extremes
from malus.scenes.scene import Scene
from malus.scenes.shapes.shapes import Sphere

VIEWER = np.array([0.0, 0.0, 1.0])
"""Direction to the orthographic camera in the image frame."""


def render_torrance_sparrow(
    scene: Scene, normals: Float64Array | None = None, mask: BoolArray | None = None
) -> Truth:
    """Render a sphere, or any normal map, under a distant light.

    Parameters
    ----------
    scene : Scene
        With a distant light, an unpolarised (Lambertian) body, and a sphere as its shape unless
        `normals` are given.
    normals : (height, width, 3), optional
        Unit normals of the object in the image frame; replaces the scene's shape.
    mask : (height, width) bool, optional
        The object's pixels; by default those with a normal.

    Raises
    ------
    InputError
        Another shape, light, body or distribution of facets than these, or a perspective camera.

    Examples
    --------
    >>> scene = Scene(shape=Sphere(), light=Distant(incidence_deg=30), camera=Camera(resolution=9),
    ...               surface={"eta": 1.5, "alpha": 0.3, "body": "unpolarised"})
    >>> bool(render_torrance_sparrow(scene).image[4, 4, 0] > 0)
    True
    """
    light = _checked_light(scene, normals)
    if normals is None:
        normals, mask = sphere_normals(scene.camera)
    if mask is None:
        mask = np.linalg.norm(normals, axis=-1) > 0.5
    direction = np.array(light.direction)
    half = _unit(direction + VIEWER)
    n_l = np.clip(normals @ direction, 0.0, 1.0)[..., None]
    n_v = np.clip(normals @ VIEWER, 0.0, 1.0)[..., None]
    n_h = np.clip(normals @ half, 0.0, 1.0)[..., None]
    lit = (n_l > 0) & (n_v > 0) & mask[..., None]
    perpendicular, parallel = fresnel(float(VIEWER @ half), scene.eta.real)
    assert scene.surface.isotropic_alpha is not None
    distribution = _beckmann(n_h, scene.surface.isotropic_alpha)
    shape = distribution * masking(n_h, n_v, n_l, float(VIEWER @ half))
    # radiance = BRDF · E cos θ_L; the cosine cancels that of the BRDF's denominator
    lobe = np.where(lit, shape / (4.0 * np.where(lit, n_v, 1.0)), 0.0) * light.irradiance
    azimuth = np.arctan2(half[1], half[0])
    specular = stokes_from_extremes(
        0.5 * perpendicular * lobe, 0.5 * parallel * lobe, np.asarray(azimuth)
    )
    diffuse = np.zeros_like(specular)
    albedo = scene.surface.albedos(scene.wavelengths_nm)
    diffuse[..., 0] = np.where(lit, albedo / np.pi * light.irradiance * n_l, 0.0)
    no_noise = np.zeros_like(specular)
    return Truth(
        scene, specular, diffuse, normals, mask, no_noise, no_noise, no_noise,
        normal_spread=np.zeros(mask.shape),  # a pixel is computed from one normal
    )  # fmt: skip


def _checked_light(scene: Scene, normals: Float64Array | None) -> Distant:
    """The scene's light; raises InputError for a scene that the formulas do not cover."""
    hint = "use the mitsuba renderer for this scene"
    where = f"scene {scene.id}, torrance-sparrow renderer"
    if normals is None and not isinstance(scene.shape, Sphere):
        raise InputError(where, "a sphere", scene.shape.kind, hint)
    light = scene.light_in_image
    if not isinstance(light, Distant):
        raise InputError(where, "a distant light", light.kind, hint)
    if is_polarised(light):
        raise InputError(where, "unpolarised light", light.label, hint)
    if scene.camera.projection != "orthographic":
        raise InputError(where, "an orthographic camera", scene.camera.projection, hint)
    if scene.surroundings is not None:
        raise InputError(where, "a scene of one object", "surroundings", hint)
    if scene.surface.kind == "patterned":
        raise InputError(where, "the same surface all over", "a pattern", hint)
    if scene.surface.body != "unpolarised":
        raise InputError(where, "an unpolarised body", scene.surface.body, hint)
    if scene.surface.distribution != "beckmann":
        raise InputError(where, "Beckmann's facets", str(scene.surface.distribution), hint)
    return light


def sphere_normals(camera: Camera) -> tuple[Float64Array, BoolArray]:
    """Normals (height, width, 3) of the unit sphere at the pixels' centres, and its mask.

    A pixel belongs to the mask where even its outermost corner is on the sphere.

    Examples
    --------
    >>> sphere_normals(Camera(resolution=3))[0][1, 1, 2].item()
    1.0
    """
    step = 2.0 * camera.half_width / camera.resolution
    centre = (np.arange(camera.resolution) + 0.5) * step - camera.half_width
    x, y = np.meshgrid(centre, -centre)
    outermost = np.hypot(np.abs(x) + 0.5 * step, np.abs(y) + 0.5 * step)
    mask = outermost <= 1.0
    z = np.sqrt(np.clip(1.0 - x**2 - y**2, 0.0, None))
    return np.where(mask[..., None], np.stack([x, y, z], axis=-1), 0.0), mask


def fresnel(
    cos_incidence: float | Float64Array, eta: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Fresnel reflectances (perpendicular, parallel) of a dielectric, η > 1.

    Examples
    --------
    >>> [round(float(f[0]), 12) for f in fresnel(1.0, np.array([1.5]))]
    [0.04, 0.04]
    """
    refracted = np.sqrt(eta**2 - 1.0 + cos_incidence**2) / eta
    perpendicular = (cos_incidence - eta * refracted) / (cos_incidence + eta * refracted)
    parallel = (eta * cos_incidence - refracted) / (eta * cos_incidence + refracted)
    return perpendicular**2, parallel**2


def masking(n_h: Float64Array, n_v: Float64Array, n_l: Float64Array, v_h: float) -> Float64Array:
    """Torrance and Sparrow's V-cavity term G = min(1, 2 N·H N·V / V·H, 2 N·H N·L / V·H).

    Examples
    --------
    >>> float(masking(np.array(1.0), np.array(1.0), np.array(1.0), 1.0))
    1.0
    """
    return np.minimum(1.0, 2.0 * n_h * np.minimum(n_v, n_l) / v_h)


def _beckmann(n_h: Float64Array, alpha: float) -> Float64Array:
    """Beckmann's distribution of facet normals, 1/sr; zero for facets that face away."""
    facing = n_h > 1e-6
    squared = np.where(facing, n_h, 1.0) ** 2
    tan2 = (1.0 - squared) / squared
    result: Float64Array = np.where(
        facing, np.exp(-tan2 / alpha**2) / (np.pi * alpha**2 * squared**2), 0.0
    )
    return result


def _unit(vector: Float64Array) -> Float64Array:
    return vector / np.linalg.norm(vector)
