"""Families of one object whose light is traced along paths: it bounces in the object's hollows.

With the seed fixed, such images too are smooth functions of the refractive index: no probability
along a path depends on it. On tori of η in [1.33, 1.7], for depths of 3 and 6, both bodies and both
distributions of facets, roughness 0.05 and 0.3, under uniform, distant and area light, the images
of all nodes give those between within 1.5e-6 of the peak (rms), as at depth 2. They are no longer
linear in the albedo, on which probabilities depend: every albedo has nodes of its own.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from malus.renderers.families.interpolated import Family
from malus.renderers.families.nodes import nodes_by_albedo
from malus.renderers.family_key import FamilyKey
from malus.renderers.mitsuba.coverage import check_facing
from malus.renderers.mitsuba.kernel_warnings import refused_warnings
from malus.renderers.mitsuba.lobe_samples import HALVES, Lobes, spread_of, unit
from malus.renderers.mitsuba.path_traced import Room, RoomImages, check_variant, render_room
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, mitsuba
from malus.scenes.core.arrays import Float32Array
from malus.scenes.core.errors import InputError
from malus.scenes.materials.measured import Measured
from malus.scenes.scene import Sampling, Scene, may_be_circular


def needs_paths(scene: Scene, sampling: Sampling) -> bool:
    """Whether a scene of one object is rendered along paths of light.

    That is where light is reflected more than once, or where the fourth Stokes component is kept.
    """
    depth = sampling.depth(scene)
    return scene.surroundings is None and (depth > 2 or may_be_circular(scene, depth))


@dataclass(frozen=True)
class OneByOne:
    """A family whose scenes are rendered when their truths are asked for, each on its own.

    The last truth is kept: to decide on more samples, and to take their mean, asks for it again.
    """

    sampling: Sampling
    variant: Variant
    last: list[Truth] = field(default_factory=list)

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:  # noqa: ARG002
        """The truth of one scene."""
        for kept in self.last[:]:  # other threads may ask for other scenes meanwhile
            if kept.scene == scene:
                return kept
        with refused_warnings(f"scene {scene.id}"):
            truth = render_room(scene, self.sampling, self.variant)
        self.last[:] = [truth]
        return truth


def render_bounced(
    key: FamilyKey,
    scenes: Sequence[Scene],
    sampling: Sampling,
    variant: Variant,
    count: int | None = None,
) -> Family | OneByOne:
    """Render a family of one object along paths of light; `count` as for `Nodes.of`.

    Raises
    ------
    InputError
        In the scalar variant, and for a measured material.
    """
    check_variant(scenes[0], variant)
    if isinstance(scenes[0].surface, Measured):
        where, hint = f"scene {scenes[0].id}", "leave max_depth out, or give the material's index"
        raise InputError(where, "a max_depth of 2 for a measured material", "more", hint)
    if key.pattern:
        return OneByOne(sampling, variant)
    nodes = nodes_by_albedo(scenes, count)
    started = time.perf_counter()
    room = Room(mitsuba(variant), scenes[0], sampling)
    lobes = _lobes(room.images([[setting] for setting in nodes.rendered]), sampling.samples)
    check_facing(lobes.normals, lobes.pixels, key.camera, key.shape)
    seconds = time.perf_counter() - started
    return Family.of(key, nodes, lobes, variant.name, seconds)


def _lobes(images: RoomImages, samples: int) -> Lobes:
    """The pixels of a room's images that any object touches, as samples of both lobes."""
    pixels = np.flatnonzero(images.touched)
    count = images.variance.shape[2]

    def chosen(values: Float32Array) -> Float32Array:
        """Images (height, width, settings, …) as (settings, pixels, …)."""
        flat = values.reshape(-1, *values.shape[2:])[pixels]
        return np.ascontiguousarray(np.moveaxis(flat, 1, 0))

    def halves(values: Float32Array) -> Float32Array:
        return np.stack([chosen(values[half]) for half in range(HALVES)])

    variance = chosen(images.variance)
    none = np.zeros((count, len(pixels), 3), np.float32)
    s3, s3_variance = images.s3, images.s3_variance
    return Lobes(
        specular=halves(images.specular),
        diffuse=halves(images.diffuse),
        # The variance is that of the sum of both lobes.
        specular_variance=variance,
        diffuse_variance=none,
        covariance=none,
        pixels=pixels,
        normals=unit(images.normals[pixels]),
        normal_spread=spread_of(images.normals[pixels] / np.float32(samples)),
        covered=images.owner.ravel()[pixels] >= 0,
        s3=None if s3 is None else halves(s3),
        s3_variance=None if s3_variance is None else chosen(s3_variance),
    )
