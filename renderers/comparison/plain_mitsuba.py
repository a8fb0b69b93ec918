"""Polariser images in plain Mitsuba, for the benchmark of malus' own renderer.

`plate_image` follows Mitsuba's documentation: a polariser before the camera, one render for every
angle, the scene loaded anew. `StokesByHand` is the fastest way with what Mitsuba brings: one Stokes
render for every material, roughness and band, with the parameters updated in place.

A lamp behind a polariser is a lamp behind a plate here: `lamps`.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from malus.renderers.mitsuba.translate import (
    LAMP_DISTANCE,
    emitter,
    emitters,
    sensor,
    shape_object,
    specular_bsdf,
)
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.core.arrays import Float32Array
from malus.scenes.lights.lights import Area, Light
from malus.scenes.lights.polarised import is_polarised
from malus.scenes.materials.surface import Conductor, Dielectric
from malus.scenes.polarisation import polarised
from malus.scenes.scene import Sampling, Scene

PLATE_DISTANCE = 100.0
"""From plate to object; a nearer plate would shade the object from light all around."""


def _bsdf(scene: Scene, band: int) -> dict[str, Any]:
    """A BSDF with both the specular and the diffuse lobe; a metal has the first alone."""
    surface = scene.surface
    assert isinstance(surface, Dielectric | Conductor)
    specular = specular_bsdf(scene.eta[band].item(), surface.facets)
    if isinstance(surface, Conductor):
        return specular
    albedo = {"type": "uniform", "value": float(surface.albedos(scene.wavelengths_nm)[band])}
    return specular | {"diffuse_reflectance": albedo}


def plate_image(
    variant: Variant, scene: Scene, band: int, angle_deg: float, sampling: Sampling
) -> Float32Array:
    """Render one image (height, width) of one band through a polariser plate."""
    mi = mitsuba(variant)
    _, up, towards_camera = scene.camera.axes
    turned = mi.ScalarTransform4f().look_at(
        origin=(PLATE_DISTANCE * towards_camera).tolist(), target=[0, 0, 0], up=up.tolist()
    )
    plate = {
        "type": "rectangle",
        "to_world": turned @ mi.ScalarTransform4f().scale(1.1),
        "bsdf": _polariser(angle_deg),
    }
    depth = 4 if is_polarised(scene.light) else 3
    loaded = mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(mi, scene.camera, PLATE_DISTANCE + 1.0),
            "shape": shape_object(mi, scene.shape, mi.load_dict(_bsdf(scene, band))),
            "camera plate": plate,
            "integrator": {"type": "path", "max_depth": depth, "hide_emitters": True},
        }
        | lamps(mi, scene.light)
    )
    image = np.asarray(mi.render(loaded, spp=sampling.samples, seed=sampling.seed))
    return image[..., 0]


class StokesByHand:
    """A scene that is loaded once, and rendered with new parameters without being reloaded."""

    def __init__(self, variant: Variant, scene: Scene) -> None:
        self.mi = mitsuba(variant)
        path = {"type": "path", "max_depth": 2, "hide_emitters": True}
        self.scene = self.mi.load_dict(
            {
                "type": "scene",
                "sensor": sensor(self.mi, scene.camera),
                "shape": shape_object(self.mi, scene.shape, self.mi.load_dict(_bsdf(scene, 0))),
                "light": emitter(self.mi, scene.light),
                "integrator": {"type": "stokes", "path": path},
            }
        )
        self.parameters = self.mi.traverse(self.scene)

    def images(
        self, scene: Scene, band: int, angles_deg: tuple[float, ...], sampling: Sampling
    ) -> list[Float32Array]:
        """Polariser images (height, width) of one band at every angle from one Stokes render."""
        self.parameters["shape.bsdf.eta.value"] = float(scene.eta[band])
        self.parameters["shape.bsdf.alpha.value"] = scene.surface.isotropic_alpha
        albedo = scene.surface.albedos(scene.wavelengths_nm)[band]
        self.parameters["shape.bsdf.diffuse_reflectance.value"] = float(albedo)
        self.parameters.update()
        raw = self.mi.render(self.scene, spp=sampling.samples, seed=sampling.seed)
        stokes = np.asarray(raw)[..., [-12, -9, -6]]
        return [polarised(stokes, angle) for angle in angles_deg]


def lamps(mi: ModuleType, light: Light) -> dict[str, Any]:
    """The lights of a scene by name; a polarised lamp is one behind Mitsuba's polariser plate.

    Mitsuba finds the lamp through the plate by chance only, along directions drawn from a BSDF.

    Raises
    ------
    ValueError
        A light that no plate makes: of a point, of a sky, or polarised in part.
    """
    if not is_polarised(light):
        return emitters(mi, light)
    if not isinstance(light, Area) or light.polarised is None or light.polarised.degree != 1.0:
        raise ValueError(f"light: expected a wholly polarised area light, found {light.label}")
    # The plate passes half.
    behind = light.model_copy(update={"polarised": None, "radiance": 2.0 * light.radiance})
    at = [0.9 * LAMP_DISTANCE * c for c in light.direction]
    to_world = mi.ScalarTransform4f().look_at(origin=at, target=[0, 0, 0], up=[0, 1, 0])
    plate = {
        "type": "rectangle",
        "to_world": to_world @ mi.ScalarTransform4f().scale(20 * LAMP_DISTANCE),
        "bsdf": _polariser(light.polarised.angle_deg),
    }
    return {"light": emitter(mi, behind), "plate": plate}


def _polariser(angle_deg: float) -> dict[str, Any]:
    """A plate whose front faces the object: its theta counts from its own x axis, horizontal."""
    return {"type": "polarizer", "theta": {"type": "uniform", "value": angle_deg + 90.0}}
