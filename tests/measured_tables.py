"""Tables of measured materials that are made of a known one, and scenes of them.

They are tabulated from Mitsuba's `pplastic` on Rusinkiewicz' angles. "A New Change of Variables for
Efficient BRDF Representation", Rusinkiewicz, 1998.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up import tensor_file

from malus.renderers import Truth
from malus.renderers.families.family import render_family
from malus.renderers.mitsuba.translate import specular_bsdf
from malus.renderers.variant import Variant, choose, mitsuba
from malus.scenes import Camera, Dielectric, Distant, Light, Measured, Sampling, Scene, Sphere
from malus.scenes.materials.surface import Facets

TABLE_NM = (450, 500, 550, 600, 650)
ETAS = (1.40, 1.45, 1.50, 1.55, 1.60)
ALPHA, ALBEDO = 0.3, 0.4
BANDS = (475.0, 550.0, 650.0)
INVALID = np.nan
"""What the files of Baek et al. hold where a direction lies below the surface."""


def directions(step_deg: float) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Axes of a table, directions to light and viewer, and what is perpendicular to both.

    The half vector tilts towards +x; `t` and `b` are the axes about it from which phi_d counts.
    """
    quarter = round(90 / step_deg)
    axes = [
        np.linspace(-np.pi, np.pi, 4 * quarter + 1),
        np.linspace(0, np.pi / 2, quarter + 1),
        np.linspace(0, np.pi / 2, quarter + 1),
    ]
    phi_d, theta_d, theta_h = np.meshgrid(*axes, indexing="ij")
    zero = np.zeros_like(theta_h)
    h = np.stack([np.sin(theta_h), zero, np.cos(theta_h)], axis=-1)
    t = np.stack([np.cos(theta_h), zero, -np.sin(theta_h)], axis=-1)
    b = np.array([0.0, 1.0, 0.0])
    c, s = np.cos(phi_d)[..., None], np.sin(phi_d)[..., None]
    along, upright = np.sin(theta_d)[..., None] * (c * t + s * b), np.cos(theta_d)[..., None] * h
    return axes, upright + along, upright - along, c * b - s * t


def mueller(mi: Any, eta: float, light: np.ndarray, viewer: np.ndarray, axis: np.ndarray) -> Any:
    """BRDF (..., 4, 4) of the material, 1/sr, Stokes vectors about `axis` on both sides."""

    def vectors(values: np.ndarray) -> Any:
        return mi.Vector3f(values.reshape(-1, 3).T.astype(np.float32))

    bsdf = mi.load_dict(
        specular_bsdf(eta, Facets((ALPHA, ALPHA)))
        | {"diffuse_reflectance": {"type": "uniform", "value": ALBEDO}}
    )
    hit = mi.SurfaceInteraction3f()
    hit.wi, to_light, across = vectors(viewer), vectors(light), vectors(axis)
    value = bsdf.eval(mi.BSDFContext(), hit, to_light)
    basis = mi.mueller.stokes_basis
    turned = mi.mueller.rotate_mueller_basis(
        value, -to_light, basis(-to_light), across, hit.wi, basis(hit.wi), across
    )
    flat = np.array([[np.asarray(turned[i, j][0]) for j in range(4)] for i in range(4)])
    matrices = np.moveaxis(flat, 2, 0).reshape(*light.shape[:-1], 4, 4)
    valid = (light[..., 2] > 1e-6) & (viewer[..., 2] > 1e-6)
    cosine = np.where(valid, light[..., 2], 1.0)[..., None, None]
    return np.where(valid[..., None, None], matrices / cosine, INVALID)


def write(path: Path, **fields: np.ndarray) -> Path:
    path.write_bytes(tensor_file(**fields))
    return path


@functools.cache
def table(step_deg: float) -> dict[str, np.ndarray]:
    best = choose()
    if not best.vectorised:
        pytest.skip("only the scalar variant runs here: it evaluates no arrays")
    axes, light, viewer, axis = directions(step_deg)
    values = [mueller(mitsuba(best), eta, light, viewer, axis) for eta in ETAS]
    fields = dict(zip(("phi_d", "theta_d", "theta_h"), axes, strict=True))
    return {name: a[None].astype(np.float32) for name, a in fields.items()} | {
        "wvls": np.array(TABLE_NM, np.uint16),
        "M": np.stack(values, axis=3).astype(np.float32),
    }


CAMERAS = {
    "orthographic": Camera(resolution=24),
    "perspective rolled": Camera.model_validate(
        {"resolution": 24, "projection": "perspective", "fov_deg": 62, "distance": 2.0}
        | {"roll_deg": 25}
    ),
}
LIGHT = Distant(incidence_deg=50, azimuth_deg=35)


def scene(
    surface: Measured | Dielectric,
    camera: Camera,
    light: Light = LIGHT,
    bands: tuple[float, ...] = BANDS,
) -> Scene:
    return Scene(shape=Sphere(), surface=surface, light=light, camera=camera, wavelengths_nm=bands)


def truth_of(one: Scene, samples: int = 8, variant: Variant | None = None, seed: int = 1) -> Truth:
    return render_family([one], Sampling(samples=samples, seed=seed), variant).truth(one)
