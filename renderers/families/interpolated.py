"""Truths of a family of scenes, interpolated as polynomials in the refractive index."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from malus.renderers.families.nodes import Nodes, NodesByAlbedo
from malus.renderers.family_key import FamilyKey
from malus.renderers.mitsuba.lobe_samples import Lobes
from malus.renderers.mitsuba.pooled import pooled_where_rare
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import BoolArray, Float32Array
from malus.scenes.lights.lights import Distant
from malus.scenes.scene import Scene

Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True)
class Family:
    """Renders of both lobes at a few refractive indices, from which truths are interpolated.

    Attributes
    ----------
    nodes : Nodes or NodesByAlbedo
        Refractive indices of the renders.
    lobes : Lobes
        Stokes samples of both lobes at the nodes.
    interpolation_error : dict
        'rms' and 'worst' of both lobes at a held-out index, over the image's peak.
    seconds : float
        Time of the renders.
    """

    key: FamilyKey
    nodes: Nodes | NodesByAlbedo
    lobes: Lobes
    variant: str
    seconds: float
    interpolation_error: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        key: FamilyKey,
        nodes: Nodes | NodesByAlbedo,
        lobes: Lobes,
        variant: str,
        seconds: float,
    ) -> Self:
        """From renders at all indices of `nodes`; those held out tell the error, and are left."""
        error = interpolation_error(nodes, lobes)
        return cls(key, nodes, lobes.at(nodes.kept), variant, seconds, error)

    @functools.cached_property
    def normals(self) -> Float32Array:
        """Unit normals (height, width, 3) in the image frame, zero off the object."""
        axes = self.key.camera.axes.astype(self.lobes.normals.dtype)
        return self._image((self.lobes.normals @ axes.T)[:, None, :])[:, :, 0]

    @functools.cached_property
    def normal_spread(self) -> Float32Array:
        """How far the normals within each pixel (height, width) differ, degrees."""
        return self._image(self.lobes.normal_spread[:, None, None])[:, :, 0, 0]

    @functools.cached_property
    def mask(self) -> BoolArray:
        """Pixels (height, width) that the object covers entirely."""
        return self._image(self.lobes.covered[:, None, None])[:, :, 0, 0]

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        """The truth of one scene of this family, interpolated in η for every band.

        Parameters
        ----------
        scene : Scene
            Its key must be this family's.
        standard_error : bool
            False leaves the standard errors out (zeros), which saves time.

        Raises
        ------
        ValueError
            If the scene belongs to another family or its index lies outside the nodes.
        """
        truth, draws = self.unpooled_truth(scene, standard_error), self.lobes.draws
        return with_pooled_error(truth, draws) if standard_error and draws else truth

    def unpooled_truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        """As `truth`, with the standard errors of each pixel's own samples."""
        self._check(scene)
        of_nodes, factors = self.nodes.of_scene(scene)
        weights, albedo = of_nodes.astype(np.float32), factors.astype(np.float32)[:, None]
        specular, specular_noise = self._mean_and_noise(self.lobes.specular, weights)
        diffuse, diffuse_noise = self._mean_and_noise(self.lobes.diffuse, weights)
        side, bands = self.key.camera.resolution, len(weights)
        error = np.zeros((side, side, bands, 3), np.float32)  # untouched memory costs nothing
        if standard_error:
            error = self._image(self._error(weights, albedo))
        truth = Truth(
            scene=scene,
            specular=self._image(specular),
            diffuse=self._image(diffuse * albedo),
            normals=self.normals,
            normal_spread=self.normal_spread,
            mask=self.mask,
            standard_error=error,
            specular_noise=self._image(specular_noise),
            diffuse_noise=self._image(diffuse_noise * albedo),
            interpolation_error=self.interpolation_error,
        )
        return self._with_s3(truth, weights, standard_error)

    def _with_s3(self, truth: Truth, weights: Float32Array, standard_error: bool) -> Truth:
        """The truth with its fourth Stokes component, where the renders have one."""
        lobes = self.lobes
        if lobes.s3 is None or lobes.s3_variance is None:
            return truth
        first, second = (self._image((weights @ half).T) for half in lobes.s3)
        variance = np.maximum((weights @ lobes.s3_variance).T, 0) * np.float32(standard_error)
        return replace(
            truth,
            s3=np.float32(0.5) * (first + second),
            s3_noise=np.float32(0.5) * (first - second),
            s3_standard_error=self._image(np.sqrt(variance)),
        )

    def weights_of(
        self, scenes: Sequence[Scene]
    ) -> tuple[tuple[Float32Array, Float32Array], Float32Array]:
        """Weights of the nodes in the bands of several scenes side by side, and their albedos.

        Returns
        -------
        weights : (K, bands) of the specular nodes, and (K or 1, bands) of the diffuse ones
        albedo : (bands,)

        Raises
        ------
        ValueError
            If a scene belongs to another family or its index lies outside the nodes.
        """
        for scene in scenes:
            self._check(scene)
        of_scenes = [self.nodes.of_scene(scene) for scene in scenes]
        of_nodes = np.concatenate([weights for weights, _ in of_scenes])
        albedo = np.concatenate([factors for _, factors in of_scenes])
        weights = np.ascontiguousarray(of_nodes.T, dtype=np.float32)

        def of_lobe(halves: Float32Array) -> Float32Array:
            alike = halves.shape[1] == 1  # the same in every band
            return np.ones((1, len(albedo)), np.float32) if alike else weights

        both = of_lobe(self.lobes.specular), of_lobe(self.lobes.diffuse)
        return both, albedo.astype(np.float32)

    def _check(self, scene: Scene) -> None:
        if FamilyKey.of(scene) != self.key:
            raise ValueError(f"scene {scene.id}: expected a scene of this family")

    def _mean_and_noise(
        self, halves: Float32Array, weights: Float32Array
    ) -> tuple[Float32Array, Float32Array]:
        """Mean of both halves and half their difference, (pixels, bands, 3) each."""
        first, second = halves
        return (
            interpolate(weights, np.float32(0.5) * (first + second)),
            interpolate(weights, np.float32(0.5) * (first - second)),
        )

    def _error(self, weights: Float32Array, albedo: Float32Array) -> Float32Array:
        """Standard error (pixels, bands, 3) of the sum of both lobes."""
        # The noise at every node is the same draw, so that its variance is smooth in η as well.
        lobes = self.lobes
        if lobes.specular_variance is None or lobes.diffuse_variance is None:
            raise ValueError("standard_error: this family was rendered without errors")
        assert lobes.covariance is not None
        variance = (
            interpolate(weights, lobes.specular_variance)
            + 2 * albedo * interpolate(weights, lobes.covariance)
            + albedo**2 * interpolate(weights, lobes.diffuse_variance)
        )
        result: Float32Array = np.sqrt(np.maximum(variance, 0))
        return result

    def _image(self, values: NDArray[Scalar]) -> NDArray[Scalar]:
        """Values (pixels, ...) as an image (height, width, ...), zero off the object."""
        side = self.key.camera.resolution
        image = np.zeros((side * side, *values.shape[1:]), dtype=values.dtype)
        if values.shape[-1] == 3 and values.strides[-1] == values.itemsize:
            # The same bytes, a Stokes vector at a time: numbers alone take four times as long.
            triple = np.dtype((np.void, 3 * values.itemsize))
            image.view(triple)[self.lobes.pixels] = values.view(triple)
        else:
            image[self.lobes.pixels] = values
        return image.reshape(side, side, *values.shape[1:])


def with_pooled_error(truth: Truth, draws: int) -> Truth:
    """A truth whose standard errors are its neighbours' too in pixels that few of `draws` light.

    Unchanged under a distant light, which every sample meets that sees it.
    """
    if isinstance(truth.scene.light, Distant):
        return truth
    owner = truth.mask.astype(np.int32) - 1
    own = np.square(truth.standard_error)
    variance = pooled_where_rare(own, truth.image, owner, draws)
    # Of all others the errors stay to the bit, also those whose squares are rounded to 0.
    error = np.where(variance == own, truth.standard_error, np.sqrt(variance))
    return replace(truth, standard_error=error)


def interpolation_error(nodes: Nodes | NodesByAlbedo, lobes: Lobes) -> dict[str, float]:
    """Error of interpolated images at held-out indices, over the peak: 'rms' and 'worst'."""
    rms, worst = [0.0], [0.0]
    for own, weights, held_out in nodes.checks():
        for halves in (lobes.specular, lobes.diffuse):
            if halves.shape[1] <= held_out or halves.size == 0:  # the same at every index
                continue
            images = halves.mean(axis=0)
            true = images[held_out]
            difference = interpolate(weights.astype(np.float32), images[own])[:, 0] - true
            peak = max(float(true[:, 0].max()), float(np.finfo(np.float32).tiny))
            rms.append(float(np.sqrt(np.mean(np.square(difference, dtype=np.float64)))) / peak)
            worst.append(float(np.abs(difference).max()) / peak)
    return {"rms": max(rms), "worst": max(worst)}


_PRODUCTS = 1 << 17
"""Half of the multiplications from which on OpenBLAS starts threads."""
_TILE = 96
"""A multiple of the columns that BLAS multiplies at a time."""


def interpolate(weights: Float32Array, nodes: Float32Array) -> Float32Array:
    """Values (pixels, bands, 3) from those at nodes (K, pixels, 3) and weights (bands, K).

    A single node gives every band the same values.
    """
    if len(nodes) == 1:
        bands = (nodes.shape[1], len(weights), 3)
        return np.broadcast_to(nodes[0][:, None, :], bands)
    result = np.empty((len(weights), *nodes.shape[1:]), np.float32)
    values, flat = result.reshape(len(weights), -1), nodes.reshape(len(nodes), -1)
    # A product that one core does at once: BLAS would wait for its threads longer than they work.
    step = max(1, _PRODUCTS // weights.size // _TILE) * _TILE
    for start in range(0, flat.shape[1], step):
        block = slice(start, start + step)
        np.matmul(weights, flat[:, block], out=values[:, block])
    return result.transpose(1, 0, 2)
