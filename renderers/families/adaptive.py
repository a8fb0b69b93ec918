"""Render a family until its noise is below a target: independent renders, and their mean.

The stopping rule uses the difference of two half renders. For Gaussian noise that is independent of
their sum, so that stopping does not bias the image; a test measures it over seeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from malus.renderers.mitsuba.lobe_samples import spread_of, unit
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import AnyArray
from malus.scenes.scene import Sampling, Scene

FIRST_PART = 16
"""The first render takes this fraction, a sixteenth, of the most samples."""
LEAST_SAMPLES = 16
"""Least samples of the first render: fewer would spend their time on starting kernels."""


class Renders(Protocol):
    """The truths of one family, as `render_family` returns them."""

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        """The truth of one scene."""


@dataclass(frozen=True)
class RepeatedRenders:
    """The mean of independent renders of one family.

    Attributes
    ----------
    passes : renders with different seeds
    counts : tuple of int
        Samples a pixel of each pass.
    """

    passes: tuple[Renders, ...]
    counts: tuple[int, ...]

    @property
    def samples(self) -> int:
        """Samples a pixel of all passes together."""
        return sum(self.counts)

    def truth(self, scene: Scene, standard_error: bool = True) -> Truth:
        """The mean truth of one scene, with the number of samples taken."""
        truths = [renders.truth(scene, standard_error) for renders in self.passes]
        weights = [count / self.samples for count in self.counts]
        variance = [
            (weight * truth.standard_error) ** 2
            for weight, truth in zip(weights, truths, strict=True)
        ]

        def mean(name: str) -> AnyArray:
            return self._mean([getattr(truth, name) for truth in truths])

        averaged = replace(
            truths[0],
            specular=mean("specular"),
            diffuse=mean("diffuse"),
            specular_noise=mean("specular_noise"),
            diffuse_noise=mean("diffuse_noise"),
            standard_error=np.sqrt(np.sum(variance, axis=0, dtype=variance[0].dtype)),
            normals=unit(mean("normals")),
            normal_spread=spread_of(self._mean([_mean_normals(truth) for truth in truths])),
            mask=np.logical_and.reduce([truth.mask for truth in truths]),
            samples=self.samples,
        )
        if truths[0].s3 is None:
            return averaged
        errors = [np.asarray(truth.s3_standard_error) for truth in truths]
        squares = [(weight * error) ** 2 for weight, error in zip(weights, errors, strict=True)]
        return replace(
            averaged,
            s3=mean("s3"),
            s3_noise=mean("s3_noise"),
            s3_standard_error=np.sqrt(np.sum(squares, axis=0, dtype=errors[0].dtype)),
        )

    def _mean(self, images: Sequence[AnyArray]) -> AnyArray:
        """Mean of the passes' images weighted by their samples, in the images' type."""
        mean = np.average(images, axis=0, weights=self.counts)
        return np.asarray(mean, dtype=images[0].dtype)


def _mean_normals(truth: Truth) -> AnyArray:
    """Mean vectors (height, width, 3) of the unit normals in each pixel."""
    assert truth.normal_spread is not None
    return truth.normals * np.cos(np.radians(truth.normal_spread))[..., None]


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


def first_samples(sampling: Sampling) -> int:
    """Samples a pixel of the first render, even.

    Examples
    --------
    >>> first_samples(Sampling(samples=1024)), first_samples(Sampling(samples=64))
    (64, 16)
    """
    return min(sampling.samples, max(LEAST_SAMPLES, sampling.samples // FIRST_PART // 2 * 2))


def render_until(
    render: Callable[[Sampling], Renders], scenes: Sequence[Scene], sampling: Sampling
) -> RepeatedRenders:
    """Render few samples, then as many more as their noise requires, until the target is met.

    Their number depends on scenes, seed and variant alone, and is at most `sampling.samples`.
    """
    assert sampling.target is not None
    passes: list[Renders] = []
    counts: list[int] = []
    wanted = first_samples(sampling)
    while wanted > sum(counts):
        counts.append(wanted - sum(counts))
        one_pass = {
            "samples": counts[-1],
            "seed": _seed_of_pass(sampling.seed, len(passes)),
            "target": None,
        }
        passes.append(render(sampling.model_copy(update=one_pass)))
        renders = RepeatedRenders(tuple(passes), tuple(counts))
        error = relative_error(renders, scenes)
        wanted = needed(error, sampling.target, renders.samples, sampling.samples)
    return renders


def needed(error: float, target: float, samples: int, most: int) -> int:
    """Even number of samples for a target error, if `samples` have `error`, which falls as 1/√n.

    Examples
    --------
    >>> needed(2e-3, 1e-3, 32, 512), needed(9e-4, 1e-3, 32, 512), needed(1.0, 1e-3, 32, 512)
    (128, 32, 512)
    """
    if error <= target:
        return samples
    enough = samples * min((error / target) ** 2, most)
    # At least a tenth more, lest the last few come in many small renders.
    return min(most, 2 * math.ceil(max(enough, 1.1 * samples) / 2))


def _seed_of_pass(seed: int, number: int) -> int:
    """Seed of each pass: the first has that of the sampling."""
    if number == 0:
        return seed
    # Within the range of `Sampling.seed`.
    return int(np.random.SeedSequence([seed, number]).generate_state(1)[0]) >> 5
