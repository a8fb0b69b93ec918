"""The kernel that renders a family: rays of the camera, light at their hits, and all BSDFs.

Directions of light are drawn once a hit and shared by the BSDFs of a lobe, so that the noise is a
smooth function of η. Dr.Jit traces every call into Mitsuba anew, also where the kernel is compiled
already; `shade` is therefore written so that `dr.freeze` can record it: everything that changes is
an argument.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from malus.renderers.mitsuba.lighting import Draws, Sampler
from malus.renderers.mitsuba.lobe_samples import HALVES, Layout
from malus.renderers.mitsuba.rays import Film, streams, to_camera_frame


@dataclass
class Shading:
    """The BSDFs at the nodes that shade every hit, and whether variances are kept.

    `where` maps a hit and random numbers to whether the hit is shaded; by default all are. `replay`
    is False where a recording would miss a change: `where` is a function, and Mitsuba's measured
    BSDFs do not show their tables to Dr.Jit. Nor do others show how their facets are distributed:
    `distribution` makes that part of what a recording is for.
    """

    specular: Sequence[Any]
    diffuse: Sequence[Any]
    errors: bool
    where: Callable[[Any, Any], Any] | None = None
    replay: bool = True
    distribution: str = "beckmann"

    @property
    def layout(self) -> Layout:
        """Order of the sums over samples."""
        return Layout(len(self.specular), len(self.diffuse), self.errors)

    def lobe(
        self,
        mi: ModuleType,
        hit: Any,
        incoming: Draws,
        bsdfs: Sequence[Any],
        to_camera: Any,
        valid: Any,
    ) -> list[Any]:
        """s0, s1, s2 in the camera's frame for each of `bsdfs`, all lit from `incoming`."""
        import drjit as dr

        context = mi.BSDFContext()
        values = [mi.Float(0.0) for _ in range(3 * len(bsdfs))]
        for direction, weight, arriving in incoming:
            for k, bsdf in enumerate(bsdfs):
                mueller = bsdf.eval(context, hit, direction, valid)
                mueller = hit.to_world_mueller(mueller, -direction, hit.wi)
                # Unpolarised light becomes the first column of the Mueller matrix.
                stokes = [
                    sum(mueller[row, j] * s for j, s in enumerate(arriving)) for row in range(3)
                ]
                # Turning this vector is cheaper to trace than turning the whole matrix.
                for row in (1, 2):
                    turned = to_camera[row, 1] * stokes[1] + to_camera[row, 2] * stokes[2]
                    values[3 * k + row] += dr.select(weight > 0, turned[0] * weight, 0.0)
                values[3 * k] += dr.select(weight > 0, stokes[0][0] * weight, 0.0)
        return values


@dataclass
class CameraView:
    """A scene and the film that sees it; a `convex` shape casts no shadow on itself."""

    scene: Any
    film: Film
    convex: bool

    def incoming(
        self, hit: Any, light: Sampler, bsdf: Any, random: Any, valid: Any, hidden: Any = None
    ) -> Draws:
        """Directions, weights and Stokes vectors of the light that reaches a hit.

        `hidden` says where the light is hidden, if that is known.
        """
        import drjit as dr

        draws = light(hit, bsdf, random, valid)
        if self.convex:
            return draws
        unshadowed = []
        for direction, weight, stokes in draws:
            shadow = self.shadow(hit, direction, weight, valid) if hidden is None else hidden
            unshadowed.append((direction, dr.select(shadow, 0.0, weight), stokes))
        return unshadowed

    def shadow(self, hit: Any, direction: Any, weight: Any, valid: Any) -> Any:
        """Whether the scene hides from a hit what comes from a local direction."""
        # Below the horizon a BSDF is zero, and what was drawn past the lamp has no weight.
        matters = valid & (weight > 0) & (direction.z > 0)
        return self.scene.ray_test(hit.spawn_ray(hit.to_world(direction)), matters)


@dataclass
class KeptHits:
    """Where the rays of the camera hit the only shape: renders with other lights need not trace.

    The number of a ray is that of its sample times that of all streams, plus its stream's.

    Attributes
    ----------
    distance, u, v, face : (rays,)
        Distance along the ray, infinite where it misses; coordinates on the shape; its face.
    shape : Dr.Jit pointer
    streams : opaque
        Number of streams.
    """

    distance: Any
    u: Any
    v: Any
    face: Any
    shape: Any
    streams: Any

    def number(self, sample: Any, stream: Any) -> Any:
        """Numbers of the streams' rays."""
        return sample * self.streams + stream

    def keep(self, hit: Any, sample: Any, stream: Any) -> Any:
        """Keep preliminary hits of the streams' rays; returns which are hits."""
        import drjit as dr

        number = self.number(sample, stream)
        for target, value in (
            (self.distance, hit.t),
            (self.u, hit.prim_uv.x),
            (self.v, hit.prim_uv.y),
            (self.face, hit.prim_index),
        ):
            dr.scatter(target, value, number, mode=dr.ReduceMode.NoConflicts)
        return hit.is_valid()

    def at(self, mi: ModuleType, ray: Any, sample: Any, stream: Any) -> Any:
        """The hit of a ray, as `Scene.ray_intersect` finds it."""
        import drjit as dr

        number = self.number(sample, stream)
        hit = dr.zeros(mi.PreliminaryIntersection3f)
        hit.t = dr.gather(mi.Float, self.distance, number)
        hit.prim_uv = mi.Point2f(
            dr.gather(mi.Float, self.u, number), dr.gather(mi.Float, self.v, number)
        )
        hit.prim_index = dr.gather(mi.UInt32, self.face, number)
        hit.valid = hit.t < dr.inf
        hit.shape = dr.select(hit.valid, self.shape, dr.zeros(mi.ShapePtr))
        return hit.compute_surface_interaction(ray)


@dataclass
class Threads:
    """A thread for every pixel and half of its samples, all pixels of the first half first.

    Attributes
    ----------
    count : int
        A Python number: a recording holds for arrays of one size only.
    stream : (count,)
        Numbers of the random streams; each gives pixel and half.
    pixels, seed, samples : opaque
        Number of pixels, seed, and samples of a thread.
    double : bool
        Whether samples are summed in float64, see `lobe_samples.in_float64`.
    hits : KeptHits or None
        Where rays are not traced again.
    hidden : (rays,) or None
        Which of these hits see the only lamp hidden.
    """

    count: int
    stream: Any
    pixels: Any
    seed: Any
    samples: Any
    double: bool = False
    hits: KeptHits | None = None
    hidden: Any = None

    def hit(self, mi: ModuleType, scene: Any, ray: Any, sample: Any) -> tuple[Any, Any]:
        """The hit of a thread's ray, and whether the lamp is hidden from it: None if unknown."""
        import drjit as dr

        if self.hits is None:
            return scene.ray_intersect(ray), None
        hit = self.hits.at(mi, ray, sample, self.stream)
        if self.hidden is None:
            return hit, None
        return hit, dr.gather(mi.Bool, self.hidden, self.hits.number(sample, self.stream))


def shade(
    mi: ModuleType, view: CameraView, light: Sampler, shading: Shading, threads: Threads
) -> Any:
    """Sums over the samples of every thread, flat and in the order of `Layout`."""
    import drjit as dr

    rays, draws = streams(mi, threads.stream, threads.seed)
    pixel, layout = threads.stream // HALVES, shading.layout
    number, vector = (mi.Float64, mi.Vector3d) if threads.double else (mi.Float, mi.Vector3f)

    def step(i: Any, sums: list[Any], rays: Any, draws: Any) -> tuple[Any, ...]:
        ray = view.film.ray(mi, pixel, rays)
        hit, hidden = threads.hit(mi, view.scene, ray, i)
        values = _sample(mi, view, ray, (hit, hidden), light, shading, draws)
        return i + 1, [s + v for s, v in zip(sums, values, strict=True)], rays, draws

    state = (mi.UInt32(0), [number(0.0) for _ in range(layout.channels)], rays, draws)
    # Looking for loop invariants needs a second trace, which costs more than it saves.
    with dr.scoped_set_flag(dr.JitFlag.OptimizeLoops, False):
        _, sums, _, _ = dr.while_loop(state, lambda i, *_: i < threads.samples, step)
    thread = dr.arange(mi.UInt32, threads.count)
    half = threads.stream % HALVES
    result = dr.empty(number, layout.channels * threads.count)
    for index, (before, count, node) in enumerate(layout.vectors):
        position = threads.pixels * (HALVES * before + half * (count - 1) + node) + thread
        # As writes do not overlap, one kernel can do them all.
        triple = vector(*sums[3 * index : 3 * index + 3])
        dr.scatter(result, triple, position, mode=dr.ReduceMode.NoConflicts)
    return result


def _sample(
    mi: ModuleType,
    view: CameraView,
    ray: Any,
    known: tuple[Any, Any],
    light: Sampler,
    shading: Shading,
    random: Any,
) -> list[Any]:
    """Contribution of one ray: normal, Stokes vectors of every BSDF, and products for variances."""
    import drjit as dr

    hit, hidden = known
    to_camera = to_camera_frame(mi, view.film.sensor, ray)
    valid = hit.is_valid()
    if shading.where is not None:
        valid &= shading.where(hit, random)

    def lobe(bsdfs: Sequence[Any]) -> list[Any]:
        incoming = view.incoming(hit, light, bsdfs[0], random, valid, hidden)
        return shading.lobe(mi, hit, incoming, bsdfs, to_camera, valid)

    specular, diffuse = lobe(shading.specular), lobe(shading.diffuse)
    normal = [dr.select(hit.is_valid(), c, 0.0) for c in hit.sh_frame.n]
    if not shading.errors:
        return normal + specular + diffuse
    squares = [v * v for v in specular] + [v * v for v in diffuse]
    # One diffuse node serves every specular node where the diffuse lobe does not depend on η.
    repeated = diffuse * (len(specular) // len(diffuse))
    products = [a * b for a, b in zip(specular, repeated, strict=True)]
    return normal + specular + diffuse + squares + products
