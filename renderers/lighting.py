"""How light reaches a hit: directions to shade it from, and what each of them is worth.

A sampler is called with a hit and returns pairs of a local direction towards the light and a
weight, the radiance over the density of having drawn that direction. Where directions come both
from the light and from the BSDF, the balance heuristic of Veach and Guibas (SIGGRAPH 1995) makes
the weight radiance / (density of one + density of the other) in both cases. The densities of
Mitsuba's BSDFs used here do not depend on η, so that one draw serves every node.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np

from malus.scenes.environment import radiance_map
from malus.scenes.lights import Area, Distant, Environment, Light, Sky, Uniform
from malus.scenes.sky import parts

Draws = list[tuple[Any, Any]]
Sampler = Callable[[Any, Any, Any, Any], Draws]
"""(hit, bsdf, random, valid) -> pairs of (local direction, weight)."""


def sampler(mi: ModuleType, light: Light) -> Sampler:
    """The sampler of a light; parameters are opaque, so that no light needs a new kernel."""
    samplers = [_sampler(mi, part) for part in parts(light)]

    def draw(hit: Any, bsdf: Any, random: Any, valid: Any) -> Draws:
        return [pair for one in samplers for pair in one(hit, bsdf, random, valid)]

    return draw


def _sampler(mi: ModuleType, light: Light) -> Sampler:
    if isinstance(light, Distant):
        return _distant(mi, light)
    if isinstance(light, Uniform):
        return _uniform(mi, light)
    if isinstance(light, Area):
        return _area(mi, light)
    return _environment(mi, light)


def _constant(mi: ModuleType, value: float) -> Any:
    import drjit as dr

    return dr.opaque(mi.Float, value)


def _vector(mi: ModuleType, values: Any) -> Any:
    return mi.Vector3f(*(_constant(mi, float(value)) for value in values))


def _from_bsdf(mi: ModuleType, hit: Any, bsdf: Any, random: Any, valid: Any) -> tuple[Any, Any]:
    """A local direction drawn from the BSDF and its density, zero where there is none."""
    import drjit as dr

    u = random.next_float32()
    uv = mi.Point2f(random.next_float32(), random.next_float32())
    drawn, _ = bsdf.sample(mi.BSDFContext(), hit, u, uv, valid)
    return drawn.wo, dr.select(valid, drawn.pdf, 0.0)


def _distant(mi: ModuleType, light: Distant) -> Sampler:
    import drjit as dr

    direction = _vector(mi, light.direction)
    irradiance = _constant(mi, light.irradiance)

    def draw(hit: Any, bsdf: Any, random: Any, valid: Any) -> Draws:
        return [(hit.to_local(direction), dr.select(valid, irradiance, 0.0))]

    return draw


def _uniform(mi: ModuleType, light: Uniform) -> Sampler:
    import drjit as dr

    radiance = _constant(mi, light.radiance)

    def draw(hit: Any, bsdf: Any, random: Any, valid: Any) -> Draws:
        direction, density = _from_bsdf(mi, hit, bsdf, random, valid)
        return [(direction, dr.select(density > 0, radiance / density, 0.0))]

    return draw


def _area(mi: ModuleType, light: Area) -> Sampler:
    import drjit as dr

    frame = mi.Frame3f(_vector(mi, light.direction))
    # 1 − cos of the half angle, which for a small one would lose its digits in 32 bits.
    span = _constant(mi, 2.0 * math.sin(0.5 * math.radians(light.half_angle_deg)) ** 2)
    radiance = _constant(mi, light.radiance)
    density = 1.0 / (2.0 * dr.pi * span)

    def draw(hit: Any, bsdf: Any, random: Any, valid: Any) -> Draws:
        uv = mi.Point2f(random.next_float32(), random.next_float32())
        drop = uv.x * span
        sine = dr.sqrt(drop * (2.0 - drop))
        sin_phi, cos_phi = dr.sincos(2.0 * dr.pi * uv.y)
        local = mi.Vector3f(sine * cos_phi, sine * sin_phi, 1.0 - drop)
        first = hit.to_local(frame.to_world(local))
        other = bsdf.pdf(mi.BSDFContext(), hit, first, valid)
        second, drawn = _from_bsdf(mi, hit, bsdf, random, valid)
        away = frame.to_local(hit.to_world(second)) - mi.Vector3f(0, 0, 1)
        inside = (drawn > 0) & (0.5 * dr.squared_norm(away) <= span)
        return [
            (first, dr.select(valid, radiance / (density + other), 0.0)),
            (second, dr.select(inside, radiance / (density + drawn), 0.0)),
        ]

    return draw


def _environment(mi: ModuleType, light: Environment | Sky) -> Sampler:
    import drjit as dr

    scene = _environment_scene(mi.variant(), light)
    emitter = scene.emitters()[0]

    def radiance(direction: Any, active: Any) -> Any:
        seen = dr.zeros(mi.SurfaceInteraction3f)
        seen.wi = -direction
        return emitter.eval(seen, active)[0, 0][0]

    def draw(hit: Any, bsdf: Any, random: Any, valid: Any) -> Draws:
        uv = mi.Point2f(random.next_float32(), random.next_float32())
        sample, _ = emitter.sample_direction(hit, uv, valid)
        first = hit.to_local(sample.d)
        other = bsdf.pdf(mi.BSDFContext(), hit, first, valid)
        usable = valid & (sample.pdf > 0)
        second, drawn = _from_bsdf(mi, hit, bsdf, random, valid)
        back = dr.zeros(mi.DirectionSample3f)
        back.d = hit.to_world(second)
        density = emitter.pdf_direction(hit, back, valid)
        total = dr.select(drawn > 0, density + drawn, 1.0)
        return [
            (first, dr.select(usable, radiance(sample.d, usable) / (sample.pdf + other), 0.0)),
            (second, dr.select(drawn > 0, radiance(back.d, drawn > 0) / total, 0.0)),
        ]

    return draw


@functools.lru_cache(maxsize=2)
def _environment_scene(variant: str, light: Environment | Sky) -> Any:
    """A scene that holds nothing but the map; the ball only gives it a size."""
    import mitsuba as mi

    assert mi.variant() == variant
    ball = {"type": "sphere"}
    return mi.load_dict({"type": "scene", "map": environment_emitter(mi, light), "ball": ball})


def environment_emitter(mi: ModuleType, light: Environment | Sky) -> dict[str, Any]:
    """Mitsuba's `envmap` of the light, whose y axis is up before it is turned."""
    values = radiance_map(light)
    bitmap = mi.Bitmap(np.ascontiguousarray(np.repeat(values[..., None], 3, axis=-1)))
    turn = mi.ScalarTransform4f().rotate([0, 0, 1], light.turn_deg)
    return {"type": "envmap", "bitmap": bitmap, "to_world": turn}
