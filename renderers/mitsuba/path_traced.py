"""Scenes of several objects, lit by each other: both lobes of every pixel, by tracing paths.

Mitsuba's own BSDFs and its `path` integrator do the work. Where a ray of the camera first meets an
object, the BSDF is asked for the mirrored and the scattered light apart. Light comes to that point
from the light itself, drawn as in `lighting` and shadowed by all objects, and from the other
objects: along a direction drawn from the BSDF, as the Stokes vector that the integrator finds there
with the light hidden from it. Bands follow one another with the same random numbers, so that their
noise is alike and colours are not speckled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.renderers.mitsuba.coverage import covering
from malus.renderers.mitsuba.lighting import Sampler, sampler
from malus.renderers.mitsuba.lobe_samples import HALVES, Floats, unit
from malus.renderers.mitsuba.patterns import surface_shares
from malus.renderers.mitsuba.placed import painted, parts_of, pattern_on, placed_object
from malus.renderers.mitsuba.pooled import pooled
from malus.renderers.mitsuba.rays import Film, stream_number, streams, to_camera_frame
from malus.renderers.mitsuba.translate import LAMP_DISTANCE, emitters, sensor
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.core.errors import InputError
from malus.scenes.materials.surface import Patterned
from malus.scenes.scene import Sampling, Scene

PIXELS_A_LAUNCH = 1 << 16

_NORMAL, _SPECULAR, _DIFFUSE, _SQUARES = (slice(i, i + 3) for i in (0, 3, 6, 9))
_HITS = 12
_CHANNELS = 13


def render_room(scene: Scene, sampling: Sampling, variant: Variant) -> Truth:
    """The truth of a scene with surroundings; all objects are seen, and all are in the mask.

    Raises
    ------
    InputError
        In the scalar variant, which cannot keep the lobes apart along a path.
    """
    if not variant.vectorised:
        hint = "install LLVM 17 or later (`malus doctor` says how), or leave the surroundings out"
        where, expected = f"scene {scene.id}", "LLVM or CUDA for a scene of several objects"
        raise InputError(where, expected, variant.name, hint)
    return Room(mitsuba(variant), scene, sampling).truth()


@dataclass(frozen=True)
class Rendered:
    """A family of one scene, which is rendered as it is; `whole` is its truth."""

    whole: Truth

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        """The truth, as of a `Family`; raises ValueError for another scene."""
        if scene != self.whole.scene:
            raise ValueError(f"scene {scene.id}: expected scene {self.whole.scene.id}")
        if standard_error:
            return self.whole
        return replace(self.whole, standard_error=np.zeros_like(self.whole.standard_error))


class Room:
    """Objects before a camera, under a light."""

    def __init__(self, mi: ModuleType, described: Scene, sampling: Sampling) -> None:
        self.mi, self.described, self.sampling = mi, described, sampling
        scene = described
        coats = [painted(mi, placed) for placed in scene.objects]
        self.paints = [paint for _, paints in coats for paint in paints]
        self.shapes = [
            placed_object(mi, placed, bsdf)
            for placed, (bsdf, _) in zip(scene.objects, coats, strict=True)
        ]
        parts = {f"object{i}": shape for i, shape in enumerate(self.shapes)}
        reach = _reach(scene)
        away = scene.camera.distance or 2 * reach
        # One scene, because a kernel on CUDA traces rays in one scene only. Rays of the camera and
        # shadow rays end before the lamp, paths of light reach it.
        self.far, lamp = away + 2 * reach, max(LAMP_DISTANCE * reach, 10 * away)
        self.scene = mi.load_dict(
            {"type": "scene", "sensor": sensor(mi, scene.camera, 2 * reach)}
            | emitters(mi, scene.light, lamp)
            | parts
        )
        self.film = Film.of(self.scene.sensors()[0], scene.camera.resolution, self.far)
        self.owner = covering(mi, self.film, self.scene, self.shapes)
        self.path = _path(mi, sampling.max_depth)
        everything, flags = mi.TransportMode.Radiance, mi.BSDFFlags
        self.any = mi.BSDFContext()
        self.lobes = [
            mi.BSDFContext(everything, int(flags.GlossyReflection | flags.DeltaReflection)),
            mi.BSDFContext(everything, int(flags.DiffuseReflection)),
        ]

    def truth(self) -> Truth:
        """All bands."""
        scene, side = self.described, self.described.camera.resolution
        sums = np.stack([self._band(band) for band in range(len(scene.wavelengths_nm))], axis=-1)
        samples = self.sampling.samples
        # (channels, halves, pixels, bands) -> (halves, height, width, bands, 3), means of a half
        specular, diffuse, squares = (
            np.moveaxis(sums[part], 0, -1).reshape(HALVES, side, side, -1, 3) / (samples // HALVES)
            for part in (_SPECULAR, _DIFFUSE, _SQUARES)
        )
        # Rounding can leave a tiny negative variance where all samples are equal.
        variance = np.maximum(squares.mean(axis=0) - (specular + diffuse).mean(axis=0) ** 2, 0)
        axes = scene.camera.axes.astype(np.float32)
        normals = (sums[_NORMAL, :, :, 0].sum(axis=1).T @ axes.T).reshape(side, side, 3)
        covered = (self.owner >= 0) & (sums[_HITS, :, :, 0].sum(axis=0) == samples)
        owner = np.where(covered, self.owner, -1).reshape(side, side)
        eta, alpha = self._maps()
        return Truth(
            scene=scene,
            specular=specular.mean(axis=0),
            diffuse=diffuse.mean(axis=0),
            normals=unit(normals),
            mask=owner >= 0,
            standard_error=np.sqrt(pooled(variance, owner) / np.float32(samples - 1)),
            specular_noise=0.5 * (specular[0] - specular[1]),
            diffuse_noise=0.5 * (diffuse[0] - diffuse[1]),
            interpolation_error={"rms": 0.0, "worst": 0.0},
            eta_map=eta,
            alpha_map=alpha,
        )

    def _maps(self) -> tuple[NDArray[np.inexact[Any]], NDArray[np.float64]]:
        """η (height, width, bands) and α (height, width); off the objects those of the first."""
        side, bands = self.described.camera.resolution, self.described.wavelengths_nm
        owner = np.maximum(self.owner, 0)
        parts = [parts_of(placed.surface) for placed in self.described.objects]
        indices = [np.stack([part.indices(bands) for part in own]) for own in parts]
        eta = np.empty((side**2, len(bands)), dtype=np.result_type(*indices))
        alpha = np.empty(side**2)
        for number, placed in enumerate(self.described.objects):
            here, seen = owner == number, np.ones((side**2, 1), dtype=np.float32)
            if isinstance(placed.surface, Patterned):
                at = pattern_on(self.mi, placed)
                seen = surface_shares(self.mi, self.film, self.scene, at, len(parts[number]))
            eta[here] = seen[here] @ indices[number]
            alpha[here] = seen[here] @ [part.alpha for part in parts[number]]
        return eta.reshape(side, side, -1), alpha.reshape(side, side)

    def _band(self, band: int) -> Floats:
        """Sums over the samples of every half and pixel, (channels, halves, pixels)."""
        nm = (self.described.wavelengths_nm[band],)
        for paint in self.paints:
            albedo = paint.surface.albedos(self.described.wavelengths_nm)[band]
            paint.set_band(paint.surface.indices(nm)[0].item(), float(albedo))
        light = sampler(self.mi, self.described.light, self.scene)
        total = self.described.camera.resolution**2
        sums = np.empty((_CHANNELS, HALVES, total), dtype=np.float32)
        for start in range(0, total, PIXELS_A_LAUNCH):
            pixels = np.arange(start, min(start + PIXELS_A_LAUNCH, total), dtype=np.uint32)
            self._launch(pixels, light, sums[:, :, pixels[0] : pixels[-1] + 1])
        return sums

    def _launch(self, pixels: NDArray[np.uint32], light: Sampler, result: Floats) -> None:
        import drjit as dr

        mi, count = self.mi, HALVES * len(pixels)
        thread = dr.arange(mi.UInt32, count)
        half, local = thread // len(pixels), thread % len(pixels)
        pixel = dr.gather(mi.UInt32, mi.UInt32(pixels), local)
        owner = dr.gather(mi.Int32, mi.Int32(self.owner[pixels]), local)
        seed = dr.opaque(mi.UInt32, self.sampling.seed)
        rays, draws = streams(mi, stream_number(pixel, half), seed)
        further = mi.load_dict({"type": "independent"})
        further.seed(self.sampling.seed + int(pixels[0]), count)

        def step(i: Any, sums: list[Any], rays: Any, draws: Any, further: Any) -> tuple[Any, ...]:
            ray = self.film.ray(mi, pixel, rays)
            values = self._sample(ray, owner, light, draws, further)
            sums = [s + v for s, v in zip(sums, values, strict=True)]
            return i + 1, sums, rays, draws, further

        samples = dr.opaque(mi.UInt32, self.sampling.samples // HALVES)
        zeros = [dr.zeros(mi.Float, count) for _ in range(_CHANNELS)]
        state = (dr.zeros(mi.UInt32, count), zeros, rays, draws, further)
        _, sums, *_ = dr.while_loop(state, lambda i, *_: i < samples, step)
        dr.eval(sums)
        for row, values in zip(result, sums, strict=True):
            row[:] = np.asarray(values).reshape(HALVES, -1)

    def _sample(self, ray: Any, owner: Any, light: Sampler, draws: Any, further: Any) -> list[Any]:
        """What one ray adds to every channel."""
        import drjit as dr

        mi = self.mi
        hit = self.scene.ray_intersect(ray)
        valid = hit.is_valid()
        shaded = [mi.Float(0.0) for _ in range(3 * len(self.lobes))]
        to_camera = to_camera_frame(mi, self.film.sensor, ray)
        for direction, weight, stokes in self._incoming(hit, light, draws, further):
            for k, lobe in enumerate(self.lobes):
                mueller = hit.bsdf().eval(lobe, hit, direction, valid)
                mueller = to_camera @ hit.to_world_mueller(mueller, -direction, hit.wi)
                for row in range(3):
                    seen = sum(mueller[row, j][0] * s for j, s in enumerate(stokes))
                    shaded[3 * k + row] += dr.select(weight > 0, seen * weight, 0.0)
        normal = [dr.select(valid, c, 0.0) for c in hit.sh_frame.n]
        whole = [a + b for a, b in zip(shaded[:3], shaded[3:], strict=True)]
        own = mi.Bool(False)
        for index, shape in enumerate(self.shapes):
            own |= (hit.shape == mi.ShapePtr(shape)) & (owner == index)
        return [*normal, *shaded, *(w * w for w in whole), dr.select(own, mi.Float(1), 0.0)]

    def _incoming(self, hit: Any, light: Sampler, draws: Any, further: Any) -> list[Any]:
        """Directions (local), weights and Stokes vectors of light that comes to a hit."""
        import drjit as dr

        mi, valid, bsdf = self.mi, hit.is_valid(), hit.bsdf()
        found = []
        for direction, weight in light(hit, bsdf, draws, valid):
            ray = hit.spawn_ray(hit.to_world(direction))
            ray.maxt = mi.Float(self.far)
            matters = valid & (weight > 0) & (direction.z > 0)  # as `View.incoming`
            shadow = self.scene.ray_test(ray, matters)
            found.append((direction, dr.select(shadow, 0.0, weight), [mi.Float(1.0)]))
        if self.path is None:
            return found
        u, uv = draws.next_float32(), mi.Point2f(draws.next_float32(), draws.next_float32())
        drawn, _ = bsdf.sample(self.any, hit, u, uv, valid)
        usable = valid & (drawn.pdf > 0)
        ray = mi.RayDifferential3f(hit.spawn_ray(hit.to_world(drawn.wo)))
        radiance, _, _ = self.path.sample(self.scene, further, ray, None, usable)
        stokes = [radiance[row, 0][0] for row in range(4)]
        return [*found, (drawn.wo, dr.select(usable, 1.0 / drawn.pdf, 0.0), stokes)]


def _path(mi: ModuleType, max_depth: int) -> Any:
    """The integrator of what other objects send; None where light meets one object only."""
    if max_depth == 2:
        return None
    return mi.load_dict({"type": "path", "max_depth": max_depth - 1, "hide_emitters": True})


def _reach(scene: Scene) -> float:
    """Beyond all objects: where an orthographic camera stands."""
    return max(math.hypot(*p.position) + 2 * p.scale for p in scene.objects)
