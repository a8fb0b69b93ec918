"""The small scenes that `self_check` renders: one of every kind that malus knows."""

from __future__ import annotations

from malus.scenes import (
    Area,
    Camera,
    Checker,
    Conductor,
    Dielectric,
    Distant,
    Environment,
    Patterned,
    Placed,
    Plane,
    Polariser,
    Sampling,
    Scene,
    Sky,
    Sphere,
    Surroundings,
    Torus,
    Uniform,
)

_SIDE = 16
_ORTHOGRAPHIC = Camera(resolution=_SIDE)
_PERSPECTIVE = Camera(resolution=_SIDE, projection="perspective", fov_deg=60, distance=2.6)
_ROLLED = Camera(
    resolution=_SIDE, projection="perspective", fov_deg=60, distance=2.6, roll_deg=35.0
)
_PLASTIC = Dielectric(material="pmma", alpha=0.3, albedo=0.5, body="polarised")
_LAMBERT = Dielectric(material="pmma", alpha=0.3, albedo=0.5, body="unpolarised")
_GOLD = Conductor(material="gold", alpha=0.2)
_BRUSHED = Conductor(material="gold", alpha=(0.2, 0.5), distribution="ggx")
_LAMP = Area(incidence_deg=45, half_angle_deg=15, azimuth_deg=60)
_POLARISED = Area(
    incidence_deg=50, half_angle_deg=40, azimuth_deg=60, polarised=Polariser(angle_deg=30)
)
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


def _room() -> Scene:
    """A ball close above a floor and beside another ball: each sees the others' light."""
    floor = Placed(shape=Plane(), surface=_LAMBERT, position=(0.0, -1.0, 0.0), scale=4.0)
    other = Placed(shape=Sphere(), surface=_PLASTIC, position=(1.3, -0.5, 0.3), scale=0.5)
    camera = Camera(resolution=_SIDE, projection="perspective", fov_deg=70, distance=3.4)
    return _ball(_LAMP, _LAMBERT, camera).model_copy(
        update={"surroundings": Surroundings(name="floor", objects=(floor, other))}
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
    "room": _room(),
    "room of metal": _metal_room(),
}
"""Scenes by the kind that they are for."""

SHORT = frozenset({"distant light", "environment map", "room", "brewster"})
"""Scenes and laws of the short form: rays of the camera, a map, paths between objects, frames."""


def sampling_of(scene: Scene) -> Sampling:
    """Samples that the stored values were measured with: more where light bounces."""
    return Sampling(samples=256, max_depth=4) if scene.surroundings else Sampling(samples=64)
