"""Maps of a scene's geometry and surfaces: depth, normals, ids and more, see `scenes.maps`.

Rays through a regular grid in every pixel, without shading: they cost little beside a render.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from malus.renderers.mitsuba.distances import camera_distance, view_length
from malus.renderers.mitsuba.lobe_samples import unit
from malus.renderers.mitsuba.patterns import SurfaceNumber, spherical_coordinates
from malus.renderers.mitsuba.placed import pattern_on, placed_object, to_own_frame
from malus.renderers.mitsuba.rays import Film
from malus.renderers.mitsuba.translate import sensor, tessellated
from malus.renderers.mitsuba.wavefront import stage
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.core.arrays import AnyArray, Float32Array, IntArray, UInt32Array
from malus.scenes.core.errors import InputError
from malus.scenes.maps import MapName, different_surfaces
from malus.scenes.materials.surface import Patterned, Surface, surfaces_on
from malus.scenes.scene import Scene
from malus.scenes.shapes.shapes import MeshFile, Plane
from malus.scenes.surroundings import Placed

SIDE = 4
"""Rays along a side of a pixel, as for the shares of a pattern's surfaces."""

PIXELS_A_LAUNCH = 1 << 16


def check_variant(names: Sequence[MapName], variant: Variant, where: str) -> None:
    """Raise InputError for maps in the scalar variant, before anything is rendered."""
    if names and not variant.vectorised:
        hint = "install LLVM 17 or later (`malus doctor` says how), or leave the maps out"
        raise InputError(where, "LLVM or CUDA for maps", variant.name, hint)


def render_maps(
    scene: Scene, names: Sequence[MapName], variant: Variant
) -> dict[MapName, AnyArray]:
    """Maps (height, width, ...) of a scene by name.

    Raises
    ------
    InputError
        In the scalar variant, which would trace ray by ray.
    """
    if not names:
        return {}
    check_variant(names, variant, f"scene {scene.id}")
    traced = _Tracer(mitsuba(variant), scene, variant).traced()
    values = _values(scene, traced, set(names))
    side = scene.camera.resolution
    return {name: values[name].reshape(side, side, *values[name].shape[1:]) for name in names}


@dataclass(frozen=True)
class _Traced:
    """What the rays of every pixel met; all arrays are zero off all objects.

    Attributes
    ----------
    owner : (pixels,)
        Index of the object that most rays hit, or -1.
    hits : (pixels,)
        Number of rays that hit it.
    position, shading, geometric : (pixels, 3)
        Means over those rays, in world coordinates.
    uv : (pixels, 2)
    shares : dict of (pixels, surfaces) by object
        Of the surfaces of objects with a pattern.
    """

    owner: IntArray
    hits: Float32Array
    position: Float32Array
    shading: Float32Array
    geometric: Float32Array
    uv: Float32Array
    shares: dict[int, Float32Array]


class _Tracer:
    """A Mitsuba scene with the objects of a scene, whose surfaces and lights do not matter."""

    def __init__(self, mi: ModuleType, scene: Scene, variant: Variant) -> None:
        import drjit as dr

        self.mi, self.described = mi, scene
        self.objects = scene.objects
        if scene.surroundings is None:
            staged = stage(variant, scene.shape, scene.camera, scene.light)
            self.scene, self.film = staged.scene, staged.view.film
            self.shapes = self.scene.shapes()
        else:
            plain = mi.load_dict({"type": "diffuse"})
            self.shapes = [placed_object(mi, placed, plain) for placed in self.objects]
            parts = {f"object{i}": shape for i, shape in enumerate(self.shapes)}
            lens = {"sensor": sensor(mi, scene.camera, camera_distance(scene))}
            self.scene = mi.load_dict({"type": "scene"} | lens | parts)
            # As long as in a render, whose mask these maps go with: Mitsuba's own end earlier.
            far = dr.opaque(mi.Float, view_length(scene))
            self.film = Film.of(self.scene.sensors()[0], scene.camera.resolution, far)
        self.patterns: dict[int, tuple[SurfaceNumber, int]] = {
            index: (pattern_on(mi, placed), len(placed.surface.surfaces))
            for index, placed in enumerate(self.objects)
            if isinstance(placed.surface, Patterned)
        }

    def traced(self) -> _Traced:
        """Trace the rays of all pixels."""
        total = self.described.camera.resolution**2
        blocks = [
            self._launch(np.arange(start, min(start + PIXELS_A_LAUNCH, total), dtype=np.uint32))
            for start in range(0, total, PIXELS_A_LAUNCH)
        ]
        owner, sums = (np.concatenate(parts, axis=-1) for parts in zip(*blocks, strict=True))
        hits = sums[0]
        owner[hits == 0] = -1
        means = sums[1:] / np.maximum(hits, 1)
        counts = [count for _, count in self.patterns.values()]
        ends = 11 + np.cumsum([0, *counts])
        shares = (means[a:b].T for a, b in itertools.pairwise(ends))
        return _Traced(
            owner=owner,
            hits=hits,
            position=means[0:3].T,
            shading=means[3:6].T,
            geometric=means[6:9].T,
            uv=sums[10:12].T,
            shares=dict(zip(self.patterns, shares, strict=True)),
        )

    def _launch(self, pixels: UInt32Array) -> tuple[IntArray, Float32Array]:
        """Objects (pixels,) and sums (channels, pixels) over the rays of some pixels."""
        import drjit as dr

        mi, pixel = self.mi, self.mi.UInt32(pixels)
        owner = self._owner(pixel)
        channels = 12 + sum(count for _, count in self.patterns.values())

        def step(i: Any, sums: list[Any]) -> tuple[Any, list[Any]]:
            hit, index = self._hit(pixel, i)
            on = index == owner
            added = [dr.select(on, value, 0.0) for value in self._channels(hit, index)]
            # Coordinates of the first ray that hits the object stay.
            first = sums[0] == 0
            added[10:12] = [dr.select(first, value, 0.0) for value in added[10:12]]
            return i + 1, [s + a for s, a in zip(sums, added, strict=True)]

        zeros = [dr.zeros(mi.Float, len(pixels)) for _ in range(channels)]
        state = (dr.zeros(mi.UInt32, len(pixels)), zeros)
        _, sums = dr.while_loop(state, lambda i, _: i < SIDE**2, step)
        dr.eval(owner, sums)
        return np.asarray(owner).astype(np.int64), np.stack([np.asarray(s) for s in sums])

    def _owner(self, pixel: Any) -> Any:
        """Index of the object that most rays of each pixel hit; any where they hit none."""
        import drjit as dr

        mi, count = self.mi, len(self.objects)
        if count == 1:  # whatever is hit is this one
            return dr.zeros(mi.Int32, dr.width(pixel))

        def step(i: Any, counts: list[Any]) -> tuple[Any, list[Any]]:
            _, index = self._hit(pixel, i)
            return i + 1, [c + dr.select(index == k, mi.UInt32(1), 0) for k, c in enumerate(counts)]

        zeros = [dr.zeros(mi.UInt32, dr.width(pixel)) for _ in range(count)]
        state = (dr.zeros(mi.UInt32, dr.width(pixel)), zeros)
        _, counts = dr.while_loop(state, lambda i, _: i < SIDE**2, step)
        owner, most = dr.zeros(mi.Int32, dr.width(pixel)), mi.UInt32(0)
        for index, hits in enumerate(counts):
            owner = dr.select(hits > most, index, owner)
            most = dr.maximum(most, hits)
        return owner

    def _hit(self, pixel: Any, number: Any) -> tuple[Any, Any]:
        """What a ray of every pixel meets, and the index of that object, or -1."""
        import drjit as dr

        mi = self.mi
        x, y = (dr.gather(mi.Float, mi.Float(axis), number) for axis in _OFFSETS.T)
        resolution = self.film.resolution
        corner = mi.Point2f(pixel % resolution, pixel // resolution)
        hit = self.scene.ray_intersect(
            self.film.ray_through(mi, (corner + mi.Point2f(x, y)) / resolution),
            ray_flags=mi.RayFlags.Minimal | mi.RayFlags.UV | mi.RayFlags.ShadingFrame,
            coherent=False,
        )
        index = mi.Int32(-1)
        for k, shape in enumerate(self.shapes):
            index = dr.select(hit.is_valid() & (hit.shape == mi.ShapePtr(shape)), k, index)
        return hit, index

    def _channels(self, hit: Any, index: Any) -> Iterator[Any]:
        """Values of a hit in the order of the sums."""
        import drjit as dr

        mi = self.mi
        yield mi.Float(1.0)
        yield from hit.p
        yield from hit.sh_frame.n
        yield from hit.n
        uv = mi.Point2f(0.0)
        for k, placed in enumerate(self.objects):
            uv = dr.select(index == k, _coordinates(mi, placed, hit), uv)
        yield from uv
        for k, (number_at, count) in self.patterns.items():
            number = number_at(hit)
            for surface in range(count):
                near = dr.maximum(1.0 - dr.abs(number - surface), 0.0)
                yield dr.select(index == k, near, 0.0)


def _offsets() -> Float32Array:
    """Positions (rays, 2) in a pixel of side 1, those nearest to its centre first."""
    steps = (np.arange(SIDE) + 0.5) / SIDE
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    order = np.argsort(np.sum((grid - 0.5) ** 2, axis=1), kind="stable")
    return np.asarray(grid[order], dtype=np.float32)


_OFFSETS = _offsets()


def _coordinates(mi: ModuleType, placed: Placed, hit: Any) -> Any:
    """Texture coordinates of a hit on an object, see `scenes.maps`."""
    if isinstance(placed.shape, MeshFile) and tessellated(placed.shape).uv is not None:
        return hit.uv
    own = to_own_frame(mi, placed)(hit.p)
    if isinstance(placed.shape, Plane):
        return mi.Point2f(0.5 + 0.5 * own.x, 0.5 - 0.5 * own.z)
    turn, polar = spherical_coordinates(mi, own)
    return mi.Point2f(turn, 1.0 - polar)


def _values(scene: Scene, traced: _Traced, names: set[MapName]) -> dict[MapName, AnyArray]:
    """Maps (pixels, ...) by name; those of surfaces only where some are in `names`."""
    axes, camera = scene.camera.axes, scene.camera
    on = traced.owner >= 0
    depth = (camera.distance or 0.0) - traced.position @ axes[2]
    values: dict[MapName, AnyArray] = {
        "depth": np.where(on, depth, 0).astype(np.float32),
        "position": traced.position,
        "shading_normals": unit(traced.shading @ axes.T.astype(np.float32)),
        "geometric_normals": unit(traced.geometric @ axes.T.astype(np.float32)),
        "object_id": (traced.owner + 1).astype(np.uint16),
        "uv": traced.uv,
        "coverage": traced.hits / np.float32(SIDE**2),
    }
    if names - values.keys():
        values |= _surface_values(scene, traced)
    return values


def _surface_values(scene: Scene, traced: _Traced) -> dict[MapName, AnyArray]:
    """Maps (pixels, ...) of what the objects are made of."""
    surfaces, bands = different_surfaces(scene), scene.wavelengths_nm
    number = {surface.id: index for index, surface in enumerate(surfaces)}
    albedo = np.stack([_albedos(surface, bands) for surface in surfaces])
    eta = np.stack([surface.indices(bands) for surface in surfaces])
    alpha = np.array([np.nan if s.alpha is None else s.isotropic_alpha for s in surfaces])
    shares = np.zeros((len(traced.owner), len(surfaces)))
    for index, placed in enumerate(scene.objects):
        here = traced.owner == index
        own = traced.shares.get(index, np.ones((len(here), 1), np.float32))
        for part, share in zip(surfaces_on(placed.surface), own.T, strict=True):
            shares[here, number[part.id]] += share[here]
    complex_ = np.iscomplexobj(eta)
    return {
        "material_id": np.where(traced.owner >= 0, shares.argmax(axis=1) + 1, 0).astype(np.uint16),
        "albedo": _mixed(shares, albedo).astype(np.float32),
        "eta": _mixed(shares, eta).astype(np.complex64 if complex_ else np.float32),
        "alpha": _mixed(shares, alpha[:, None])[:, 0].astype(np.float32),
    }


def _mixed(shares: AnyArray, values: AnyArray) -> AnyArray:
    """Values (pixels, ...) of mixed surfaces; a surface without a share counts not, even if NaN."""
    mixed = np.zeros((len(shares), values.shape[1]), values.dtype)
    for share, value in zip(shares.T, values, strict=True):
        here = share > 0
        mixed[here] += share[here, None] * value
    return mixed


def _albedos(surface: Surface, bands: tuple[float, ...]) -> AnyArray:
    unknown = surface.kind == "measured"
    return np.full(len(bands), np.nan) if unknown else surface.albedos(bands)
