"""Render scenes whose objects light each other, or themselves, by tracing paths of light.

Mitsuba's own BSDFs and its `path` integrator do the work. Where a ray of the camera first meets an
object, the BSDF is evaluated for the specular and the diffuse lobe apart. That point is lit by the
light itself, sampled as in `lighting` and shadowed by all objects, and by these objects: along
a direction drawn from the BSDF, by the Stokes vector that the integrator returns there with the
light hidden from it. All bands use the same random numbers: colours are not speckled.

The fourth component of the Stokes vector is kept where it can be non-zero (`may_be_circular`). It
belongs to the specular lobe: diffuse light was depolarised inside the body.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any, Self

import numpy as np

from malus.renderers.mitsuba.coverage import covering
from malus.renderers.mitsuba.distances import camera_distance, scene_radius, view_length
from malus.renderers.mitsuba.lighting import Sampler, sampler
from malus.renderers.mitsuba.lobe_samples import (
    HALVES,
    as_float32,
    finite,
    in_float64,
    spread_of,
    unit,
)
from malus.renderers.mitsuba.padding import padding
from malus.renderers.mitsuba.patterns import surface_shares
from malus.renderers.mitsuba.placed import object_bsdf, parts_of, pattern_on, placed_object
from malus.renderers.mitsuba.polarised_emitters import room_emitters
from malus.renderers.mitsuba.pooled import pooled, pooled_where_rare
from malus.renderers.mitsuba.rays import Film, stream_number, streams, to_camera_frame
from malus.renderers.mitsuba.translate import LAMP_DISTANCE, sensor
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.core.arrays import (
    BoolArray,
    Float32Array,
    Float64Array,
    FloatArray,
    Int32Array,
    NumberArray,
    UInt32Array,
)
from malus.scenes.core.errors import InputError
from malus.scenes.lights.lights import Distant
from malus.scenes.materials.surface import Patterned
from malus.scenes.scene import Sampling, Scene, may_be_circular

PIXELS_A_LAUNCH = 1 << 16

_NORMAL, _SPECULAR, _DIFFUSE, _SQUARES = (slice(i, i + 3) for i in (0, 3, 6, 9))
_HITS, _S3, _S3_SQUARE = 12, slice(13, 14), slice(14, 15)
_CHANNELS = 13
"""Channels of the sums: normal, lobes, squares of their sum, hits; s3 and its square may follow."""

Setting = tuple[float | complex, float]
"""Index and albedo of a surface in one render."""


def render_room(scene: Scene, sampling: Sampling, variant: Variant) -> Truth:
    """The truth of a scene with surroundings; its mask holds the pixels of all objects.

    Raises
    ------
    InputError
        In the scalar variant, which cannot keep the lobes apart along a path.
    """
    check_variant(scene, variant)
    return Room(mitsuba(variant), scene, sampling).truth()


def check_variant(scene: Scene, variant: Variant) -> None:
    """Check that paths of light can be traced, with the lobes of the first hit apart.

    Raises
    ------
    InputError
        In the scalar variant.
    """
    if variant.vectorised:
        return
    hint = "install LLVM 17 or later (`malus doctor` says how), or"
    where, expected = f"scene {scene.id}", "LLVM or CUDA for"
    if scene.surroundings is None:
        expected, hint = f"{expected} light that bounces", f"{hint} leave max_depth out"
    else:
        expected = f"{expected} a scene of several objects"
        hint = f"{hint} leave the surroundings out"
    raise InputError(where, expected, variant.name, hint)


@dataclass(frozen=True)
class RoomImages:
    """Images of a room in several settings of its surfaces, side by side like bands.

    Attributes
    ----------
    specular, diffuse : (2, height, width, settings, 3)
        Means of each half of the samples, for either lobe.
    variance : (height, width, settings, 3)
        Variance of the mean of all samples, of both lobes together.
    normals : (pixels, 3)
        Sums of the shading normals in the world.
    owner : (height, width)
        Number of the object that covers a pixel, or -1.
    touched : (pixels,) bool
        Whether any sample hit an object.
    s3 : (2, height, width, settings) or None
        Fourth component, as `specular`; `s3_variance` (height, width, settings) is its variance.
    """

    specular: Float32Array
    diffuse: Float32Array
    variance: Float32Array
    normals: Float32Array
    owner: Int32Array
    touched: BoolArray
    s3: Float32Array | None = None
    s3_variance: Float32Array | None = None

    @classmethod
    def of_sums(
        cls, sums: FloatArray, owner: Int32Array, samples: int, bounced: bool, drawn: bool
    ) -> Self:
        """From sums over samples (channels, halves, pixels, settings), and owners of pixels.

        Light comes to pixels by few samples where it `bounced` or was `drawn`: see `pooled`.
        """
        side = math.isqrt(len(owner))

        def mean(part: slice) -> FloatArray:
            # (channels, halves, pixels, settings) -> (halves, height, width, settings, channels)
            channels = np.moveaxis(sums[part], 0, -1)
            means: FloatArray = channels.reshape(HALVES, side, side, *channels.shape[2:])
            return means / np.float32(samples // HALVES)

        specular, diffuse, squares = (mean(part) for part in (_SPECULAR, _DIFFUSE, _SQUARES))
        means, s3 = specular + diffuse, mean(_S3)
        means = np.concatenate([means, s3], axis=-1)
        squares = np.concatenate([squares, mean(_S3_SQUARE)], axis=-1)
        hits = sums[_HITS, :, :, 0].sum(axis=0)
        owner = np.where((owner >= 0) & (hits == samples), owner, -1).reshape(side, side)
        normals = as_float32(sums[_NORMAL, :, :, 0].sum(axis=1).T)
        # Rounding can leave a tiny negative variance where all samples are equal.
        of_one = np.maximum(squares.mean(axis=0) - means.mean(axis=0) ** 2, 0)
        variance = (pooled(of_one, owner) if bounced else of_one) / np.float32(samples - 1)
        if drawn and not bounced:
            variance = pooled_where_rare(variance, means.mean(axis=0)[..., 0], owner, samples)
        return cls(
            specular=as_float32(specular),
            diffuse=as_float32(diffuse),
            variance=as_float32(variance[..., :3]),
            normals=normals,
            owner=owner,
            touched=np.asarray(normals.any(axis=-1)),
            s3=as_float32(s3[..., 0]) if s3.size else None,
            s3_variance=as_float32(variance[..., 3]) if s3.size else None,
        )


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
        import drjit as dr

        self.mi, self.described, self.sampling = mi, described, sampling
        scene = described
        object_bsdfs = [object_bsdf(mi, placed) for placed in scene.objects]
        self.bsdfs = [bsdf for _, bsdfs in object_bsdfs for bsdf in bsdfs]
        self.shapes = [
            placed_object(mi, placed, bsdf)
            for placed, (bsdf, _) in zip(scene.objects, object_bsdfs, strict=True)
        ]
        self.spare = padding(mi, [bsdfs for _, bsdfs in object_bsdfs])
        parts = {f"object{i}": shape for i, shape in enumerate(self.shapes)}
        reach = scene_radius(scene)
        # One scene, because a kernel on CUDA traces rays in one scene only. Rays of the camera and
        # shadow rays end before the lamp, which is an object too; paths of light reach it.
        # Opaque, so that scenes of equal structure share a kernel.
        self.ray_length = dr.opaque(mi.Float, view_length(scene))
        lamp = max(LAMP_DISTANCE * reach, 10 * camera_distance(scene))
        self.scene = mi.load_dict(
            {"type": "scene", "sensor": sensor(mi, scene.camera, 2 * reach)}
            | room_emitters(mi, scene.light, reach, lamp)
            | parts
        )
        self.shape_pointers = mi.ShapePtr(self.shapes)
        self.film = Film.of(self.scene.sensors()[0], scene.camera.resolution, self.ray_length)
        self.owner = covering(mi, self.film, self.scene, self.shapes)
        depth = sampling.depth(scene)
        # Among objects, paths of more than five pieces end at random: most of them carry little.
        # How they end depends on the surfaces, whose images would be no smooth functions of these.
        self.path = _path(mi, depth, roulette=scene.surroundings is not None)
        self.circular = may_be_circular(scene, depth)
        self.channels = _CHANNELS + 2 * self.circular
        everything, flags = mi.TransportMode.Radiance, mi.BSDFFlags
        self.all_lobes = mi.BSDFContext()
        self.lobes = [
            mi.BSDFContext(everything, int(flags.GlossyReflection | flags.DeltaReflection)),
            mi.BSDFContext(everything, int(flags.DiffuseReflection)),
        ]

    def truth(self) -> Truth:
        """Render all bands, and put them together as a truth."""
        scene = self.described
        images = self.images([self._of_band(band) for band in range(len(scene.wavelengths_nm))])
        specular, diffuse = images.specular, images.diffuse
        normals = images.normals @ scene.camera.axes.astype(np.float32).T
        eta, alpha = self._maps()
        truth = Truth(
            scene=scene,
            specular=specular.mean(axis=0),
            diffuse=diffuse.mean(axis=0),
            normals=unit(normals).reshape(*images.owner.shape, 3),
            normal_spread=spread_of(normals / np.float32(self.sampling.samples)).reshape(
                images.owner.shape
            ),
            mask=images.owner >= 0,
            standard_error=np.sqrt(images.variance),
            specular_noise=0.5 * (specular[0] - specular[1]),
            diffuse_noise=0.5 * (diffuse[0] - diffuse[1]),
            interpolation_error={"rms": 0.0, "worst": 0.0},
            eta_map=eta,
            alpha_map=alpha,
        )
        if images.s3 is None or images.s3_variance is None:
            return truth
        return replace(
            truth,
            s3=images.s3.mean(axis=0),
            s3_noise=0.5 * (images.s3[0] - images.s3[1]),
            s3_standard_error=np.sqrt(images.s3_variance),
        )

    def images(self, settings: Sequence[Sequence[Setting]]) -> RoomImages:
        """Render the room with each of several settings of all its surfaces.

        All settings share their random numbers, so that images are smooth functions of them.
        """
        sums = np.stack([self._sums(of_surfaces) for of_surfaces in settings], axis=-1)
        bounced, drawn = self.path is not None, not isinstance(self.described.light, Distant)
        return RoomImages.of_sums(sums, self.owner, self.sampling.samples, bounced, drawn)

    def _of_band(self, band: int) -> list[Setting]:
        """Index and albedo of every surface in a band."""
        bands = self.described.wavelengths_nm
        surfaces = [bsdf.surface for bsdf in self.bsdfs]
        return [
            (surface.indices(bands)[band].item(), float(surface.albedos(bands)[band]))
            for surface in surfaces
        ]

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
            alpha[here] = shares[here] @ [part.isotropic_alpha for part in parts[number]]
        return eta.reshape(side, side, -1), alpha.reshape(side, side)

    def _sums(self, settings: Sequence[Setting]) -> FloatArray:
        """Sums over the samples of every half and pixel, (channels, halves, pixels)."""
        for bsdf, (eta, albedo) in zip(self.bsdfs, settings, strict=True):
            bsdf.set_band(eta, albedo)
        light = sampler(self.mi, self.described.light, self.scene)
        total = self.described.camera.resolution**2
        number = np.float64 if in_float64(self.sampling.samples) else np.float32
        sums = np.empty((self.channels, HALVES, total), dtype=number)
        for start in range(0, total, PIXELS_A_LAUNCH):
            pixels = np.arange(start, min(start + PIXELS_A_LAUNCH, total), dtype=np.uint32)
            self._launch(pixels, light, sums[:, :, pixels[0] : pixels[-1] + 1])
        return sums

    def _launch(self, pixels: UInt32Array, light: Sampler, result: FloatArray) -> None:
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
        number = mi.Float64 if result.dtype == np.float64 else mi.Float
        zeros = [dr.zeros(number, count) for _ in range(self.channels)]
        state = (dr.zeros(mi.UInt32, count), zeros, rays, draws, path_sampler)
        # Dr.Jit would trace the loop twice to find what does not change in it: hardly anything.
        with dr.scoped_set_flag(dr.JitFlag.OptimizeLoops, False):
            _, sums, *_ = dr.while_loop(state, lambda i, *_: i < samples, step)
        dr.eval(sums)
        for row, values in zip(result, sums, strict=True):
            row[:] = finite(np.asarray(values)).reshape(HALVES, -1)

    def _sample(
        self, ray: Any, owner: Any, light: Sampler, draws: Any, path_sampler: Any
    ) -> list[Any]:
        """Contribution of one ray to every channel."""
        import drjit as dr

        mi = self.mi
        hit = self.scene.ray_intersect(ray)
        valid = hit.is_valid()
        shaded = [mi.Float(0.0) for _ in range(3 * len(self.lobes))]
        s3 = mi.Float(0.0)
        to_camera = to_camera_frame(mi, self.film.sensor, ray)
        for direction, weight, stokes in self._incoming(hit, light, draws, path_sampler):
            for k, lobe in enumerate(self.lobes):
                mueller = hit.bsdf().eval(lobe, hit, direction, valid)
                mueller = to_camera @ hit.to_world_mueller(mueller, -direction, hit.wi)
                for row in range(3):
                    outgoing = sum(mueller[row, j][0] * s for j, s in enumerate(stokes))
                    shaded[3 * k + row] += dr.select(weight > 0, outgoing * weight, 0.0)
                if self.circular and k == 0:
                    outgoing = sum(mueller[3, j][0] * s for j, s in enumerate(stokes))
                    s3 += dr.select(weight > 0, outgoing * weight, 0.0)
        normal = [dr.select(valid, c, 0.0) for c in hit.sh_frame.n]
        whole = [a + b for a, b in zip(shaded[:3], shaded[3:], strict=True)]
        # The shapes' addresses are data, so that they alone make no new kernel.
        owners = dr.gather(mi.ShapePtr, self.shape_pointers, owner, owner >= 0)
        on_owner = (owner >= 0) & (hit.shape == owners)
        values = [*normal, *shaded, *(w * w for w in whole), dr.select(on_owner, mi.Float(1), 0.0)]
        return [*values, s3, s3 * s3] if self.circular else values

    def _incoming(self, hit: Any, light: Sampler, draws: Any, path_sampler: Any) -> list[Any]:
        """Directions (local), weights and Stokes vectors of the light that arrives at a hit."""
        import drjit as dr

        mi, valid, bsdf = self.mi, hit.is_valid(), hit.bsdf()
        arriving = []
        for direction, weight, stokes in light(hit, bsdf, draws, valid):
            ray = hit.spawn_ray(hit.to_world(direction))
            ray.maxt = self.ray_length
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


def _path(mi: ModuleType, max_depth: int, roulette: bool) -> Any:
    """Integrator of the light from objects; None where paths end at the first object."""
    if max_depth == 2:
        return None
    path = {"type": "path", "max_depth": max_depth - 1, "hide_emitters": True}
    return mi.load_dict(path if roulette else path | {"rr_depth": max_depth})
