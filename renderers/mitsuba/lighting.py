"""Importance sampling of the light at a hit: random directions towards it, and their weights.

A sampler is called with a hit and returns a local direction towards the light, a weight, the
radiance divided by the probability density of that direction, and the Stokes vector of the light
over its radiance, in Mitsuba's frame of that direction. Where directions are
drawn both from the light and from the BSDF, the balance heuristic of Veach and Guibas (SIGGRAPH
1995) divides by the sum of both densities. The densities of Mitsuba's BSDFs used here do not depend
on η, so that the same directions serve every node.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Self

import numpy as np

from malus.scenes.core.arrays import Float32Array, Float64Array
from malus.scenes.lights.angles import incidence_and_azimuth
from malus.scenes.lights.environment import radiance_map
from malus.scenes.lights.lights import Area, Distant, Light, MapLight, Uniform
from malus.scenes.lights.polarised import Oscillation, oscillation
from malus.scenes.lights.sky import parts

Pairs = list[tuple[Any, Any]]
"""Pairs of (local direction, weight)."""
Draws = list[tuple[Any, Any, list[Any]]]
"""Triples of (local direction, weight, Stokes vector over s0: of one component if unpolarised)."""

NEAR = 1e-4
"""Least angle between a distant lamp and the camera, radians, as a hit sees them: closer ones are
taken for this far apart, by which polarisation changes by 1e-9."""


@dataclass
class Sampler:
    """Draws directions towards the parts of a light.

    Its values are fields, so that a function recorded by Dr.Jit can be called with other values.
    """

    parts: list[Any]
    polarised: list[Any]

    def __call__(self, hit: Any, bsdf: Any, random: Any, valid: Any) -> Draws:
        """Directions, weights and Stokes vectors for a hit, some of them drawn from the BSDF."""
        return [
            (direction, weight, _arriving(hit, direction, polarised))
            for part, polarised in zip(self.parts, self.polarised, strict=True)
            for direction, weight in part.draws(hit, bsdf, random, valid)
        ]


def _arriving(hit: Any, direction: Any, polarised: Any) -> list[Any]:
    """Stokes vector over s0 of the light from a local direction."""
    import mitsuba as mi

    return [mi.Float(1.0)] if polarised is None else polarised.stokes(hit.to_world(direction))


def sampler(mi: ModuleType, light: Light, scene: Any) -> Sampler:
    """The sampler of a light; another light of the same kind needs no new kernel.

    A radiance map is taken from `scene`, which also holds the objects: on CUDA a kernel can trace
    rays in one scene only.
    """
    several = parts(light)
    polarised = [polarised_by(mi, oscillation(part)) for part in several]
    return Sampler([_part(mi, part, scene) for part in several], polarised)


def radiance_map_of(light: Light) -> MapLight | None:
    """The part of a light that is a radiance map, or None; it has to be part of a Mitsuba scene."""
    return next((p for p in parts(light) if isinstance(p, MapLight)), None)


def _part(mi: ModuleType, light: Light, scene: Any) -> Any:
    if isinstance(light, Distant):
        return _Distant(vector(mi, light.direction), constant(mi, light.irradiance))
    if isinstance(light, Uniform):
        return _Uniform(constant(mi, light.radiance))
    if isinstance(light, Area):
        return _Area(Cone.of(mi, light))
    return _Environment(scene.environment())


def polarised_by(mi: ModuleType, how: Oscillation | None) -> Any:
    """What gives the Stokes vector of the light from a direction; None for unpolarised light."""
    if how is None:
        return None
    kind = _Scattered if how.scattered else _Filtered
    return kind(vector(mi, how.axis), constant(mi, how.degree))


@dataclass
class _Filtered:
    """`Oscillation` of the light behind a polariser."""

    axis: Any
    degree: Any

    def stokes(self, toward: Any) -> list[Any]:
        x, y = _across(toward, self.axis)
        return _stokes(x, y, self.degree / (x * x + y * y))


@dataclass
class _Scattered:
    """`Oscillation` of the light of a sky."""

    axis: Any
    degree: Any

    def stokes(self, toward: Any) -> list[Any]:
        x, y = _across(toward, self.axis)
        return _stokes(x, y, self.degree / (2.0 - x * x - y * y))


def _across(toward: Any, axis: Any) -> tuple[Any, Any]:
    """Components of toward × axis in Mitsuba's frame of light that travels along −toward."""
    import drjit as dr
    import mitsuba as mi

    horizontal = mi.mueller.stokes_basis(-toward)
    along = dr.cross(toward, axis)
    # The frame's y axis is its z axis, the way the light goes, times its x axis.
    return dr.dot(along, horizontal), dr.dot(along, dr.cross(-toward, horizontal))


def _stokes(x: Any, y: Any, scale: Any) -> list[Any]:
    import mitsuba as mi

    return [mi.Float(1.0), (x * x - y * y) * scale, 2.0 * x * y * scale]


def constant(mi: ModuleType, value: float) -> Any:
    """A number that kernels take as data: another value needs no new kernel."""
    import drjit as dr

    return dr.opaque(mi.Float, value)


def vector(mi: ModuleType, values: Any) -> Any:
    """A vector of `constant` components."""
    return mi.Vector3f(*(constant(mi, float(value)) for value in values))


def _from_bsdf(hit: Any, bsdf: Any, random: Any, valid: Any) -> tuple[Any, Any]:
    """A local direction drawn from the BSDF and its probability density, zero off the object."""
    import drjit as dr
    import mitsuba as mi

    u = random.next_float32()
    uv = mi.Point2f(random.next_float32(), random.next_float32())
    drawn, _ = bsdf.sample(mi.BSDFContext(), hit, u, uv, valid)
    return drawn.wo, dr.select(valid, drawn.pdf, 0.0)


@dataclass
class _Distant:
    direction: Any
    irradiance: Any

    def draws(self, hit: Any, _bsdf: Any, _random: Any, valid: Any) -> Pairs:
        import drjit as dr
        import mitsuba as mi

        toward = hit.to_local(self.direction)
        # A lamp at the camera: Mitsuba's plane of incidence has no direction there, and now and
        # then its Mueller matrix is not a number.
        near = dr.squared_norm(toward - hit.wi) < NEAR**2
        turned = mi.Vector3f(toward.x + NEAR * toward.z, toward.y, toward.z - NEAR * toward.x)
        toward = dr.select(near, dr.normalize(turned), toward)
        return [(toward, dr.select(valid, self.irradiance, 0.0))]


def beside(light: Light, to_camera: Float64Array) -> Light:
    """A light as `_Distant` draws it, for Mitsuba's own integrators: not quite at the camera."""
    if not isinstance(light, Distant) or np.linalg.norm(light.direction - to_camera) >= NEAR:
        return light
    across = np.cross(to_camera, np.eye(3)[np.argmin(np.abs(to_camera))])
    turned = to_camera + NEAR * across / np.linalg.norm(across)
    return light.model_copy(update=incidence_and_azimuth(turned))


@dataclass
class _Uniform:
    radiance: Any

    def draws(self, hit: Any, bsdf: Any, random: Any, valid: Any) -> Pairs:
        import drjit as dr

        direction, density = _from_bsdf(hit, bsdf, random, valid)
        return [(direction, dr.select(density > 0, self.radiance / density, 0.0))]


@dataclass
class Cone:
    """Directions around that of a lamp, of equal radiance; `span` is 1 − cos of the half angle."""

    toward: Any
    span: Any
    radiance: Any

    @classmethod
    def of(cls, mi: ModuleType, light: Area) -> Self:
        """The cone of a lamp."""
        # Without cancellation, which in 32 bits matters for small lamps.
        span = constant(mi, 2.0 * math.sin(0.5 * math.radians(light.half_angle_deg)) ** 2)
        return cls(vector(mi, light.direction), span, constant(mi, light.radiance))

    @property
    def density(self) -> Any:
        """Probability density of its directions over solid angle."""
        import drjit as dr

        return 1.0 / (2.0 * dr.pi * self.span)

    def direction(self, uv: Any) -> Any:
        """The direction in it for two random numbers."""
        import drjit as dr
        import mitsuba as mi

        drop = uv.x * self.span
        sine = dr.sqrt(drop * (2.0 - drop))
        sin_phi, cos_phi = dr.sincos(2.0 * dr.pi * uv.y)
        local = mi.Vector3f(sine * cos_phi, sine * sin_phi, 1.0 - drop)
        return mi.Frame3f(self.toward).to_world(local)

    def holds(self, direction: Any) -> Any:
        """Whether a direction is in it."""
        import drjit as dr
        import mitsuba as mi

        away = mi.Frame3f(self.toward).to_local(direction) - mi.Vector3f(0, 0, 1)
        return 0.5 * dr.squared_norm(away) <= self.span


@dataclass
class _Area:
    cone: Cone

    def draws(self, hit: Any, bsdf: Any, random: Any, valid: Any) -> Pairs:
        import drjit as dr
        import mitsuba as mi

        cone = self.cone
        uv = mi.Point2f(random.next_float32(), random.next_float32())
        first = hit.to_local(cone.direction(uv))
        other = bsdf.pdf(mi.BSDFContext(), hit, first, valid)
        second, drawn = _from_bsdf(hit, bsdf, random, valid)
        inside = (drawn > 0) & cone.holds(hit.to_world(second))
        return [
            (first, dr.select(valid, cone.radiance / (cone.density + other), 0.0)),
            (second, dr.select(inside, cone.radiance / (cone.density + drawn), 0.0)),
        ]


@dataclass
class _Environment:
    emitter: Any

    def draws(self, hit: Any, bsdf: Any, random: Any, valid: Any) -> Pairs:
        import drjit as dr
        import mitsuba as mi

        uv = mi.Point2f(random.next_float32(), random.next_float32())
        sample, _ = self.emitter.sample_direction(hit, uv, valid)
        first = hit.to_local(sample.d)
        other = bsdf.pdf(mi.BSDFContext(), hit, first, valid)
        usable = valid & (sample.pdf > 0)
        second, drawn = _from_bsdf(hit, bsdf, random, valid)
        back = dr.zeros(mi.DirectionSample3f)
        back.d = hit.to_world(second)
        density = self.emitter.pdf_direction(hit, back, valid)
        total = dr.select(drawn > 0, density + drawn, 1.0)
        return [
            (
                first,
                dr.select(usable, self._radiance(sample.d, usable) / (sample.pdf + other), 0.0),
            ),
            (second, dr.select(drawn > 0, self._radiance(back.d, drawn > 0) / total, 0.0)),
        ]

    def _radiance(self, direction: Any, active: Any) -> Any:
        import drjit as dr
        import mitsuba as mi

        interaction = dr.zeros(mi.SurfaceInteraction3f)
        interaction.wi = -direction
        return self.emitter.eval(interaction, active)[0, 0][0]


def environment_emitter(mi: ModuleType, light: MapLight) -> dict[str, Any]:
    """Mitsuba's `envmap` of a radiance map, turned as the light is."""
    values = _from_pole_to_pole(radiance_map(light))
    bitmap = mi.Bitmap(np.ascontiguousarray(np.repeat(values[..., None], 3, axis=-1)))
    to_world = mi.ScalarTransform4f().rotate([0, 0, 1], light.turn_deg)
    if light.tilt_deg or light.heading_deg:
        tilt = mi.ScalarTransform4f().rotate([1, 0, 0], light.tilt_deg)
        to_world = to_world @ tilt @ mi.ScalarTransform4f().rotate([0, 1, 0], light.heading_deg)
    return {"type": "envmap", "bitmap": bitmap, "to_world": to_world}


def _from_pole_to_pole(rows: Float32Array) -> Float32Array:
    """A map (height, width) as (2 height + 1, width): its own rows, and those half-way between.

    A row of a map is a band of directions. Mitsuba has the first row straight up and the last one
    straight down, and interpolates between; here each row of the map stands in the middle of its
    band.
    """
    fine = np.empty((2 * len(rows) + 1, rows.shape[1]), rows.dtype)
    fine[1::2] = rows
    fine[0], fine[-1] = rows[0], rows[-1]
    fine[2:-1:2] = 0.5 * (rows[:-1] + rows[1:])
    return fine
