"""Both lobes of a whole family from one trace, on Mitsuba's vectorised variants.

One kernel traces the primary rays once and lets Mitsuba's own BSDFs shade each hit for every node
in η and for both lobes. Light directions are drawn once a hit and shared by the nodes, so that
the noise is a smooth function of η. A thread serves one pixel and one half of its samples and
sums them in a fixed order: results do not depend on the number of threads.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.renderers.coverage import inside
from malus.renderers.lighting import Sampler, sampler
from malus.renderers.lobes import HALVES, Floats, Layout, Lobes, lobes_from_sums
from malus.renderers.rays import camera_ray, streams, to_camera_frame
from malus.renderers.translate import CONVEX, sensor, shape_object
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.camera import Camera
from malus.scenes.lights import Light
from malus.scenes.scene import Sampling
from malus.scenes.shapes import Shape

PIXELS_A_LAUNCH = 1 << 16
"""Bounds the memory of one launch to a few hundred megabytes, whatever the image's size."""


@functools.lru_cache(maxsize=4)
def stage(variant: Variant, shape: Shape, camera: Camera) -> Stage:
    """The stage for a shape and a camera; the last ones are kept, so that nothing is reloaded."""
    return Stage(mitsuba(variant), shape, camera)


@dataclass(frozen=True)
class Shading:
    """What every hit is shaded with: the BSDFs at the nodes, and whether variances are kept.

    `where`, from a hit and random numbers, tells which hits are shaded; by default all.
    """

    interface: Sequence[Any]
    body: Sequence[Any]
    errors: bool
    where: Callable[[Any, Any], Any] | None = None

    @property
    def layout(self) -> Layout:
        """How the sums over samples are laid out."""
        return Layout(len(self.interface), len(self.body), self.errors)


class Stage:
    """A shape before a camera, ready to be lit and shaded by many BSDFs."""

    def __init__(self, mi: ModuleType, shape: Shape, camera: Camera) -> None:
        import drjit as dr

        self.mi, self.dr = mi, dr
        self.resolution = camera.resolution
        self.convex = shape.kind in CONVEX
        plain = mi.load_dict({"type": "diffuse"})
        self.scene = mi.load_dict(
            {
                "type": "scene",
                "shape": shape_object(mi, shape, plain),
                "sensor": sensor(mi, camera),
            }
        )
        self.sensor = self.scene.sensors()[0]
        self.context = mi.BSDFContext()
        self.inside = inside(mi, self.scene, self.resolution)
        self._hit: dict[Sampling, tuple[NDArray[np.int64], NDArray[np.bool_]]] = {}

    def render(self, light: Light, shading: Shading, sampling: Sampling) -> Lobes:
        """Shade every hit with every BSDF of `shading` under `light`."""
        pixels, covered = self._coverage(sampling)
        lit_by = sampler(self.mi, light)
        sums = np.empty((shading.layout.channels, HALVES, len(pixels)), dtype=np.float32)
        for i in range(0, len(pixels), PIXELS_A_LAUNCH):
            block = slice(i, i + PIXELS_A_LAUNCH)
            self._shade(pixels[block], lit_by, shading, sampling, sums[:, :, block])
        half_samples = sampling.samples // HALVES
        return lobes_from_sums(sums, shading.layout, half_samples, pixels, covered)

    def _coverage(self, sampling: Sampling) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Pixels with at least one hit among the very rays to be shaded, and the covered ones."""
        if sampling in self._hit:
            return self._hit[sampling]
        mi, dr = self.mi, self.dr
        total = self.resolution**2
        hits = np.zeros(total, dtype=np.int64)
        for start in range(0, total, PIXELS_A_LAUNCH):
            pixel = dr.arange(mi.UInt32, min(PIXELS_A_LAUNCH, total - start)) + start
            pixel = dr.opaque(mi.UInt32, 0) + pixel
            counts = [self._count_hits(pixel, half, sampling) for half in range(HALVES)]
            hits[start : start + PIXELS_A_LAUNCH] = sum(np.asarray(c, np.int64) for c in counts)
        touched = np.flatnonzero(hits)
        covered = self.inside & (hits == sampling.samples)
        self._hit = {sampling: (touched, covered[touched])}  # lights and surfaces share the rays
        return self._hit[sampling]

    def _count_hits(self, pixel: Any, half: int, sampling: Sampling) -> Any:
        mi, dr = self.mi, self.dr
        random, _ = streams(mi, pixel, dr.opaque(mi.UInt32, half), sampling.seed)

        def step(i: Any, hits: Any, random: Any) -> tuple[Any, Any, Any]:
            ray = camera_ray(mi, self.sensor, self.resolution, pixel, random)
            hit = self.scene.ray_test(ray)
            return i + 1, hits + dr.select(hit, mi.UInt32(1), mi.UInt32(0)), random

        count = dr.opaque(mi.UInt32, sampling.samples // HALVES)
        state = (dr.zeros(mi.UInt32, dr.width(pixel)), dr.zeros(mi.UInt32, dr.width(pixel)), random)
        _, hits, _ = dr.while_loop(state, lambda i, *_: i < count, step)
        return hits

    def _shade(
        self,
        pixels: NDArray[np.int64],
        light: Sampler,
        shading: Shading,
        sampling: Sampling,
        result: Floats,
    ) -> None:
        """Fill `result`, (channels, halves, pixels), with sums over the samples."""
        mi, dr = self.mi, self.dr
        thread = dr.arange(mi.UInt32, HALVES * len(pixels))
        half, local = thread // len(pixels), thread % len(pixels)
        pixel = dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), local)
        rays, draws = streams(mi, pixel, half, sampling.seed)
        sums = [dr.zeros(mi.Float, dr.width(thread)) for _ in result]

        def step(i: Any, sums: list[Any], rays: Any, draws: Any) -> tuple[Any, ...]:
            ray = camera_ray(mi, self.sensor, self.resolution, pixel, rays)
            hit = self.scene.ray_intersect(ray)
            values = self._sample(ray, hit, light, shading, draws)
            return i + 1, [s + v for s, v in zip(sums, values, strict=True)], rays, draws

        count = dr.opaque(mi.UInt32, sampling.samples // HALVES)
        state = (dr.zeros(mi.UInt32, dr.width(thread)), sums, rays, draws)
        # Without a second trace that looks for loop invariants: it costs more than they do.
        with dr.scoped_set_flag(dr.JitFlag.OptimizeLoops, False):
            _, sums, _, _ = dr.while_loop(state, lambda i, *_: i < count, step)
        dr.eval(sums)
        for row, values in zip(result, sums, strict=True):
            row[:] = np.asarray(values).reshape(HALVES, -1)

    def _sample(
        self, ray: Any, hit: Any, light: Sampler, shading: Shading, random: Any
    ) -> list[Any]:
        """Normal, Stokes of every BSDF, and the products that the variances need."""
        dr = self.dr
        to_camera = to_camera_frame(self.mi, self.sensor, ray)
        valid = hit.is_valid()
        if shading.where is not None:
            valid &= shading.where(hit, random)
        mirrored = self._lobe(hit, valid, light, shading.interface, to_camera, random)
        scattered = self._lobe(hit, valid, light, shading.body, to_camera, random)
        normal = [dr.select(hit.is_valid(), c, 0.0) for c in hit.sh_frame.n]
        if not shading.errors:
            return normal + mirrored + scattered
        squares = [v * v for v in mirrored] + [v * v for v in scattered]
        # One body node serves every interface node where the body does not depend on η.
        repeated = scattered * (len(mirrored) // len(scattered))
        products = [a * b for a, b in zip(mirrored, repeated, strict=True)]
        return normal + mirrored + scattered + squares + products

    def _lobe(
        self,
        hit: Any,
        valid: Any,
        light: Sampler,
        bsdfs: Sequence[Any],
        to_camera: Any,
        random: Any,
    ) -> list[Any]:
        """s0, s1, s2 in the camera's frame for each of `bsdfs`, light directions shared."""
        dr = self.dr
        values = [self.mi.Float(0.0) for _ in range(3 * len(bsdfs))]
        for direction, weight in light(hit, bsdfs[0], random, valid):
            if not self.convex:
                shadow = self.scene.ray_test(hit.spawn_ray(hit.to_world(direction)), valid)
                weight = dr.select(shadow, 0.0, weight)
            for k, bsdf in enumerate(bsdfs):
                mueller = bsdf.eval(self.context, hit, direction, valid)
                mueller = hit.to_world_mueller(mueller, -direction, hit.wi)
                # Unpolarised light: the first column is the Stokes vector of what it becomes.
                stokes = [mueller[row, 0] for row in range(3)]
                # Turning it is cheaper to trace than turning all of the matrix.
                for row in (1, 2):
                    turned = to_camera[row, 1] * stokes[1] + to_camera[row, 2] * stokes[2]
                    values[3 * k + row] += dr.select(weight > 0, turned[0] * weight, 0.0)
                values[3 * k] += dr.select(weight > 0, stokes[0][0] * weight, 0.0)
        return values
