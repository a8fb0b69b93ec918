"""How good a network is on the whole pictures of a split."""

from __future__ import annotations

from collections.abc import Iterator
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

MAGNIFICATIONS = (1.0, 4 / 3, 2.0)
"""Sizes at which a trained network sees a picture, over that of its training."""

_TOGETHER = 32
"""Pictures that are estimated at once."""


class Measured(NamedTuple):
    """Median skill over scenes, share of scenes above 0, and mean squared standardised residual."""

    skill: float
    above_guess: float
    calibration: float


def measured(weights: Weights, examples: Examples, prior: str, as_run: bool = False) -> Measured:
    """Skill and calibration of a network on examples, as they are.

    Parameters
    ----------
    as_run : bool
        As method `net` runs a network: the mean of the estimates for each picture and its mirror
        image, at each of `MAGNIFICATIONS`; of deviations the root of the mean square.

    Returns
    -------
    Measured, NaN where no scene is polarised beyond its noise. Skills are corrected for the noise
    of the truth, but not for how the estimate follows it, which is in the picture too: on the
    suite `photos` they are 0.01 above those of `malus score`.
    """
    together = min(_TOGETHER, len(examples.mask))
    devices = jax.devices()
    copies = [jax.device_put(weights, device) for device in devices]
    parts = [
        _sums(prior, as_run, copies[number % len(devices)], *part)
        for number, part in enumerate(_parts(together, examples.light, examples.mask))
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


def _parts(together: int, *arrays: JaxArray) -> Iterator[list[JaxArray]]:
    """Arrays in parts of one length, the last filled up: a function is compiled for each length."""
    count = len(arrays[0])
    for first in range(0, count, together):
        chosen = np.minimum(np.arange(first, first + together), count - 1)
        yield [array[chosen] for array in arrays]


@partial(jax.jit, static_argnums=(0, 1))
def _sums(prior: str, as_run: bool, weights: Weights, light: JaxArray, mask: JaxArray) -> Sums:
    """Sums of several scenes at once."""
    light = light.astype(jnp.float32)
    ratios, deviations = estimated(weights, light[..., 0], prior, as_run)
    return Sums(*jax.vmap(sums)(light, mask, ratios, deviations))


def estimated(
    weights: Weights, pictures: JaxArray, prior: str, as_run: bool = False
) -> tuple[JaxArray, JaxArray]:
    """Ratios (count, height, width, 3, 2) and deviations (count, height, width, 3).

    Parameters
    ----------
    pictures : (count, height, width, 3) array
        Linear light over its mean, of any size.
    as_run : bool
        As method `net` runs a network: see `measured`.
    """
    if not as_run:
        return _answers(weights, pictures, prior)
    count, height, width = pictures.shape[:3]
    ratios, variances = [], []
    for magnification in MAGNIFICATIONS:
        large = (count, round(magnification * height), round(magnification * width), 3)
        seen = jax.image.resize(pictures, large, "linear")
        for step in (1, -1):
            told, deviations = _answers(weights, seen[:, :, ::step], prior)
            told = told[:, :, ::step] * jnp.array([1.0, step])
            ratios.append(jax.image.resize(told, (count, height, width, 3, 2), "linear"))
            deviations = deviations[:, :, ::step]
            back = jax.image.resize(deviations, (count, height, width, 3), "linear")
            variances.append(back**2)
    return sum(ratios) / len(ratios), jnp.sqrt(sum(variances) / len(variances))


def _answers(weights: Weights, pictures: JaxArray, prior: str) -> tuple[JaxArray, JaxArray]:
    """What the network says of pictures, whose sides it needs as multiples of its stride."""
    height, width = pictures.shape[1:3]
    beyond = [(0, 0), (0, -height % STRIDE), (0, -width % STRIDE), (0, 0)]
    ratios, deviations = forward(weights, jnp.pad(pictures, beyond, mode="edge"), prior)
    return ratios[:, :height, :width], deviations[:, :height, :width]
