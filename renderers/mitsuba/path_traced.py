"""Render scenes of several objects, which light each other, by tracing paths of light.

Mitsuba's own BSDFs and its `path` integrator do the work. Where a ray of the camera first meets an
object, the BSDF is evaluated for the specular and the diffuse lobe apart. That point is lit by the
light itself, sampled as in `lighting` and shadowed by all objects, and by the other objects: along
a direction drawn from the BSDF, by the Stokes vector that the integrator returns there with the
light hidden from it. All bands use the same random numbers, so that their noise is alike and
colours are not speckled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np

from malus.renderers.mitsuba.coverage import covering
from malus.renderers.mitsuba.lighting import Sampler, sampler
from malus.renderers.mitsuba.lobe_samples import HALVES, unit
from malus.renderers.mitsuba.patterns import surface_shares
from malus.renderers.mitsuba.placed import object_bsdf, parts_of, pattern_on, placed_object
from malus.renderers.mitsuba.polarised_emitters import room_emitters
from malus.renderers.mitsuba.pooled import pooled
from malus.renderers.mitsuba.rays import Film, stream_number, streams, to_camera_frame
from malus.renderers.mitsuba.translate import LAMP_DISTANCE, sensor
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.core.arrays import Float32Array, Float64Array, NumberArray, UInt32Array
from malus.scenes.core.errors import InputError
from malus.scenes.materials.surface import Patterned
from malus.scenes.scene import Sampling, Scene

PIXELS_A_LAUNCH = 1 << 16

_NORMAL, _SPECULAR, _DIFFUSE, _SQUARES = (slice(i, i + 3) for i in (0, 3, 6, 9))
_HITS = 12
_CHANNELS = 13
"""Channels of the sums over samples: normal, both lobes, squares of their sum, and hits."""


def render_room(scene: Scene, sampling: Sampling, variant: Variant) -> Truth:
    """The truth of a scene with surroundings; its mask holds the pixels of all objects.

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
class RenderedScene:
    """A family of one scene, whose truth is the render itself, without interpolation."""

    rendered_truth: Truth

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        """The truth, as from a `Family`; raises ValueError for another scene."""
        if scene != self.rendered_truth.scene:
            raise ValueError(f"scene {scene.id}: expected scene {self.rendered_truth.scene.id}")
        if standard_error:
            return self.rendered_truth
        return replace(
            self.rendered_truth, standard_error=np.zeros_like(self.rendered_truth.standard_error)
        )


class Room:
    """A Mitsuba scene of several objects, ready to render every band of it."""

    def __init__(self, mi: ModuleType, described: Scene, sampling: Sampling) -> None:
        self.mi, self.described, self.sampling = mi, described, sampling
        scene = described
        object_bsdfs = [object_bsdf(mi, placed) for placed in scene.objects]
        self.bsdfs = [bsdf for _, bsdfs in object_bsdfs for bsdf in bsdfs]
        self.shapes = [
            placed_object(mi, placed, bsdf)
            for placed, (bsdf, _) in zip(scene.objects, object_bsdfs, strict=True)
        ]
        parts = {f"object{i}": shape for i, shape in enumerate(self.shapes)}
        reach = _reach(scene)
        away = scene.camera.distance or 2 * reach
        # One scene, because a kernel on CUDA traces rays in one scene only. Rays of the camera and
        # shadow rays end before the lamp, which is an object too; paths of light reach it.
        self.ray_length, lamp = away + 2 * reach, max(LAMP_DISTANCE * reach, 10 * away)
        self.scene = mi.load_dict(
            {"type": "scene", "sensor": sensor(mi, scene.camera, 2 * reach)}
            | room_emitters(mi, scene.light, reach, lamp)
            | parts
        )
        self.film = Film.of(self.scene.sensors()[0], scene.camera.resolution, self.ray_length)
        self.owner = covering(mi, self.film, self.scene, self.shapes)
        self.path = _path(mi, sampling.max_depth)
        everything, flags = mi.TransportMode.Radiance, mi.BSDFFlags
        self.all_lobes = mi.BSDFContext()
        self.lobes = [
            mi.BSDFContext(everything, int(flags.GlossyReflection | flags.DeltaReflection)),
            mi.BSDFContext(everything, int(flags.DiffuseReflection)),
        ]

    def truth(self) -> Truth:
        """Render all bands, and put them together as a truth."""
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

    def _maps(self) -> tuple[NumberArray, Float64Array]:
        """Maps of η (height, width, bands) and α (height, width); the first object's off all."""
        side, bands = self.described.camera.resolution, self.described.wavelengths_nm
        owner = np.maximum(self.owner, 0)
        parts = [parts_of(placed.surface) for placed in self.described.objects]
        indices = [np.stack([part.indices(bands) for part in own]) for own in parts]
        eta = np.empty((side**2, len(bands)), dtype=np.result_type(*indices))
        alpha = np.empty(side**2)
        for number, placed in enumerate(self.described.objects):
            here, shares = owner == number, np.ones((side**2, 1), dtype=np.float32)
            if isinstance(placed.surface, Patterned):
                pattern, count = pattern_on(self.mi, placed), len(parts[number])
                shares = surface_shares(self.mi, self.film, self.scene, pattern, count)
            eta[here] = shares[here] @ indices[number]
            alpha[here] = shares[here] @ [part.alpha for part in parts[number]]
        return eta.reshape(side, side, -1), alpha.reshape(side, side)

    def _band(self, band: int) -> Float32Array:
        """Sums over the samples of every half and pixel, (channels, halves, pixels)."""
        nm = (self.described.wavelengths_nm[band],)
        for bsdf in self.bsdfs:
            albedo = bsdf.surface.albedos(self.described.wavelengths_nm)[band]
            bsdf.set_band(bsdf.surface.indices(nm)[0].item(), float(albedo))
        light = sampler(self.mi, self.described.light, self.scene)
        total = self.described.camera.resolution**2
        sums = np.empty((_CHANNELS, HALVES, total), dtype=np.float32)
        for start in range(0, total, PIXELS_A_LAUNCH):
            pixels = np.arange(start, min(start + PIXELS_A_LAUNCH, total), dtype=np.uint32)
            self._launch(pixels, light, sums[:, :, pixels[0] : pixels[-1] + 1])
        return sums

    def _launch(self, pixels: UInt32Array, light: Sampler, result: Float32Array) -> None:
        """Write the sums of some pixels to `result`, by one kernel."""
        import drjit as dr

        mi, count = self.mi, HALVES * len(pixels)
        thread = dr.arange(mi.UInt32, count)
        half, local = thread // len(pixels), thread % len(pixels)
        pixel = dr.gather(mi.UInt32, mi.UInt32(pixels), local)
        owner = dr.gather(mi.Int32, mi.Int32(self.owner[pixels]), local)
        seed = dr.opaque(mi.UInt32, self.sampling.seed)
        rays, draws = streams(mi, stream_number(pixel, half), seed)
        path_sampler = mi.load_dict({"type": "independent"})
        path_sampler.seed(self.sampling.seed + int(pixels[0]), count)

        def step(
            i: Any, sums: list[Any], rays: Any, draws: Any, path_sampler: Any
        ) -> tuple[Any, ...]:
            ray = self.film.ray(mi, pixel, rays)
            values = self._sample(ray, owner, light, draws, path_sampler)
            sums = [s + v for s, v in zip(sums, values, strict=True)]
            return i + 1, sums, rays, draws, path_sampler

        samples = dr.opaque(mi.UInt32, self.sampling.samples // HALVES)
        zeros = [dr.zeros(mi.Float, count) for _ in range(_CHANNELS)]
        state = (dr.zeros(mi.UInt32, count), zeros, rays, draws, path_sampler)
        _, sums, *_ = dr.while_loop(state, lambda i, *_: i < samples, step)
        dr.eval(sums)
        for row, values in zip(result, sums, strict=True):
            row[:] = np.asarray(values).reshape(HALVES, -1)

    def _sample(
        self, ray: Any, owner: Any, light: Sampler, draws: Any, path_sampler: Any
    ) -> list[Any]:
        """Contribution of one ray to every channel."""
        import drjit as dr

        mi = self.mi
        hit = self.scene.ray_intersect(ray)
        valid = hit.is_valid()
        shaded = [mi.Float(0.0) for _ in range(3 * len(self.lobes))]
        to_camera = to_camera_frame(mi, self.film.sensor, ray)
        for direction, weight, stokes in self._incoming(hit, light, draws, path_sampler):
            for k, lobe in enumerate(self.lobes):
                mueller = hit.bsdf().eval(lobe, hit, direction, valid)
                mueller = to_camera @ hit.to_world_mueller(mueller, -direction, hit.wi)
                for row in range(3):
                    outgoing = sum(mueller[row, j][0] * s for j, s in enumerate(stokes))
                    shaded[3 * k + row] += dr.select(weight > 0, outgoing * weight, 0.0)
        normal = [dr.select(valid, c, 0.0) for c in hit.sh_frame.n]
        whole = [a + b for a, b in zip(shaded[:3], shaded[3:], strict=True)]
        on_owner = mi.Bool(False)
        for index, shape in enumerate(self.shapes):
            on_owner |= (hit.shape == mi.ShapePtr(shape)) & (owner == index)
        return [*normal, *shaded, *(w * w for w in whole), dr.select(on_owner, mi.Float(1), 0.0)]

    def _incoming(self, hit: Any, light: Sampler, draws: Any, path_sampler: Any) -> list[Any]:
        """Directions (local), weights and Stokes vectors of the light that arrives at a hit."""
        import drjit as dr

        mi, valid, bsdf = self.mi, hit.is_valid(), hit.bsdf()
        arriving = []
        for direction, weight, stokes in light(hit, bsdf, draws, valid):
            ray = hit.spawn_ray(hit.to_world(direction))
            ray.maxt = mi.Float(self.ray_length)
            matters = valid & (weight > 0) & (direction.z > 0)  # as `CameraView.incoming`
            shadow = self.scene.ray_test(ray, matters)
            arriving.append((direction, dr.select(shadow, 0.0, weight), stokes))
        if self.path is None:
            return arriving
        u, uv = draws.next_float32(), mi.Point2f(draws.next_float32(), draws.next_float32())
        drawn, _ = bsdf.sample(self.all_lobes, hit, u, uv, valid)
        usable = valid & (drawn.pdf > 0)
        ray = mi.RayDifferential3f(hit.spawn_ray(hit.to_world(drawn.wo)))
        radiance, _, _ = self.path.sample(self.scene, path_sampler, ray, None, usable)
        stokes = [radiance[row, 0][0] for row in range(4)]
        return [*arriving, (drawn.wo, dr.select(usable, 1.0 / drawn.pdf, 0.0), stokes)]


def _path(mi: ModuleType, max_depth: int) -> Any:
    """Integrator of the light from other objects; None where paths end at the first object."""
    if max_depth == 2:
        return None
    return mi.load_dict({"type": "path", "max_depth": max_depth - 1, "hide_emitters": True})


def _reach(scene: Scene) -> float:
    """Radius of a sphere around the origin that holds all objects."""
    return max(math.hypot(*p.position) + 2 * p.scale for p in scene.objects)
