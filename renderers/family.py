"""A family of renders: one shape, light, roughness and body, for every refractive index at once."""

from __future__ import annotations

import functools
import time
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from malus.renderers import stock, wavefront
from malus.renderers.bsdfs import bsdfs
from malus.renderers.lobes import Floats, Lobes
from malus.renderers.nodes import chebyshev_nodes, held_out, interpolation_weights
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, choose
from malus.scenes.lights import Light
from malus.scenes.scene import Body, Camera, Sampling, Scene
from malus.scenes.shapes import Shape


@dataclass(frozen=True)
class FamilyKey:
    """What scenes must share to come from the same renders."""

    shape: Shape
    camera: Camera
    light: Light
    alpha: float
    body: Body

    @classmethod
    def of(cls, scene: Scene) -> FamilyKey:
        """The family of a scene: all of it but the material, the bands and the albedo."""
        surface = scene.surface
        return cls(scene.shape, scene.camera, scene.light, surface.alpha, surface.body)


@dataclass(frozen=True)
class Family:
    """Both lobes as polynomials in η, and what they cost.

    Attributes
    ----------
    nodes : (K,)
        Indices that were rendered.
    lobes : Lobes
        At the nodes.
    interpolation_error : dict
        'rms' and 'worst' of both lobes at a held-out index, over the image's peak.
    seconds : float
        Time of the renders.
    """

    key: FamilyKey
    nodes: NDArray[np.float64]
    lobes: Lobes
    variant: str
    seconds: float
    interpolation_error: dict[str, float] = field(default_factory=dict)

    @functools.cached_property
    def normals(self) -> Floats:
        """Unit normals (height, width, 3), zero off the object."""
        return self._image(self.lobes.normals[:, None, :])[:, :, 0]

    @functools.cached_property
    def mask(self) -> NDArray[np.bool_]:
        """Pixels (height, width) that the object covers entirely."""
        return self._image(self.lobes.covered[:, None, None])[:, :, 0, 0]

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        """The truth of one scene of this family, interpolated in η for every band.

        Parameters
        ----------
        scene : Scene
            Its key must be this family's.
        standard_error : bool
            False leaves the standard errors out (zeros) where nothing reads them.

        Raises
        ------
        ValueError
            If the scene belongs to another family or its index lies outside the nodes.
        """
        if FamilyKey.of(scene) != self.key:
            raise ValueError(f"scene {scene.id}: expected a scene of this family")
        weights = self._weights(scene.eta)
        albedo = np.float32(scene.surface.albedo)
        specular, specular_noise = self._mean_and_noise(self.lobes.specular, weights)
        diffuse, diffuse_noise = self._mean_and_noise(self.lobes.body, weights)
        error = self._error(weights, albedo) if standard_error else np.zeros_like(specular)
        return Truth(
            scene=scene,
            specular=self._image(specular),
            diffuse=self._image(diffuse * albedo),
            normals=self.normals,
            mask=self.mask,
            standard_error=self._image(error),
            specular_noise=self._image(specular_noise),
            diffuse_noise=self._image(diffuse_noise * albedo),
            interpolation_error=self.interpolation_error,
        )

    def _weights(self, eta: NDArray[np.float64]) -> Floats:
        slack = 0.01 * np.ptp(self.nodes) + 1e-9 if len(self.nodes) == 1 else _edge(self.nodes)
        if eta.min() < self.nodes.min() - slack or eta.max() > self.nodes.max() + slack:
            raise ValueError(f"eta: expected a value among this family's nodes, found {eta}")
        return interpolation_weights(self.nodes, eta).astype(np.float32)

    def _mean_and_noise(self, halves: Floats, weights: Floats) -> tuple[Floats, Floats]:
        """Mean of both halves and half their difference, (pixels, bands, 3) each."""
        first, second = halves
        return (
            _interpolate(weights, np.float32(0.5) * (first + second)),
            _interpolate(weights, np.float32(0.5) * (first - second)),
        )

    def _error(self, weights: Floats, albedo: np.float32) -> Floats:
        # The noise at every node is the same draw, so that its variance is smooth in η as well.
        lobes = self.lobes
        variance = (
            _interpolate(weights, lobes.specular_variance)
            + 2 * albedo * _interpolate(weights, lobes.covariance)
            + albedo**2 * _interpolate(weights, lobes.body_variance)
        )
        result: Floats = np.sqrt(np.maximum(variance, 0))
        return result

    def _image(self, values: NDArray[np.generic]) -> NDArray[np.generic]:
        side = self.key.camera.resolution
        image = np.zeros((side * side, *values.shape[1:]), dtype=values.dtype)
        image[self.lobes.pixels] = values
        return image.reshape(side, side, *values.shape[1:])


def _edge(nodes: NDArray[np.float64]) -> float:
    """How far the interval of Chebyshev nodes reaches beyond its outermost node."""
    half = 0.5 * np.ptp(nodes) / np.cos(np.pi / (2 * len(nodes)))
    return float(half * (1 - np.cos(np.pi / (2 * len(nodes)))) * (1 + 1e-9) + 1e-12)


def _interpolate(weights: Floats, nodes: Floats) -> Floats:
    """Values (pixels, bands, 3) from nodes (K, pixels, 3); one node serves every band."""
    if len(nodes) == 1:
        bands = (nodes.shape[1], len(weights), 3)
        return np.broadcast_to(nodes[0][:, None, :], bands)
    result: Floats = np.einsum("bk,kpc->pbc", weights, nodes, optimize=True)
    return result


def render_family(
    scenes: Iterable[Scene], sampling: Sampling, variant: Variant | None = None
) -> Family:
    """Render what all of `scenes` need; they must share a FamilyKey.

    Raises
    ------
    ValueError
        If there is no scene or they do not share a family.
    """
    scenes = list(scenes)
    keys = {FamilyKey.of(scene) for scene in scenes}
    if len(keys) != 1:
        raise ValueError(f"scenes: expected scenes of one family, found {len(keys)} families")
    key = keys.pop()
    eta = np.concatenate([scene.eta for scene in scenes])
    low, high = float(eta.min()), float(eta.max())
    nodes = chebyshev_nodes(low, high)
    extra = held_out(low, high)
    started = time.perf_counter()
    chosen = variant or choose()
    rendered = [*nodes, extra] if np.isfinite(extra) else list(nodes)
    lobes = _render(key, rendered, sampling, chosen)
    seconds = time.perf_counter() - started
    error = _measure(lobes, nodes, extra) if np.isfinite(extra) else {"rms": 0.0, "worst": 0.0}
    return Family(key, nodes, _without_held_out(lobes, len(nodes)), chosen.name, seconds, error)


def _render(key: FamilyKey, etas: list[float], sampling: Sampling, variant: Variant) -> Lobes:
    if not variant.vectorised:
        return stock.render_lobes(
            variant, key.shape, key.camera, key.light, etas, key.alpha, key.body, sampling
        )
    interface, body = bsdfs(variant, etas, key.alpha, key.body)
    return wavefront.stage(variant, key.shape, key.camera).render(
        key.light, interface, body, sampling
    )


def _measure(lobes: Lobes, nodes: NDArray[np.float64], extra: float) -> dict[str, float]:
    """Difference between the interpolated and the rendered image at the held-out index."""
    weights = interpolation_weights(nodes, np.array([extra])).astype(np.float32)
    rms, worst = [0.0], [0.0]
    for halves in (lobes.specular, lobes.body):
        images = halves.mean(axis=0)
        if len(images) != len(nodes) + 1 or images.size == 0:
            continue
        difference = _interpolate(weights, images[:-1])[:, 0] - images[-1]
        peak = max(float(images[-1, :, 0].max()), np.finfo(np.float32).tiny)
        rms.append(float(np.sqrt(np.mean(np.square(difference, dtype=np.float64)))) / peak)
        worst.append(float(np.abs(difference).max()) / peak)
    return {"rms": max(rms), "worst": max(worst)}


def _without_held_out(lobes: Lobes, nodes: int) -> Lobes:
    body = min(lobes.body.shape[1], nodes)
    return Lobes(
        specular=lobes.specular[:, :nodes],
        body=lobes.body[:, :body],
        specular_variance=lobes.specular_variance[:nodes],
        body_variance=lobes.body_variance[:body],
        covariance=lobes.covariance[:nodes],
        pixels=lobes.pixels,
        normals=lobes.normals,
        covered=lobes.covered,
    )
