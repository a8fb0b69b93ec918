"""Render both lobes of a family at all nodes in η at once, on Mitsuba's vectorised variants.

One kernel traces the rays of the camera once and evaluates Mitsuba's own BSDFs at each hit, for
every node in η and for both lobes. A thread sums the samples of one pixel and one half in a fixed
order: results do not depend on the number of threads.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import Any

import numpy as np

from malus.renderers.mitsuba.coverage import FAR, check_seen, inside, meets
from malus.renderers.mitsuba.lighting import (
    Sampler,
    environment_emitter,
    radiance_map_of,
    sampler,
)
from malus.renderers.mitsuba.lobe_samples import HALVES, Lobes, finite, in_float64, lobes_from_sums
from malus.renderers.mitsuba.rays import Film, stream_number, streams
from malus.renderers.mitsuba.shading import CameraView, KeptHits, Shading, Threads, shade
from malus.renderers.mitsuba.translate import sensor, shape_object
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.camera import Camera
from malus.scenes.core.arrays import BoolArray, IntArray
from malus.scenes.lights.lights import Distant, Light, MapLight
from malus.scenes.scene import Sampling
from malus.scenes.shapes.shapes import CONVEX, Shape

PIXELS_A_LAUNCH = 1 << 16
"""Most pixels of one launch, which bounds its memory to a few hundred megabytes."""

MOST_KEPT_HITS = 1 << 22
"""Most rays whose hits a stage keeps: 64 megabytes. A GPU traces them faster than it reads them."""

RECORDINGS = 16
"""Most recorded calls that a stage keeps: one for each kind of light, body and number of nodes."""


STAGES = 4
"""Stages that stay loaded: what makes one is building the ray tracer's tree."""


def stage(variant: Variant, shape: Shape, camera: Camera, light: Light) -> Stage:
    """The stage for a shape, a camera and a light; the last ones stay loaded."""
    return cached_stage(variant, shape, camera, radiance_map_of(light))


@functools.lru_cache(maxsize=STAGES)
def cached_stage(variant: Variant, shape: Shape, camera: Camera, around: MapLight | None) -> Stage:
    """The stage of a shape, a camera and the radiance map around them, or None without one."""
    return Stage(mitsuba(variant), shape, camera, around)


@dataclass(frozen=True)
class TouchedPixels:
    """Pixels with at least one hit among the rays that will be shaded.

    Attributes
    ----------
    pixels : (P,)
        Flat indices into the image.
    covered : (P,) bool
        Whether the object covers the pixel entirely.
    streams : Dr.Jit arrays (HALVES * pixels of a launch,)
        Numbers of the random streams of each launch.
    hits : KeptHits or None
        Hits of all rays, where these are few enough to be kept.
    hidden : dict of light to (rays,)
        From which hits the shape itself hides a distant lamp; the last `RECORDINGS` are kept.
    """

    pixels: IntArray
    covered: BoolArray
    streams: list[Any]
    hits: KeptHits | None
    hidden: dict[Light, Any] = field(default_factory=dict)


class Stage:
    """A Mitsuba scene of a shape and a camera, for renders with many lights and BSDFs.

    A radiance map `around` it is part of its scene; other lights are parameters of a render.
    """

    def __init__(
        self,
        mi: ModuleType,
        shape: Shape,
        camera: Camera,
        around: MapLight | None = None,
    ) -> None:
        import drjit as dr

        self.mi, self.dr = mi, dr
        self.shape, self.resolution = shape, camera.resolution
        plain = mi.load_dict({"type": "diffuse"})
        self.scene = mi.load_dict(
            {
                "type": "scene",
                "shape": shape_object(mi, shape, plain),
                "sensor": sensor(mi, camera),
            }
            | ({"map": environment_emitter(mi, around)} if around else {})
        )
        film = Film.of(self.scene.sensors()[0], camera.resolution)
        self.view = CameraView(self.scene, film, shape.kind in CONVEX)
        self.far = (camera.distance or 0.0) > FAR
        self.inside = inside(mi, self.scene, self.resolution, self.far)
        # On CUDA, replaying a recording of Mitsuba 3.9's `envmap` ends the process.
        recordable = around is None or not mi.variant().startswith("cuda")
        # Dr.Jit would warn of each new kind of light or body.
        freeze = functools.partial(dr.freeze, limit=RECORDINGS, warn_after=1 << 30)
        self._replay: Callable[..., Any] = freeze(shade) if recordable else shade
        self._touched: dict[Sampling, TouchedPixels] = {}

    def begin(
        self, light: Light, shading_of: Callable[[], Shading], sampling: Sampling
    ) -> Callable[[], Lobes]:
        """Begin to shade every hit with every BSDF of a shading; the value waits for the end.

        The kernel runs meanwhile. Where there are several, the others wait too: memory is bounded.
        Other renders may have set the same BSDFs to other values by then, so that `shading_of`
        sets them again.
        """
        touched, lit_by = self._hits(sampling), sampler(self.mi, light, self.scene)
        half_samples, shading = sampling.samples // HALVES, shading_of()
        hidden = self._hidden(light, lit_by, touched, sampling)
        double = in_float64(sampling.samples)

        def launch(stream: Any) -> Any:
            count = self.dr.width(stream)
            pixels, seed, samples = self._opaque(count // HALVES, sampling.seed, half_samples)
            threads = Threads(count, stream, pixels, seed, samples, double, touched.hits, hidden)
            return self._shade(lit_by, shading, threads)

        first, *others = touched.streams
        launched = launch(first)

        def lobes() -> Lobes:
            blocks, seconds = [], 0.0
            if others:
                shading_of()
            for sums in (launched, *map(launch, others)):
                self.dr.sync_thread()
                started = time.perf_counter()
                blocks.append(finite(np.asarray(sums)))
                seconds += time.perf_counter() - started
            started = time.perf_counter()
            lobes = lobes_from_sums(
                blocks, shading.layout, half_samples, touched.pixels, touched.covered
            )
            return replace(lobes, copy_seconds=seconds + time.perf_counter() - started)

        return lobes

    def render(self, light: Light, shading: Shading, sampling: Sampling) -> Lobes:
        """Shade every hit with every BSDF of `shading` under `light`."""
        return self.begin(light, lambda: shading, sampling)()

    def _hits(self, sampling: Sampling) -> TouchedPixels:
        """The pixels that the object touches; kept for renders with other lights and surfaces."""
        if sampling in self._touched:
            return self._touched[sampling]
        total = self.resolution**2
        hits = np.zeros(total, dtype=np.int64)
        kept = self._room_for_hits(sampling)
        for start in range(0, total, PIXELS_A_LAUNCH):
            block = slice(start, min(start + PIXELS_A_LAUNCH, total))
            stream = self._streams(np.arange(total)[block])
            counts = np.asarray(self._count_hits(stream, sampling, kept), np.int64)
            hits[block] = counts.reshape(HALVES, -1).sum(axis=0)
        check_seen(hits, self.shape)
        pixels = np.flatnonzero(hits)
        covered = self.inside & (hits == sampling.samples)
        launches = range(0, len(pixels), PIXELS_A_LAUNCH)
        streams = [self._streams(pixels[i : i + PIXELS_A_LAUNCH]) for i in launches]
        self._touched = {sampling: TouchedPixels(pixels, covered[pixels], streams, kept)}
        return self._touched[sampling]

    def _streams(self, pixels: IntArray) -> Any:
        """Numbers of the random streams of both halves, as an evaluated Dr.Jit array."""
        numbers = [stream_number(pixels, half) for half in range(HALVES)]
        result = self.mi.UInt32(np.concatenate(numbers).astype(np.uint32))
        self.dr.eval(result)
        return result

    def _opaque(self, *numbers: int) -> list[Any]:
        """Numbers that a kernel is told, instead of compiled for."""
        return [self.dr.opaque(self.mi.UInt32, number) for number in numbers]

    def _room_for_hits(self, sampling: Sampling) -> KeptHits | None:
        """Room for the hits of all rays, or None where they are not kept."""
        mi, dr = self.mi, self.dr
        streams = HALVES * self.resolution**2
        rays = streams * (sampling.samples // HALVES)
        if rays > MOST_KEPT_HITS or not mi.variant().startswith("llvm"):
            return None
        distance, u, v = (dr.empty(mi.Float, rays) for _ in range(3))
        shape, (count,) = mi.ShapePtr(self.scene.shapes()[0]), self._opaque(streams)
        return KeptHits(distance, u, v, dr.empty(mi.UInt32, rays), shape, count)

    def _count_hits(self, stream: Any, sampling: Sampling, kept: KeptHits | None) -> Any:
        """Number of samples that hit the object, for each random stream; writes to `kept`."""
        mi, dr = self.mi, self.dr
        seed, count = self._opaque(sampling.seed, sampling.samples // HALVES)
        random, _ = streams(mi, stream, seed)
        pixel = stream // HALVES

        def step(i: Any, hits: Any, random: Any) -> tuple[Any, Any, Any]:
            ray = self.view.film.ray(mi, pixel, random)
            if kept is None:
                hit = meets(self.scene, ray, self.far)
            else:
                hit = kept.keep(self.scene.ray_intersect_preliminary(ray), i, stream)
            return i + 1, hits + dr.select(hit, mi.UInt32(1), mi.UInt32(0)), random

        state = (mi.UInt32(0), mi.UInt32(0), random)
        _, hits, _ = dr.while_loop(state, lambda i, *_: i < count, step)
        return hits

    def _hidden(
        self, light: Light, lit_by: Sampler, touched: TouchedPixels, sampling: Sampling
    ) -> Any:
        """From which hits a lamp is hidden, where every surface and lobe asks the same; or None."""
        mi, dr, hits = self.mi, self.dr, touched.hits
        if hits is None or self.view.convex or not isinstance(light, Distant):
            return None
        if light in touched.hidden:
            return touched.hidden[light]
        hidden = dr.zeros(mi.Bool, dr.width(hits.distance))
        seed, count = self._opaque(sampling.seed, sampling.samples // HALVES)

        def step(i: Any, random: Any, stream: Any) -> tuple[Any, Any, Any]:
            hit = hits.at(mi, self.view.film.ray(mi, stream // HALVES, random), i, stream)
            ((direction, weight, _),) = lit_by(hit, None, None, hit.is_valid())
            shadow = self.view.shadow(hit, direction, weight, hit.is_valid())
            dr.scatter(hidden, shadow, hits.number(i, stream), mode=dr.ReduceMode.NoConflicts)
            return i + 1, random, stream

        for stream in touched.streams:
            state = (mi.UInt32(0), streams(mi, stream, seed)[0], stream)
            dr.while_loop(state, lambda i, *_: i < count, step)
            dr.eval(hidden)
        while len(touched.hidden) >= RECORDINGS:
            touched.hidden.pop(next(iter(touched.hidden)))
        touched.hidden[light] = hidden
        return hidden

    def _shade(self, light: Sampler, shading: Shading, threads: Threads) -> Any:
        """Sums over the samples of pixels, flat and in the order of `Layout`, on the device."""
        run = self._replay if shading.replay else shade
        sums = run(self.mi, self.view, light, shading, threads)
        self.dr.eval(sums)  # launches the kernel, where none has been replayed
        return sums
