"""Render a family: one shape, light, roughness and body, for every refractive index together."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from malus.renderers.families.adaptive import RepeatedRenders, render_until
from malus.renderers.families.bounced import OneByOne, needs_paths, render_bounced
from malus.renderers.families.interpolated import Family
from malus.renderers.families.nodes import family_nodes
from malus.renderers.families.patterned import PatternedFamily, with_part
from malus.renderers.family_key import FamilyKey
from malus.renderers.mitsuba import stokes_integrator, wavefront
from malus.renderers.mitsuba.bsdfs import bsdfs
from malus.renderers.mitsuba.coverage import check_facing
from malus.renderers.mitsuba.kernel_warnings import refused_warnings
from malus.renderers.mitsuba.lobe_samples import Lobes
from malus.renderers.mitsuba.path_traced import RenderedScene, render_room
from malus.renderers.mitsuba.patterns import (
    check_coordinates,
    has_surface,
    surface_number,
    surface_shares,
)
from malus.renderers.mitsuba.shading import Shading
from malus.renderers.mitsuba.translate import check_tangents
from malus.renderers.variant import Variant, choose, mitsuba
from malus.scenes.core.errors import InputError
from malus.scenes.lights.lights import Light
from malus.scenes.lights.polarised import is_polarised
from malus.scenes.scene import Sampling, Scene

__all__ = ["Family", "FamilyKey", "render_family"]

RenderedOnce = Family | RenderedScene | PatternedFamily | OneByOne
RenderedFamily = RenderedOnce | RepeatedRenders

_Value = TypeVar("_Value")


def render_family(
    scenes: Iterable[Scene],
    sampling: Sampling,
    variant: Variant | None = None,
    errors: bool = True,
    nodes: int | None = None,
) -> RenderedFamily:
    """Render all that the truths of `scenes` need; they must share a FamilyKey.

    Parameters, and what is raised, as those of `begin_family`.
    """
    return begin_family(scenes, sampling, variant, errors, nodes)()


def begin_family(
    scenes: Iterable[Scene],
    sampling: Sampling,
    variant: Variant | None = None,
    errors: bool = True,
    nodes: int | None = None,
) -> Callable[[], RenderedFamily]:
    """Begin to render all that the truths of `scenes` need; they must share a FamilyKey.

    The kernel of a plain family runs while the caller does something else. What needs several is
    rendered when it is asked for.

    Parameters
    ----------
    scenes : Scenes
    sampling : Sampling
        With a `target`, as many samples as it needs, the same for all of the family.
    variant : Variant, optional
        By default the fastest that works.
    errors : bool
        False skips what only standard errors need; halves and noise remain.
    nodes : int, optional
        Number of Chebyshev nodes in η; by default as many as the range of indices requires, or
        the indices themselves where those are no more.

    Returns
    -------
    function that waits for the end and returns the renders; to be called once

    Raises
    ------
    ValueError
        If there is no scene or they do not share a family.
    """
    scenes = list(scenes)
    keys = {FamilyKey.of(scene) for scene in scenes}
    if len(keys) != 1:
        raise ValueError(f"scenes: expected scenes of one family, found {len(keys)} families")
    key, chosen_variant, options = keys.pop(), variant or choose(), RenderOptions(errors, nodes)
    _check_light(key.light, chosen_variant)

    check_tangents(scenes[0])
    mitsuba(
        chosen_variant
    )  # loaded first: what it prints of missing libraries is no warning of a render

    def begun(sampling: Sampling) -> Callable[[], RenderedOnce]:
        room = key.room
        if room:
            return lambda: RenderedScene(render_room(room, sampling, chosen_variant))
        if needs_paths(scenes[0], sampling):
            return lambda: render_bounced(key, scenes, sampling, chosen_variant, nodes)
        if key.pattern:
            return lambda: _patterned(key, scenes, sampling, chosen_variant, options)
        return _begin_plain(key, scenes, sampling, chosen_variant, options)

    def watched(part: Callable[[], _Value]) -> _Value:
        with refused_warnings(f"scene {scenes[0].id}"):
            return part()

    if sampling.target is not None:
        return lambda: render_until(lambda s: watched(lambda: begun(s)()), scenes, sampling)
    finish = watched(lambda: begun(sampling))
    return lambda: watched(finish)


def is_complete(renders: RenderedFamily) -> bool:
    """Whether truths are made of renders without rendering more, as another process can do it."""
    if isinstance(renders, RepeatedRenders):
        return all(not isinstance(each, OneByOne) for each in renders.passes)
    return not isinstance(renders, OneByOne)


def _check_light(light: Light, variant: Variant) -> None:
    """Raises InputError for polarised light in the scalar variant, whose lights are Mitsuba's."""
    if is_polarised(light) and not variant.vectorised:
        hint = "install LLVM 17 or later (`malus doctor` says how), or leave `polarised` out"
        where, expected = f"light {light.label}", "LLVM or CUDA for polarised light"
        raise InputError(where, expected, variant.name, hint)


@dataclass(frozen=True)
class RenderOptions:
    """Options of `render_family`; `where` selects the hits that are shaded, by default all."""

    errors: bool = True
    nodes: int | None = None
    where: Callable[[Any, Any], Any] | None = None


def _begin_plain(
    key: FamilyKey,
    scenes: list[Scene],
    sampling: Sampling,
    variant: Variant,
    options: RenderOptions,
) -> Callable[[], Family]:
    """Begin to render a family of one object with one surface."""
    points = family_nodes(scenes, options.nodes)
    started = time.perf_counter()
    wait = _begin(key, list(points.rendered), sampling, variant, options)
    began = time.perf_counter() - started

    def finished() -> Family:
        started = time.perf_counter()
        lobes = wait()
        check_facing(lobes.normals, lobes.pixels, key.camera, key.shape)
        seconds = began + time.perf_counter() - started
        return Family.of(key, points, lobes, variant.name, seconds)

    return finished


def _patterned(
    key: FamilyKey,
    scenes: list[Scene],
    sampling: Sampling,
    variant: Variant,
    options: RenderOptions,
) -> PatternedFamily:
    """Render a family of one object with several surfaces, each on its own."""
    if not variant.vectorised:
        hint = "install LLVM 17 or later (`malus doctor` says how), or choose one surface"
        where, expected = f"scene {scenes[0].id}", "LLVM or CUDA for several surfaces on one object"
        raise InputError(where, expected, variant.name, hint)
    assert key.pattern is not None
    check_coordinates(key.pattern, key.shape)
    mi, count = mitsuba(variant), len(key.parts)
    families = []
    for index in range(count):
        parts = [with_part(scene, index) for scene in scenes]
        only_here = replace(options, where=has_surface(mi, key.pattern, count, index))
        begun = _begin_plain(FamilyKey.of(parts[0]), parts, sampling, variant, only_here)
        families.append(begun())
    stage = wavefront.stage(variant, key.shape, key.camera, key.light)
    side = key.camera.resolution
    number_at = surface_number(mi, key.pattern, count)
    shares = surface_shares(mi, stage.view.film, stage.scene, number_at, count)
    by_pixel = shares.reshape(side, side, count)
    return PatternedFamily(key, tuple(families), by_pixel, sampling.samples)


def _begin(
    key: FamilyKey,
    nodes: list[float | complex],
    sampling: Sampling,
    variant: Variant,
    options: RenderOptions,
) -> Callable[[], Lobes]:
    """Begin to render Stokes samples of both lobes at every node."""
    if not variant.vectorised:
        return lambda: stokes_integrator.render_lobes(variant, key, nodes, sampling)
    replay = options.where is None and key.measured is None

    def shading() -> Shading:
        specular, diffuse = bsdfs(variant, nodes, key.facets, key.body, key.measured)
        return Shading(
            specular, diffuse, options.errors, options.where, replay, key.facets.distribution
        )

    stage = wavefront.stage(variant, key.shape, key.camera, key.light)
    return stage.begin(key.light, shading, sampling)
