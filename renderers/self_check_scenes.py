"""The small scenes that `self_check` renders, one of every kind that malus knows, and their means.

Laws of optics that no scene here shows stand in `self_check_laws`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from malus.renderers.families.family import render_family
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant
from malus.scenes import (
    Area,
    Camera,
    Checker,
    Conductor,
    Dielectric,
    Distant,
    Environment,
    Noise,
    Patterned,
    Placed,
    Plane,
    Polariser,
    Sampling,
    Scene,
    Sky,
    SkyPolarisation,
    Sphere,
    Surroundings,
    Torus,
    Uniform,
)
from malus.scenes.core.arrays import AnyArray, BoolArray, Float64Array

REGIONS = 4
"""Regions a side of the image that values are means over."""

_SIDE = 16
_ORTHOGRAPHIC = Camera(resolution=_SIDE)
_PERSPECTIVE = Camera(resolution=_SIDE, projection="perspective", fov_deg=60, distance=2.6)
_ROLLED = Camera(
    resolution=_SIDE, projection="perspective", fov_deg=60, distance=2.6, roll_deg=35.0
)
_PLASTIC = Dielectric(material="pmma", alpha=0.3, albedo=0.5, body="polarised")
_LAMBERT = Dielectric(material="pmma", alpha=0.3, albedo=0.5, body="unpolarised")
# Much of its light has bounced often, and some paths ended at random.
_WHITE = Dielectric(material="pmma", alpha=0.3, albedo=0.9, body="unpolarised")
_GOLD = Conductor(material="gold", alpha=0.2)
_BRUSHED = Conductor(material="gold", alpha=(0.2, 0.5), distribution="ggx")
_LAMP = Area(incidence_deg=45, half_angle_deg=15, azimuth_deg=60)
_POLARISED = Area(
    incidence_deg=50,
    half_angle_deg=40,
    azimuth_deg=60,
    polarised=Polariser(angle_deg=30, degree=0.7),
)
_POLARISED_SKY = Sky(polarised=SkyPolarisation(degree=0.7), tilt_deg=20.0)
_MARBLE = Patterned(pattern=Noise(soft=True), surfaces=(_PLASTIC, _LAMBERT))
# Nearer than others, so that the part in shadow fills regions of the image.
_NEAR = Camera(resolution=_SIDE, half_width=0.8)


def _ball(
    light: Distant | Uniform | Area | Environment | Sky,
    surface: Dielectric | Conductor | Patterned = _PLASTIC,
    camera: Camera = _ORTHOGRAPHIC,
) -> Scene:
    return Scene(
        shape=Sphere(), surface=surface, light=light, camera=camera, wavelengths_nm=(450.0, 650.0)
    )


def _room(light: Area | Sky, other: Dielectric | Patterned) -> Scene:
    """A white ball on a white floor and beside another ball: each sees the others' light."""
    floor = Placed(shape=Plane(), surface=_WHITE, position=(0.0, -1.0, 0.0), scale=4.0)
    beside = Placed(shape=Sphere(), surface=other, position=(1.3, -0.5, 0.3), scale=0.5)
    camera = Camera(resolution=_SIDE, projection="perspective", fov_deg=70, distance=3.4)
    return _ball(light, _WHITE, camera).model_copy(
        update={"surroundings": Surroundings(name="floor", objects=(floor, beside))}
    )


def _metal_room() -> Scene:
    """Objects of gold, tilted and turned, that mirror polarised light into each other."""
    ring = Placed(
        shape=Torus(), surface=_GOLD, position=(1.1, 0.5, 0.4), scale=0.7, tilt_deg=-30, turn_deg=50
    )
    wall = Placed(
        shape=Plane(),
        surface=Patterned(pattern=Checker(size=0.5), surfaces=(_PLASTIC, _BRUSHED)),
        position=(-1.2, -0.4, -0.3),
        scale=1.6,
        tilt_deg=50,
        turn_deg=40,
    )
    camera = Camera(resolution=_SIDE, projection="perspective", fov_deg=70, distance=3.0)
    return _ball(_POLARISED, _GOLD, camera).model_copy(
        update={"surroundings": Surroundings(name="metal", objects=(ring, wall))}
    )


SCENES = {
    "uniform light": _ball(Uniform()),
    "distant light": _ball(Distant(incidence_deg=60, azimuth_deg=30)),
    "area light": _ball(_LAMP, _LAMBERT),
    "environment map": _ball(Environment(turn_deg=20.0)),
    "sky": _ball(Sky(), _LAMBERT),
    "perspective camera": _ball(Distant(incidence_deg=60), camera=_PERSPECTIVE),
    "rolled camera": _ball(Distant(incidence_deg=60, azimuth_deg=30), camera=_ROLLED),
    "pattern": _ball(
        Distant(incidence_deg=40),
        Patterned(pattern=Checker(size=0.5), surfaces=(_PLASTIC, _GOLD)),
    ),
    "metal": _ball(Uniform(), _GOLD),
    "brushed metal": _ball(Environment(turn_deg=20.0, tilt_deg=50.0, heading_deg=-70.0), _BRUSHED),
    "polarised lamp": _ball(_POLARISED),
    "mesh that shades itself": Scene(
        shape=Torus(tilt_deg=30),
        surface=_PLASTIC,
        light=Distant(incidence_deg=60, azimuth_deg=90),
        camera=_NEAR,
        wavelengths_nm=(450.0, 650.0),
    ),
    "room": _room(_LAMP, _PLASTIC),
    "room of metal": _metal_room(),
    "room under a polarised sky": _room(_POLARISED_SKY, _MARBLE),
}
"""Scenes by the kind that they are for."""

SHORT = frozenset({"distant light", "environment map", "room", "brewster"})
"""Scenes and laws of the short form: rays of the camera, a map, paths between objects, frames."""


def sampling_of(scene: Scene) -> Sampling:
    """Samples that the stored values were measured with: more where light bounces."""
    return Sampling(samples=2048, max_depth=8) if scene.surroundings else Sampling(samples=1024)


def rendered(variant: Variant, scene: Scene, seed: int) -> Truth:
    """The truth of a scene of `SCENES` with the samples that its values were stored for.

    The scalar variant, whose samples take seconds, draws fewer.
    """
    samples = {} if variant.vectorised else {"samples": 64}
    sampling = sampling_of(scene).model_copy(update={"seed": seed} | samples)
    return render_family([scene], sampling, variant).truth(scene)


def region_means(truth: Truth, covered: BoolArray) -> tuple[Float64Array, Float64Array]:
    """Means of both lobes, and of their noise, over the regions of an image that are `covered`.

    Returns
    -------
    values, noise : (2, regions, bands, 3) arrays, of 4 components where there is an s3
    """
    values = _lobes(truth.specular, truth.diffuse, truth.s3)
    noise = _lobes(truth.specular_noise, truth.diffuse_noise, truth.s3_noise)
    side = covered.shape[0] // REGIONS
    means = []
    for row in range(REGIONS):
        for column in range(REGIONS):
            window = np.s_[row * side : (row + 1) * side, column * side : (column + 1) * side]
            inside = covered[window]
            if inside.mean() >= 0.5:
                means.append([_mean(array, window, inside) for array in (values, noise)])
    result = np.moveaxis(np.array(means), 0, 2)
    return result[0], result[1]


def _lobes(specular: AnyArray, diffuse: AnyArray, s3: AnyArray | None) -> Float64Array:
    """Both lobes (2, height, width, bands, 3 or 4); s3 is part of the specular one."""
    lobes = np.stack([specular, diffuse]).astype(np.float64)
    if s3 is None:
        return lobes
    return np.concatenate([lobes, np.stack([s3, np.zeros_like(s3)])[..., None]], axis=-1)


def _mean(array: AnyArray, window: Any, inside: AnyArray) -> Float64Array:
    return np.asarray(array[(slice(None), *window)][:, inside].mean(axis=1))
