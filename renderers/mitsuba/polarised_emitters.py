"""Polarised lights as emitters for Mitsuba's path integrator, whose own are unpolarised.

In a polarised variant an emitter's radiance is a Mueller matrix, whose first column is the Stokes
vector of its light in Mitsuba's frame of the ray. These emitters fill it: light that other objects
reflect then keeps how the lamp polarised it.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType
from typing import Any

from malus.renderers.mitsuba.lighting import Cone, polarised_by
from malus.renderers.mitsuba.translate import LAMP_DISTANCE, emitter
from malus.scenes.lights.lights import Area, Light
from malus.scenes.lights.polarised import oscillation
from malus.scenes.lights.sky import parts


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
    if how is None:
        return emitter(mi, light, lamp_distance)
    source = _ConeEmitter(mi, light, reach) if isinstance(light, Area) else None
    return _polarised(mi, source or mi.load_dict(emitter(mi, light)), polarised_by(mi, how))


def _polarised(mi: ModuleType, source: Any, how: Any) -> Any:
    """An emitter whose light is that of another one, polarised."""

    class PolarisedEmitter(mi.Emitter):  # type: ignore[misc, name-defined]
        def __init__(self) -> None:
            super().__init__(mi.Properties())
            self.m_flags = source.flags()

        def set_scene(self, scene: Any) -> None:
            source.set_scene(scene)

        def sample_direction(self, reference: Any, sample: Any, active: Any = True) -> Any:
            towards, weight = source.sample_direction(reference, sample, active)
            towards.emitter = mi.EmitterPtr(self)
            return towards, _mueller(mi, how, towards.d) @ weight

        def eval_direction(self, reference: Any, towards: Any, active: Any = True) -> Any:
            radiance = source.eval_direction(reference, towards, active)
            return _mueller(mi, how, towards.d) @ radiance

        def pdf_direction(self, reference: Any, towards: Any, active: Any = True) -> Any:
            return source.pdf_direction(reference, towards, active)

        def eval(self, hit: Any, active: Any = True) -> Any:
            return _mueller(mi, how, -hit.wi) @ source.eval(hit, active)

        def to_string(self) -> str:
            return f"PolarisedEmitter[{source}]"

    return PolarisedEmitter()


def _mueller(mi: ModuleType, how: Any, toward: Any) -> Any:
    """A matrix that makes the Stokes vector of polarised light of that of unpolarised light."""
    matrix = mi.Spectrum(0.0)
    for row, component in enumerate(how.stokes(toward)):
        matrix[row, 0] = mi.UnpolarizedSpectrum(component)
    return matrix


@dataclass
class _ConeEmitter:
    """Light from a cone of directions, with the functions of a Mitsuba emitter."""

    mi: ModuleType
    light: Area
    reach: float

    def __post_init__(self) -> None:
        self.cone = Cone.of(self.mi, self.light)

    def flags(self) -> Any:
        return self.mi.EmitterFlags.Infinite

    def set_scene(self, scene: Any) -> None:
        """It is infinitely far from any scene."""

    def sample_direction(self, reference: Any, sample: Any, active: Any) -> Any:
        import drjit as dr

        mi = self.mi
        towards = dr.zeros(mi.DirectionSample3f, dr.width(reference.p))
        towards.d = self.cone.direction(sample)
        # Beyond all objects.
        towards.dist = mi.Float(2.0 * self.reach)
        towards.p = reference.p + towards.dist * towards.d
        towards.n = -towards.d
        towards.pdf = self.cone.density
        towards.time = reference.time
        radiance = dr.select(active, self.cone.radiance / self.cone.density, 0.0)
        return towards, mi.Spectrum(radiance)

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
