"""Both lobes of a whole family from one trace, on Mitsuba's vectorised variants.

One kernel traces the primary rays once and lets Mitsuba's own BSDFs shade each hit for every node
in η and for both lobes. Light directions are drawn once a hit and shared by the nodes, so that
the noise is a smooth function of η. A thread serves one pixel and one half of its samples and
sums them in a fixed order: results do not depend on the number of threads.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.renderers.lobes import Floats, Lobes
from malus.renderers.translate import CONVEX, body_bsdf, interface_bsdf, sensor, shape_object
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.scene import Body, Camera, Light, Sampling, Shape, Uniform

HALVES = 2
PIXELS_A_LAUNCH = 1 << 16
"""Bounds the memory of one launch to a few hundred megabytes, whatever the image's size."""


@functools.lru_cache(maxsize=2)
def stage(variant: Variant, shape: Shape, camera: Camera) -> Stage:
    """The stage for a shape and a camera; the last ones are kept, so that nothing is reloaded."""
    return Stage(mitsuba(variant), shape, camera)


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

    def render(
        self,
        light: Light,
        interface: Sequence[Any],
        body: Sequence[Any],
        sampling: Sampling,
    ) -> Lobes:
        """Shade every hit with every BSDF of `interface` and `body` under `light`."""
        pixels, covered = self._coverage(sampling)
        direction = self._light_direction(light)
        blocks = [
            self._shade(pixels[i : i + PIXELS_A_LAUNCH], direction, interface, body, sampling)
            for i in range(0, len(pixels), PIXELS_A_LAUNCH)
        ]
        sums = np.concatenate(blocks, axis=-1) if blocks else self._nothing(interface, body)
        return _lobes(sums, len(interface), len(body), sampling.samples, pixels, covered, light)

    def _nothing(self, interface: Sequence[Any], body: Sequence[Any]) -> Floats:
        channels = 3 + 3 * (3 * len(interface) + 2 * len(body))
        return np.zeros((channels, HALVES, 0), dtype=np.float32)

    def _coverage(self, sampling: Sampling) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Pixels with at least one hit among the very rays to be shaded, and those with all."""
        mi, dr = self.mi, self.dr
        total = self.resolution**2
        hits = np.zeros(total, dtype=np.int64)
        for start in range(0, total, PIXELS_A_LAUNCH):
            pixel = dr.arange(mi.UInt32, min(PIXELS_A_LAUNCH, total - start)) + start
            pixel = dr.opaque(mi.UInt32, 0) + pixel
            counts = [self._count_hits(pixel, half, sampling) for half in range(HALVES)]
            hits[start : start + PIXELS_A_LAUNCH] = sum(np.asarray(c, np.int64) for c in counts)
        touched = np.flatnonzero(hits)
        return touched, hits[touched] == sampling.samples

    def _count_hits(self, pixel: Any, half: int, sampling: Sampling) -> Any:
        mi, dr = self.mi, self.dr
        random, _ = self._random(pixel, dr.opaque(mi.UInt32, half), sampling.seed)

        def step(i: Any, hits: Any, random: Any) -> tuple[Any, Any, Any]:
            hit = self.scene.ray_test(self._ray(pixel, random))
            return i + 1, hits + dr.select(hit, mi.UInt32(1), mi.UInt32(0)), random

        count = dr.opaque(mi.UInt32, sampling.samples // HALVES)
        state = (dr.zeros(mi.UInt32, dr.width(pixel)), dr.zeros(mi.UInt32, dr.width(pixel)), random)
        _, hits, _ = dr.while_loop(state, lambda i, *_: i < count, step)
        return hits

    def _random(self, pixel: Any, half: Any, seed: int) -> tuple[Any, Any]:
        """Independent streams of a pixel and half: one for the rays, one for the shading."""
        mi = self.mi
        streams = []
        for purpose in range(2):
            index = (pixel * HALVES + half) * 2 + purpose
            state, sequence = mi.sample_tea_32(index, self.dr.opaque(mi.UInt32, seed))
            stream = mi.PCG32()
            stream.seed(mi.UInt64(state), mi.UInt64(sequence))
            streams.append(stream)
        return streams[0], streams[1]

    def _ray(self, pixel: Any, random: Any) -> Any:
        mi = self.mi
        offset = mi.Point2f(random.next_float32(), random.next_float32())
        corner = mi.Point2f(pixel % self.resolution, pixel // self.resolution)
        ray, _ = self.sensor.sample_ray(
            0.0, 0.0, (corner + offset) / self.resolution, mi.Point2f(0.5)
        )
        return ray

    def _light_direction(self, light: Light) -> Any:
        """Direction to a distant light, or None where directions are drawn from the BSDF."""
        if isinstance(light, Uniform):
            return None
        return self.mi.Vector3f(*(self.dr.opaque(self.mi.Float, c) for c in light.direction))

    def _shade(
        self,
        pixels: NDArray[np.int64],
        direction: Any,
        interface: Sequence[Any],
        body: Sequence[Any],
        sampling: Sampling,
    ) -> Floats:
        """Sums over samples, shape (channels, halves, pixels)."""
        mi, dr = self.mi, self.dr
        thread = dr.arange(mi.UInt32, HALVES * len(pixels))
        half, local = thread // len(pixels), thread % len(pixels)
        pixel = dr.gather(mi.UInt32, mi.UInt32(pixels.astype(np.uint32)), local)
        rays, shading = self._random(pixel, half, sampling.seed)
        channels = 3 + 3 * (3 * len(interface) + 2 * len(body))
        sums = [dr.zeros(mi.Float, dr.width(thread)) for _ in range(channels)]

        def step(i: Any, sums: list[Any], rays: Any, shading: Any) -> tuple[Any, ...]:
            ray = self._ray(pixel, rays)
            hit = self.scene.ray_intersect(ray)
            values = self._sample(ray, hit, direction, interface, body, shading)
            return i + 1, [s + v for s, v in zip(sums, values, strict=True)], rays, shading

        count = dr.opaque(mi.UInt32, sampling.samples // HALVES)
        state = (dr.zeros(mi.UInt32, dr.width(thread)), sums, rays, shading)
        _, sums, _, _ = dr.while_loop(state, lambda i, *_: i < count, step)
        dr.eval(sums)
        return np.stack([np.asarray(s) for s in sums]).reshape(channels, HALVES, len(pixels))

    def _sample(
        self,
        ray: Any,
        hit: Any,
        direction: Any,
        interface: Sequence[Any],
        body: Sequence[Any],
        random: Any,
    ) -> list[Any]:
        """Normal, Stokes of every BSDF, and the products that the variances need."""
        dr = self.dr
        to_camera = self._to_camera_frame(ray)
        mirrored = self._lobe(hit, direction, interface, to_camera, random)
        scattered = self._lobe(hit, direction, body, to_camera, random)
        normal = [dr.select(hit.is_valid(), c, 0.0) for c in hit.sh_frame.n]
        squares = [v * v for v in mirrored] + [v * v for v in scattered]
        # One body node serves every interface node where the body does not depend on η.
        repeated = scattered * (len(interface) // len(body))
        products = [a * b for a, b in zip(mirrored, repeated, strict=True)]
        return normal + mirrored + scattered + squares + products

    def _lobe(
        self, hit: Any, direction: Any, bsdfs: Sequence[Any], to_camera: Any, random: Any
    ) -> list[Any]:
        """s0, s1, s2 in the camera's frame for each of `bsdfs`, light direction shared."""
        mi, dr = self.mi, self.dr
        valid = hit.is_valid()
        if direction is None:
            u = random.next_float32()
            uv = mi.Point2f(random.next_float32(), random.next_float32())
            drawn, _ = bsdfs[0].sample(self.context, hit, u, uv, valid)
            towards_light = drawn.wo
            valid &= drawn.pdf > 0
            weight = dr.select(valid, 1.0 / drawn.pdf, 0.0)
        else:
            towards_light = hit.to_local(direction)
            weight = dr.select(valid, mi.Float(1.0), 0.0)
        if not self.convex:
            shadow = self.scene.ray_test(hit.spawn_ray(hit.to_world(towards_light)), valid)
            weight = dr.select(shadow, 0.0, weight)
        values = []
        for bsdf in bsdfs:
            mueller = bsdf.eval(self.context, hit, towards_light, valid)
            mueller = to_camera @ hit.to_world_mueller(mueller, -towards_light, hit.wi)
            # Unpolarised light: the first column is the Stokes vector of the reflected light.
            values += [dr.select(weight > 0, mueller[row, 0][0] * weight, 0.0) for row in range(3)]
        return values

    def _to_camera_frame(self, ray: Any) -> Any:
        """Mueller rotation from Mitsuba's frame for the ray to +x of the image."""
        mi, dr = self.mi, self.dr
        up = self.sensor.world_transform() @ mi.Vector3f(0, 1, 0)
        horizontal = dr.normalize(dr.cross(ray.d, up))
        current = mi.mueller.stokes_basis(-ray.d)
        return mi.mueller.rotate_stokes_basis(-ray.d, current, horizontal)


def bsdfs(
    variant: Variant, etas: Sequence[float], alpha: float, body: Body
) -> tuple[list[Any], list[Any]]:
    """Interface and body BSDFs at the given nodes, with parameters that need no recompilation."""
    mi = mitsuba(variant)
    interface = _pool(variant, len(etas), None)
    scattering = _pool(variant, 1 if body == "unpolarised" else len(etas), body)
    _update(mi, interface, etas, alpha)
    if body == "polarised":
        _update(mi, scattering, etas, alpha)
    return interface, scattering


@functools.lru_cache(maxsize=32)
def _pool(variant: Variant, count: int, body: Body | None) -> list[Any]:
    mi = mitsuba(variant)
    describe = interface_bsdf(1.5, 0.3) if body is None else body_bsdf(1.5, 0.3, body)
    return [mi.load_dict(describe) for _ in range(count)]


def _update(mi: ModuleType, pool: Sequence[Any], etas: Sequence[float], alpha: float) -> None:
    import drjit as dr

    # The same variable in every BSDF: Dr.Jit then computes the facet distribution only once.
    shared_alpha = dr.opaque(mi.Float, alpha)
    for bsdf, eta in zip(pool, etas, strict=True):
        parameters = mi.traverse(bsdf)
        parameters["eta.value"] = dr.opaque(mi.Float, eta)
        parameters["alpha.value"] = shared_alpha
        parameters.update()


def _lobes(
    sums: Floats,
    interface: int,
    body: int,
    samples: int,
    pixels: NDArray[np.int64],
    covered: NDArray[np.bool_],
    light: Light,
) -> Lobes:
    strength = light.radiance if isinstance(light, Uniform) else light.irradiance
    counts = [1, interface, body, interface, body, interface]
    parts = np.split(sums, np.cumsum([3 * c for c in counts])[:-1])
    # (count * 3, halves, pixels) -> (halves, count, pixels, 3), means over the half's samples
    half_samples = samples // HALVES
    means = [
        p.reshape(c, 3, HALVES, -1).transpose(2, 0, 3, 1) / half_samples
        for p, c in zip(parts, counts, strict=True)
    ]
    normal, mirrored, scattered, mirrored2, scattered2, product = means
    mean_mirrored, mean_scattered = mirrored.mean(axis=0), scattered.mean(axis=0)
    scale = strength**2 / (samples - 1)
    normal = normal.mean(axis=(0, 1))
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    return Lobes(
        specular=np.ascontiguousarray(mirrored * strength, dtype=np.float32),
        body=np.ascontiguousarray(scattered * strength, dtype=np.float32),
        specular_variance=_variance(mirrored2, mean_mirrored**2, scale),
        body_variance=_variance(scattered2, mean_scattered**2, scale),
        covariance=np.asarray(
            (product.mean(axis=0) - mean_mirrored * mean_scattered) * scale, dtype=np.float32
        ),
        pixels=pixels,
        normals=np.divide(normal, length, out=np.zeros_like(normal), where=length > 0),
        covered=covered,
    )


def _variance(squares: Floats, squared_mean: Floats, scale: float) -> Floats:
    # Rounding can leave a tiny negative variance where all samples are equal.
    return np.asarray(np.maximum(squares.mean(axis=0) - squared_mean, 0.0) * scale, np.float32)
