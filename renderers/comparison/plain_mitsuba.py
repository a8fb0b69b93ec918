"""Polariser images in plain Mitsuba, for the benchmark of malus' own renderer.

`plate_image` follows Mitsuba's documentation: a polariser before the camera, one render for every
angle, the scene loaded anew. `StokesByHand` is the fastest way with what Mitsuba brings: one Stokes
render for every material, roughness and band, with the parameters updated in place.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from malus.renderers.mitsuba.translate import emitter, sensor, shape_object, specular_bsdf
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.core.arrays import Float32Array
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
    turned = mi.ScalarTransform4f().translate([0, 0, PLATE_DISTANCE])
    turned = turned @ mi.ScalarTransform4f().rotate([0, 1, 0], 180)
    plate = {
        "type": "rectangle",
        "to_world": turned @ mi.ScalarTransform4f().scale(1.1),
        # ϑ counts from the vertical, the plate's theta from its own x axis, the horizontal.
        "bsdf": {"type": "polarizer", "theta": {"type": "uniform", "value": angle_deg + 90.0}},
    }
    loaded = mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(mi, scene.camera, PLATE_DISTANCE + 1.0),
            "shape": shape_object(mi, scene.shape, mi.load_dict(_bsdf(scene, band))),
            "light": emitter(mi, scene.light),
            "plate": plate,
            "integrator": {"type": "path", "max_depth": 3, "hide_emitters": True},
        }
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
        self.parameters.update()
        raw = self.mi.render(self.scene, spp=sampling.samples, seed=sampling.seed)
        stokes = np.asarray(raw)[..., [-12, -9, -6]]
        return [polarised(stokes, angle) for angle in angles_deg]
