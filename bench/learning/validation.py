"""How good a network is on the whole pictures of a split."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from malus.bench.learning.arrays import JaxArray, Weights
from malus.bench.learning.examples import Examples
from malus.bench.learning.network import STRIDE, forward
from malus.bench.learning.objective import Sums, sums
from malus.bench.scoring.metrics import skills

_TOGETHER = 32
"""Pictures that are estimated at once."""


class Measured(NamedTuple):
    """Median skill over scenes, share of scenes above 0, and mean squared standardised residual."""

    skill: float
    above_guess: float
    calibration: float


def measured(weights: Weights, examples: Examples, prior: str, mirrored: bool = False) -> Measured:
    """Skill and calibration of a network on examples, as they are.

    Parameters
    ----------
    mirrored : bool
        Of the estimates for each picture and its mirror image take the mean, and of deviations the
        root of the mean square, as method `net` does.

    Returns
    -------
    Measured, NaN where no scene is polarised beyond its noise. Skills are corrected for the noise
    of the truth, but not for how the estimate follows it, which is in the picture too: on the
    suite `photos` they are 0.01 above those of `malus score`.
    """
    parts = [
        _sums(prior, mirrored, weights, *part) for part in _parts(examples.light, examples.mask)
    ]
    found = Sums(*(np.concatenate(one)[: len(examples.mask)] for one in zip(*parts, strict=True)))
    error, guess = found.error - examples.noise, found.guess - examples.noise
    each = skills(error, guess, examples.noise, np.maximum(3 * examples.mask.sum(axis=(1, 2)), 1))
    polarised, visible = np.isfinite(each), found.visible > 0
    if not polarised.any():
        return Measured(float("nan"), float("nan"), float("nan"))
    each = each[polarised]
    squares = found.residual[visible] / found.visible[visible]
    return Measured(float(np.median(each)), float(np.mean(each > 0)), float(np.mean(squares)))


def _parts(*arrays: JaxArray) -> list[list[JaxArray]]:
    """Arrays in parts of one length, the last filled up: a function is compiled for each length."""
    count = len(arrays[0])
    together = min(_TOGETHER, count)
    parts = []
    for first in range(0, count, together):
        chosen = np.minimum(np.arange(first, first + together), count - 1)
        parts.append([array[chosen] for array in arrays])
    return parts


@partial(jax.jit, static_argnums=(0, 1))
def _sums(prior: str, mirrored: bool, weights: Weights, light: JaxArray, mask: JaxArray) -> Sums:
    """Sums of several scenes at once."""
    light = light.astype(jnp.float32)
    ratios, deviations = estimated(weights, light[..., 0], prior, mirrored)
    return Sums(*jax.vmap(sums)(light, mask, ratios, deviations))


def estimated(
    weights: Weights, pictures: JaxArray, prior: str, mirrored: bool = False
) -> tuple[JaxArray, JaxArray]:
    """Ratios (count, height, width, 3, 2) and deviations (count, height, width, 3).

    Parameters
    ----------
    pictures : (count, height, width, 3) array
        Linear light over its mean, of any size.
    """
    height, width = pictures.shape[1:3]
    beyond = [(0, 0), (0, -height % STRIDE), (0, -width % STRIDE), (0, 0)]
    padded = jnp.pad(pictures, beyond, mode="edge")
    ratios, deviations = forward(weights, padded, prior)
    ratios, deviations = ratios[:, :height, :width], deviations[:, :height, :width]
    if mirrored:
        others, other_deviations = estimated(weights, pictures[:, :, ::-1], prior)
        ratios = (ratios + others[:, :, ::-1] * jnp.array([1.0, -1.0])) / 2
        deviations = jnp.sqrt((deviations**2 + other_deviations[:, :, ::-1] ** 2) / 2)
    return ratios, deviations
