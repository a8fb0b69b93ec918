"""Emitters of our own for Mitsuba's path integrator: polarised lights, and parallel light.

In a polarised variant an emitter's radiance is a Mueller matrix, whose first column is the Stokes
vector of its light in Mitsuba's frame of the ray. Mitsuba's own emitters are unpolarised; these
fill it: light that other objects reflect then keeps how the lamp polarised it. Mitsuba's parallel
light has the bounds of its scene as constants in every kernel, so that no two scenes share one.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from malus.renderers.mitsuba.lighting import Cone, constant, polarised_by, vector
from malus.renderers.mitsuba.translate import LAMP_DISTANCE, emitter
from malus.scenes.lights.lights import Area, Distant, Light
from malus.scenes.lights.polarised import oscillation
from malus.scenes.lights.sky import parts

_BEYOND = 2.0
"""Distance, in radii of the objects, that shadow rays towards a light are traced to."""


def room_emitters(
    mi: ModuleType, light: Light, reach: float, lamp_distance: float = LAMP_DISTANCE
) -> dict[str, Any]:
    """The parts of a light as emitters of a scene of several objects, by name.

    Parameters
    ----------
    light : Light
    reach : float
        Radius of a sphere around the origin that holds all objects.
    lamp_distance : float
        Distance of the disk that an unpolarised lamp is; a polarised one is a cone of directions.
    """
    return {
        f"light{k}": _emitter(mi, part, reach, lamp_distance) for k, part in enumerate(parts(light))
    }


def _emitter(mi: ModuleType, light: Light, reach: float, lamp_distance: float) -> Any:
    how = oscillation(light)
    if isinstance(light, Distant):
        source: Any = _DistantEmitter(mi, light, reach)
    elif isinstance(light, Area) and how is not None:
        source = _ConeEmitter(mi, light, reach)
    elif how is None:
        return emitter(mi, light, lamp_distance)
    else:
        source = mi.load_dict(emitter(mi, light))
    return _python_emitter(mi, source, polarised_by(mi, how))


def _python_emitter(mi: ModuleType, source: Any, how: Any) -> Any:
    """An emitter whose light is that of another one, polarised unless `how` is None."""
    emitter = _python_emitter_class(mi)(mi.Properties())
    emitter.source, emitter.how, emitter.m_flags = source, how, source.flags()
    return emitter


@functools.cache
def _python_emitter_class(mi: ModuleType) -> Any:
    """The class of the emitter: one for all, as each would be garbage only a collection removes.

    Dr.Jit counts the emitters of garbage, too, and kernels depend on their number.
    """

    class PythonEmitter(mi.Emitter):  # type: ignore[misc, name-defined]
        source: Any
        how: Any

        def set_scene(self, scene: Any) -> None:
            self.source.set_scene(scene)

        def sample_direction(self, reference: Any, sample: Any, active: Any = True) -> Any:
            towards, weight = self.source.sample_direction(reference, sample, active)
            towards.emitter = mi.EmitterPtr(self)
            return towards, _mueller(mi, self.how, towards.d) @ weight

        def eval_direction(self, reference: Any, towards: Any, active: Any = True) -> Any:
            radiance = self.source.eval_direction(reference, towards, active)
            return _mueller(mi, self.how, towards.d) @ radiance

        def pdf_direction(self, reference: Any, towards: Any, active: Any = True) -> Any:
            return self.source.pdf_direction(reference, towards, active)

        def eval(self, hit: Any, active: Any = True) -> Any:
            return _mueller(mi, self.how, -hit.wi) @ self.source.eval(hit, active)

        def to_string(self) -> str:
            return f"PythonEmitter[{self.source}]"

    return PythonEmitter


def _mueller(mi: ModuleType, how: Any, toward: Any) -> Any:
    """A matrix that makes the Stokes vector of polarised light of that of unpolarised light."""
    matrix = mi.Spectrum(0.0)
    for row, component in enumerate([1.0] if how is None else how.stokes(toward)):
        matrix[row, 0] = mi.UnpolarizedSpectrum(component)
    return matrix


@dataclass
class _DistantEmitter:
    """Parallel light, with the functions of a Mitsuba emitter."""

    mi: ModuleType
    light: Distant
    reach: float

    def __post_init__(self) -> None:
        self.toward = vector(self.mi, self.light.direction)
        self.irradiance = constant(self.mi, self.light.irradiance)
        self.distance = constant(self.mi, _BEYOND * self.reach)

    def flags(self) -> Any:
        return self.mi.EmitterFlags.Infinite | self.mi.EmitterFlags.DeltaDirection

    def set_scene(self, scene: Any) -> None:
        """It is infinitely far from any scene."""

    def sample_direction(self, reference: Any, _sample: Any, active: Any) -> Any:
        import drjit as dr

        towards = _towards(self.mi, reference, self.toward, self.distance)
        towards.pdf = self.mi.Float(1.0)
        towards.delta = self.mi.Bool(True)
        return towards, self.mi.Spectrum(dr.select(active, self.irradiance, 0.0))

    def pdf_direction(self, _reference: Any, _towards: Any, _active: Any) -> Any:
        return self.mi.Float(0.0)

    def eval_direction(self, _reference: Any, _towards: Any, _active: Any) -> Any:
        return self.mi.Spectrum(0.0)

    def eval(self, _hit: Any, _active: Any) -> Any:
        return self.mi.Spectrum(0.0)


def _towards(mi: ModuleType, reference: Any, direction: Any, distance: Any) -> Any:
    """What a path needs to know of a direction towards a light, but for its density."""
    import drjit as dr

    towards = dr.zeros(mi.DirectionSample3f, dr.width(reference.p))
    towards.d, towards.dist = direction, distance
    towards.p = reference.p + distance * direction
    towards.n = -direction
    towards.time = reference.time
    return towards


@dataclass
class _ConeEmitter:
    """Light from a cone of directions, with the functions of a Mitsuba emitter."""

    mi: ModuleType
    light: Area
    reach: float

    def __post_init__(self) -> None:
        self.cone = Cone.of(self.mi, self.light)
        self.distance = constant(self.mi, _BEYOND * self.reach)

    def flags(self) -> Any:
        return self.mi.EmitterFlags.Infinite

    def set_scene(self, scene: Any) -> None:
        """It is infinitely far from any scene."""

    def sample_direction(self, reference: Any, sample: Any, active: Any) -> Any:
        import drjit as dr

        direction = self.cone.direction(sample)
        towards = _towards(self.mi, reference, direction, self.distance)
        towards.pdf = self.cone.density
        radiance = dr.select(active, self.cone.radiance / self.cone.density, 0.0)
        return towards, self.mi.Spectrum(radiance)

    def pdf_direction(self, _reference: Any, towards: Any, _active: Any) -> Any:
        import drjit as dr

        return dr.select(self.cone.holds(towards.d), self.cone.density, 0.0)

    def eval_direction(self, _reference: Any, towards: Any, active: Any) -> Any:
        return self._radiance(towards.d, active)

    def eval(self, hit: Any, active: Any) -> Any:
        return self._radiance(-hit.wi, active)

    def _radiance(self, toward: Any, active: Any) -> Any:
        import drjit as dr

        inside = self.cone.holds(toward) & active
        return self.mi.Spectrum(dr.select(inside, self.cone.radiance, 0.0))
