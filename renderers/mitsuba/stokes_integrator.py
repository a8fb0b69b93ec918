"""Render a family with Mitsuba's own `stokes` integrator, node by node, in any variant.

malus renders so where neither LLVM nor CUDA works; tests compare the vectorised kernels with it.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from malus.renderers.family_key import FamilyKey
from malus.renderers.mitsuba.coverage import check_seen, inside
from malus.renderers.mitsuba.lighting import beside
from malus.renderers.mitsuba.lobe_samples import Lobes, finite, spread_of, unit
from malus.renderers.mitsuba.measured_bsdf import measured_bsdfs
from malus.renderers.mitsuba.translate import (
    diffuse_bsdf,
    emitter,
    sensor,
    shape_object,
    specular_bsdf,
)
from malus.renderers.variant import SCALAR, Variant, mitsuba
from malus.scenes.camera import Camera
from malus.scenes.core.arrays import BoolArray, Float32Array
from malus.scenes.lights.lights import Light, MapLight
from malus.scenes.lights.sky import parts
from malus.scenes.scene import Sampling
from malus.scenes.shapes.shapes import Shape

BATCHES = 8
"""Independent renders that give the standard error: four a half, 7 degrees of freedom."""

WAVELENGTH_NM = 555.0
"""The spectral variant renders 1 nm around it: indices of a node do not depend on wavelength."""


def render_lobes(
    variant: Variant, key: FamilyKey, nodes: list[float | complex], sampling: Sampling
) -> Lobes:
    """Stokes samples of both lobes of one family at its nodes."""
    mi = mitsuba(variant)
    batches = max(b for b in range(2, BATCHES + 1, 2) if sampling.samples % b == 0)
    base_scene = _base_scene(mi, variant, key.shape, key.camera)
    normals, touched, covered = _geometry(mi, base_scene, sampling)
    check_seen(touched, key.shape)
    specular_bsdfs = _specular_bsdfs(variant, key, nodes)
    diffuse_nodes = nodes if key.body == "polarised" else nodes[:1]
    diffuse_bsdfs = [diffuse_bsdf(node, key.facets, key.body) for node in diffuse_nodes]
    light = beside(key.light, key.camera.axes[2])
    specular = _renders(mi, base_scene, light, specular_bsdfs, batches, sampling, stream=0)
    diffuse = _renders(mi, base_scene, light, diffuse_bsdfs, batches, sampling, stream=1)
    pixels = np.flatnonzero(touched)
    specular, diffuse = specular[:, :, pixels], diffuse[:, :, pixels]
    return Lobes(
        specular=_halves(specular),
        diffuse=_halves(diffuse),
        specular_variance=_variance_of_mean(specular),
        diffuse_variance=_variance_of_mean(diffuse),
        # The lobes are rendered from different seeds: they are independent.
        covariance=np.zeros(specular.shape[1:], dtype=np.float32),
        pixels=pixels,
        normals=unit(normals[pixels]),
        normal_spread=spread_of(normals[pixels]),
        covered=covered[pixels],
        draws=batches,
    )


def _specular_bsdfs(variant: Variant, key: FamilyKey, nodes: list[float | complex]) -> list[Any]:
    if key.measured is not None:
        return measured_bsdfs(variant, key.measured, tuple(nodes))
    return [specular_bsdf(node, key.facets) for node in nodes]


def _halves(batches: Float32Array) -> Float32Array:
    count, *rest = batches.shape
    halves = batches.reshape(2, count // 2, *rest).mean(axis=1)
    return np.asarray(halves, dtype=np.float32)


def _variance_of_mean(batches: Float32Array) -> Float32Array:
    return np.asarray(batches.var(axis=0, ddof=1) / len(batches), dtype=np.float32)


def _base_scene(mi: ModuleType, variant: Variant, shape: Shape, camera: Camera) -> dict[str, Any]:
    """The scene without BSDF, light and integrator."""
    look = sensor(mi, camera)
    if variant.name == SCALAR:
        look["srf"] = {
            "type": "uniform",
            "wavelength_min": WAVELENGTH_NM - 0.5,
            "wavelength_max": WAVELENGTH_NM + 0.5,
            "value": 1.0,
        }
    return {"type": "scene", "sensor": look, "shape": shape}


def _load(mi: ModuleType, base_scene: dict[str, Any], bsdf: Any, **more: Any) -> Any:
    loaded = mi.load_dict(bsdf) if isinstance(bsdf, dict) else bsdf
    shape = shape_object(mi, base_scene["shape"], loaded)
    return mi.load_dict(base_scene | {"shape": shape} | more)


def _renders(
    mi: ModuleType,
    base_scene: dict[str, Any],
    light: Light,
    bsdfs: list[Any],
    batches: int,
    sampling: Sampling,
    stream: int,
) -> Float32Array:
    """Stokes images of every batch and BSDF, shape (batches, len(bsdfs), pixels, 3).

    BSDFs are dictionaries that differ in their index, or loaded already.
    """
    integrator = {
        "type": "stokes",
        "direct": {"type": "path", "max_depth": 2, "hide_emitters": True},
    }
    images = np.zeros(
        (batches, len(bsdfs), base_scene["sensor"]["film"]["width"] ** 2, 3), np.float32
    )
    for part in parts(light):  # apart, because the film's response depends on the kind of light
        scene = _load(mi, base_scene, bsdfs[0], light=emitter(mi, part), integrator=integrator)
        response = _response(mi, base_scene, part)
        for node, bsdf in enumerate(bsdfs):
            if isinstance(bsdf, dict):
                _set_index(mi, scene, bsdf)
            else:
                scene = _load(mi, base_scene, bsdf, light=emitter(mi, part), integrator=integrator)
            for batch in range(batches):
                # The same seed for every node makes noise a smooth function of the index.
                seed = (sampling.seed * BATCHES + batch) * 2 + stream
                raw = np.asarray(mi.render(scene, spp=sampling.samples // batches, seed=seed))
                images[batch, node] += _stokes(raw).reshape(-1, 3) / response
    return finite(images)


def _set_index(mi: ModuleType, scene: Any, bsdf: dict[str, Any]) -> None:
    parameters = mi.traverse(scene)
    prefix = "shape.bsdf."
    values = {"eta.value": bsdf.get("int_ior")}
    if bsdf["type"] == "roughconductor":
        values = {f"{name}.value": bsdf[name]["value"] for name in ("eta", "k")}
    for key, value in values.items():
        if prefix + key in parameters:
            parameters[prefix + key] = value
    parameters.update()


def _stokes(raw: Float32Array) -> Float32Array:
    """s0, s1, s2 of the green channel, the one with the largest response at 555 nm.

    The integrator appends S0.R, S0.G, S0.B, S1.R, … S3.B to the film's own channels.
    """
    first = raw.shape[-1] - 12
    return raw[..., [first + 1, first + 4, first + 7]]


def _response(mi: ModuleType, base_scene: dict[str, Any], light: Light) -> float:
    """Value of the green channel for a radiance of 1: the sRGB weight of the 1 nm.

    Mitsuba makes spectra of a map's colours in another way than of plain numbers: for maps, the
    weight is measured on a map of ones.
    """
    look = base_scene["sensor"]
    small = look | {"film": look["film"] | {"width": 8, "height": 8}}
    sky: dict[str, Any] = {"type": "constant", "radiance": {"type": "uniform", "value": 1.0}}
    if isinstance(light, MapLight):
        sky = {"type": "envmap", "bitmap": mi.Bitmap(np.ones((2, 4, 3), np.float32))}
    scene = mi.load_dict(
        {
            "type": "scene",
            "sensor": small,
            "sky": sky,
            "integrator": {"type": "stokes", "direct": {"type": "path", "max_depth": 2}},
        }
    )
    return float(_stokes(np.asarray(mi.render(scene, spp=64, seed=0)))[..., 0].mean())


def _geometry(
    mi: ModuleType, base_scene: dict[str, Any], sampling: Sampling
) -> tuple[Float32Array, BoolArray, BoolArray]:
    """Mean shading normals (pixels, 3); whether pixels are touched, and covered, by the object."""
    variables = {"type": "aov", "aovs": "normal:sh_normal,hit:shape_index"}
    scene = _load(mi, base_scene, {"type": "diffuse"}, integrator=variables)
    raw = np.asarray(mi.render(scene, spp=sampling.samples, seed=sampling.seed))
    names = list(scene.integrator().aov_names())
    channels = raw[..., raw.shape[-1] - len(names) :].reshape(-1, len(names))
    normals = channels[:, [names.index(f"normal.{axis}") for axis in "XYZ"]]
    hits = channels[:, names.index("hit.I")]
    all_hit = hits > 1 - 0.5 / sampling.samples
    return normals, hits > 0, all_hit & inside(mi, scene, base_scene["sensor"]["film"]["width"])
