"""Interpolation in the refractive index η, of which a render is a smooth function.

With the seed fixed, Monte Carlo noise is the same smooth function of η as the image itself, so
that a polynomial through a few Chebyshev nodes gives the image at any η between them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from malus.scenes.core.arrays import Float64Array, NumberArray
from malus.scenes.materials.measured import Measured
from malus.scenes.scene import Scene

TARGET_ERROR = 2e-6
"""Wanted rms interpolation error over the image's peak: a fifth of the documented 1e-5."""


def node_count(low: float, high: float) -> int:
    """Number of Chebyshev nodes for indices in [low, high], both above 1.

    The error model is geometric in the count and a power in the width of the interval; its two
    constants were measured on spheres of η in [1.32, 1.66] (3 nodes 2e-4, each node more divides
    by 8.2). Where it asks for more than a function needs that is analytic but at η = 1, as in
    intervals that come near it, that bound counts: each node divides the error by the sum of the
    half axes of the ellipse around the interval through η = 1 (Trefethen, Approximation Theory and
    Approximation Practice, Theorem 8.2). Every family measures its own error afterwards
    (`Family.interpolation_error`).

    Examples
    --------
    >>> node_count(1.5, 1.5), node_count(1.33, 1.70)
    (1, 6)
    """
    if high <= low:
        return 1
    # The distance from the branch point η = 1 sets the scale on which F(η) bends.
    width = (high - low) / (low - 1.0)
    middle = 1.0 + 2.0 / width  # of the interval, over half of it, from η = 1
    axes = math.log(middle + math.sqrt(middle**2 - 1.0))
    most = math.ceil(-math.log(TARGET_ERROR) / max(axes, 1e-6))
    divisor = math.log(8.2 * 1.06 / width)
    if divisor <= 0:
        return most
    return max(2, min(most, math.ceil(math.log(2e-4 * 8.2**3 / TARGET_ERROR) / divisor)))


def chebyshev_nodes(low: float, high: float, count: int) -> Float64Array:
    """Chebyshev nodes of the first kind on [low, high]."""
    if count == 1:
        return np.array([0.5 * (low + high)])
    angle = np.pi * (np.arange(count) + 0.5) / count
    return 0.5 * (low + high) - 0.5 * (high - low) * np.cos(angle)


@dataclass(frozen=True)
class Nodes:
    """The refractive indices at which a family is rendered.

    Attributes
    ----------
    values : (K,)
        Chebyshev nodes, or all wanted indices where those are few or complex.
    held_out : float or None
        The end of the interval next to η = 1, where the error is largest, rendered too in order to
        measure that error. None where nothing is interpolated.

    Examples
    --------
    >>> Nodes.of(np.array([1.5, 1.4, 1.5])).rendered
    (1.4, 1.5)
    >>> len(Nodes.of(np.linspace(1.33, 1.7, 192)).rendered)
    7
    """

    values: NumberArray
    held_out: float | None = None

    @classmethod
    def of(cls, eta: NumberArray, count: int | None = None) -> Self:
        """Nodes for wanted indices (N,); `count` fixes the number of Chebyshev nodes."""
        wanted = np.unique(eta)
        if np.iscomplexobj(wanted) or len(wanted) == 1:
            return cls(wanted)
        low, high = float(wanted[0]), float(wanted[-1])
        if count is None:
            count = node_count(low, high)
            if len(wanted) <= count + 1:
                return cls(wanted)
        return cls(chebyshev_nodes(low, high, count), low)

    @property
    def is_interpolated(self) -> bool:
        """Whether images at other indices are interpolated between those of the nodes."""
        return self.held_out is not None

    @property
    def rendered(self) -> tuple[float | complex, ...]:
        """All rendered indices, the held-out one last."""
        held_out = () if self.held_out is None else (self.held_out,)
        return (*self.values.tolist(), *held_out)

    @property
    def kept(self) -> slice:
        """Numbers of the renders that are nodes, not held out."""
        return slice(0, len(self.values))

    def checks(self) -> Iterator[tuple[slice, Float64Array, int]]:
        """The nodes, weights (1, K) to the held-out index, and that render's number, if any."""
        if self.held_out is not None:
            yield self.kept, self.weights(np.array([self.held_out])), self.kept.stop

    def weights(self, eta: NumberArray) -> Float64Array:
        """Weights (len(eta), K) that interpolate from the nodes' images to those at `eta`.

        Raises
        ------
        ValueError
            For an index outside those that the nodes were chosen for.
        """
        if self.held_out is None:
            weights: Float64Array = (eta[:, None] == self.values).astype(np.float64)
            inside = bool(weights.any(axis=1).all())
        else:
            edge = self._edge
            inside = eta.min() >= self.values[0] - edge and eta.max() <= self.values[-1] + edge
            weights = interpolation_weights(self.values.real, eta.real)
        if not inside:
            raise ValueError(f"eta: expected a value among this family's indices, found {eta}")
        return weights

    @property
    def _edge(self) -> float:
        """Distance by which the interval reaches beyond the outermost nodes."""
        assert self.held_out is not None
        return float(self.values[0] - self.held_out) * (1 + 1e-9) + 1e-12

    def of_scene(self, scene: Scene) -> tuple[Float64Array, Float64Array]:
        """Weights (bands, K) for the bands of a scene, and factors (bands,) of its diffuse lobe.

        Raises
        ------
        ValueError
            As `weights`.
        """
        return self.weights(node_coordinates(scene)), scene.surface.albedos(scene.wavelengths_nm)


def node_coordinates(scene: Scene) -> NumberArray:
    """The coordinate (bands,) of each band on the axis of the nodes: its refractive index.

    Nothing is interpolated for a measured material, whose nodes are the bands themselves, in nm.
    """
    if isinstance(scene.surface, Measured):
        return np.array(scene.wavelengths_nm)
    return scene.eta


def family_nodes(scenes: Iterable[Scene], count: int | None = None) -> Nodes:
    """The nodes at which scenes of one family are rendered; `count` as for `Nodes.of`."""
    scenes = list(scenes)
    wanted = np.concatenate([node_coordinates(scene) for scene in scenes])
    if isinstance(scenes[0].surface, Measured):
        return Nodes(np.unique(wanted))
    return Nodes.of(wanted, count)


@dataclass(frozen=True)
class NodesByAlbedo:
    """Nodes in the refractive index for every albedo of a family, one albedo after the other.

    Attributes
    ----------
    albedos : (albedos,)
    nodes : Nodes, one an albedo
    """

    albedos: tuple[float, ...]
    nodes: tuple[Nodes, ...]

    @property
    def rendered(self) -> list[tuple[float | complex, float]]:
        """All rendered pairs of index and albedo; those of an albedo end with the held-out one."""
        pairs = zip(self.albedos, self.nodes, strict=True)
        return [(eta, albedo) for albedo, nodes in pairs for eta in nodes.rendered]

    @property
    def kept(self) -> list[int]:
        """Numbers of the renders that are nodes, not held out."""
        return [number for own, _ in self._blocks for number in range(own.start, own.stop)]

    @property
    def _blocks(self) -> list[tuple[slice, Nodes]]:
        """For every albedo the numbers of the renders that are its nodes, and these nodes."""
        ends = np.cumsum([len(nodes.rendered) for nodes in self.nodes]).tolist()
        starts = [0, *ends[:-1]]
        return [
            (slice(start, start + len(nodes.values)), nodes)
            for start, nodes in zip(starts, self.nodes, strict=True)
        ]

    def checks(self) -> Iterator[tuple[slice, Float64Array, int]]:
        """Nodes of an albedo, weights (1, K) to its held-out index, and that render's number."""
        for own, nodes in self._blocks:
            if nodes.held_out is not None:
                yield own, nodes.weights(np.array([nodes.held_out])), own.stop

    def of_scene(self, scene: Scene) -> tuple[Float64Array, Float64Array]:
        """As `Nodes.of_scene`; factors are 1, because the renders have the albedo already.

        Raises
        ------
        ValueError
            For an index or albedo that the nodes were not chosen for.
        """
        albedos = scene.surface.albedos(scene.wavelengths_nm)
        columns = []
        for albedo, nodes in zip(self.albedos, self.nodes, strict=True):
            block = np.zeros((len(albedos), len(nodes.values)))
            here = albedos == albedo
            if here.any():
                block[here] = nodes.weights(scene.eta[here])
            columns.append(block)
        if not np.isin(albedos, self.albedos).all():
            raise ValueError(f"albedo: expected one of this family's, found {albedos}")
        return np.concatenate(columns, axis=1), np.ones(len(albedos))


def nodes_by_albedo(scenes: Iterable[Scene], count: int | None = None) -> NodesByAlbedo:
    """The nodes at which scenes of one family are rendered along paths; `count` as for `Nodes.of`.

    Examples
    --------
    >>> from malus.scenes import Dielectric, Torus, Uniform
    >>> paint = Dielectric(eta=1.5, alpha=0.3, albedo="red")
    >>> ring = Scene(shape=Torus(), surface=paint, light=Uniform(), wavelengths_nm=(450.0, 650.0))
    >>> nodes_by_albedo([ring]).rendered
    [(1.5, 0.047), (1.5, 0.675)]
    """
    scenes = list(scenes)
    eta = np.concatenate([scene.eta for scene in scenes])
    albedo = np.concatenate([scene.surface.albedos(scene.wavelengths_nm) for scene in scenes])
    values = np.unique(albedo)
    nodes = tuple(Nodes.of(eta[albedo == value], count) for value in values)
    return NodesByAlbedo(tuple(values.tolist()), nodes)


def interpolation_weights(nodes: Float64Array, eta: Float64Array) -> Float64Array:
    """Lagrange weights, shape (len(eta), len(nodes)), in barycentric form.

    Source: Berrut and Trefethen, "Barycentric Lagrange Interpolation", SIAM Review 46 (2004).

    Examples
    --------
    >>> nodes = chebyshev_nodes(1.3, 1.7, 5)
    >>> bool(np.allclose(interpolation_weights(nodes, np.array([1.5])) @ nodes, 1.5, atol=1e-13))
    True
    """
    differences = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(differences, 1.0)
    barycentric = 1.0 / differences.prod(axis=1)
    distance = eta[:, None] - nodes[None, :]
    exact = distance == 0.0
    terms = barycentric / np.where(exact, 1.0, distance)
    weights = terms / terms.sum(axis=1, keepdims=True)
    at_node = exact.any(axis=1)
    weights[at_node] = exact[at_node]
    return weights
