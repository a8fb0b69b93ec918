"""Samples until the noise is small enough: independent renders of a family, and their mean.

The rule that stops looks at the difference of two half renders. For Gaussian noise that says
nothing about their sum, so that stopping biases no image; a test measures it over seeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from malus.renderers.lobes import Floats, unit
from malus.renderers.truth import Truth
from malus.scenes.scene import Sampling, Scene

MOST_PASSES = 16
LEAST_SAMPLES = 16
"""Of a pass: fewer would spend their time on starting kernels."""


class Renders(Protocol):
    """What `render_family` returns."""

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        """The truth of one scene."""

    def polarised(self, scene: Scene, angles_deg: tuple[float, ...]) -> Floats:
        """Images (angles, height, width, bands) through a polariser."""


@dataclass(frozen=True)
class Repeated:
    """The mean of independent renders of one family.

    Attributes
    ----------
    passes : renders of equal samples and different seeds
    samples : int
        Samples a pixel of all together.
    """

    passes: tuple[Renders, ...]
    samples: int

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        """The truth of one scene, with the samples that it took."""
        truths = [one.truth(scene, standard_error) for one in self.passes]
        error = _mean([truth.standard_error**2 for truth in truths]) / len(truths)
        return replace(
            truths[0],
            specular=_mean([truth.specular for truth in truths]),
            diffuse=_mean([truth.diffuse for truth in truths]),
            specular_noise=_mean([truth.specular_noise for truth in truths]),
            diffuse_noise=_mean([truth.diffuse_noise for truth in truths]),
            standard_error=np.sqrt(error),
            normals=unit(_mean([truth.normals for truth in truths])),
            mask=np.logical_and.reduce([truth.mask for truth in truths]),
            samples=self.samples,
        )

    def polarised(self, scene: Scene, angles_deg: tuple[float, ...]) -> Floats:
        """Images (angles, height, width, bands) through a polariser, as of a `Family`."""
        return _mean([one.polarised(scene, angles_deg) for one in self.passes])


def _mean(images: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return np.mean(images, axis=0, dtype=images[0].dtype)


def relative_error(renders: Renders, scenes: Iterable[Scene]) -> float:
    """Largest noise of a scene: rms of s1 and s2 over the mask and bands, over the peak of s0.

    Infinity where a scene shows no light or no pixel.
    """
    worst = 0.0
    for scene in scenes:
        truth = renders.truth(scene, standard_error=False)
        noise = (truth.specular_noise + truth.diffuse_noise)[truth.mask][..., 1:]
        peak = float(truth.image[truth.mask].max(initial=0.0))
        if peak <= 0:
            return math.inf
        worst = max(worst, float(np.sqrt(np.mean(np.square(noise, dtype=np.float64)))) / peak)
    return worst


def pass_samples(sampling: Sampling) -> int:
    """Samples a pixel of one pass, even.

    Examples
    --------
    >>> pass_samples(Sampling(samples=1024)), pass_samples(Sampling(samples=64))
    (64, 16)
    """
    return min(sampling.samples, max(LEAST_SAMPLES, sampling.samples // MOST_PASSES // 2 * 2))


def render_until(
    render: Callable[[Sampling], Renders], scenes: Sequence[Scene], sampling: Sampling
) -> Repeated:
    """Add passes until `sampling.target` is met, or its samples are used up.

    How many follows from the noise of the first ones, and so from scenes, seed and variant alone.
    """
    assert sampling.target is not None
    samples = pass_samples(sampling)
    most = sampling.samples // samples
    passes: list[Renders] = []
    wanted = 1
    while len(passes) < wanted:
        for number in range(len(passes), wanted):
            once = {"samples": samples, "seed": _seed(sampling.seed, number), "target": None}
            passes.append(render(sampling.model_copy(update=once)))
        done = Repeated(tuple(passes), samples * len(passes))
        wanted = needed(relative_error(done, scenes), sampling.target, len(passes), most)
    return done


def needed(error: float, target: float, count: int, most: int) -> int:
    """Passes for a target, where `count` of them have an error: noise falls as their root.

    Examples
    --------
    >>> needed(2e-3, 1e-3, 2, 16), needed(9e-4, 1e-3, 2, 16), needed(1.0, 1e-3, 2, 16)
    (8, 2, 16)
    """
    if error <= target:
        return count
    return min(most, max(count + 1, math.ceil(count * min((error / target) ** 2, most))))


def _seed(seed: int, number: int) -> int:
    """Seeds of passes: the first is that of the sampling."""
    if number == 0:
        return seed
    # Small enough for the scalar variant, which makes 16 seeds of one.
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0]) >> 5
