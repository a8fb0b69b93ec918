"""What the training makes small, and the skill and calibration that validation measures.

malus' skill is nearly 1 - Σ s0² |q - q̂|² / Σ s0² |q|² with q = (s1, s2)/s0: the mean over the
five polariser angles weighs s1, s2 and their product a little differently. Validation does so, too.
The training weighs by s0 in place of its square, of which one pixel of a hundred holds more than
half where lamps are mirrored: so more pixels have a say, and skill grows in fewer steps.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from malus.bench.learning.arrays import PRECISION, JaxArray
from malus.bench.learning.augment import Batch
from malus.scenes.polarisation import angle_weights

FLOOR = 1e-3
"""Squared degree of polarisation that every picture is taken to have at least."""

DEVIATION_SHARE = 0.05
"""Weight of the likelihood that trains the deviations, beside the error of the ratios."""

_VISIBLE = 1e-3
"""Squared light, in means of the picture, above which a pixel trains and tests deviations."""


def loss(ratios: JaxArray, deviations: JaxArray, batch: Batch) -> JaxArray:
    """Mean over pictures of the error over the picture's own polarisation, plus the likelihood.

    Parameters
    ----------
    ratios, deviations : arrays (batch, height, width, 3, 2) and (batch, height, width, 3)
    batch : Batch
    """
    squared = ((ratios - batch.target) ** 2).sum(axis=-1)
    own = (batch.target**2).sum(axis=-1)
    axes = (1, 2, 3)
    power = (batch.weight * (own + FLOOR)).sum(axes)
    error = (batch.weight * squared).sum(axes) / jnp.maximum(power, 1e-9)
    # A picture that is hardly polarised is not the most important one.
    mean = jnp.minimum(error, 4.0).mean()
    return mean + DEVIATION_SHARE * _likelihood(squared, deviations, batch.weight)


def _likelihood(squared: JaxArray, deviations: JaxArray, weight: JaxArray) -> JaxArray:
    """Negative logarithm of the Gaussian density of two components, a pixel; trains no ratios."""
    residual = jax.lax.stop_gradient(squared)
    density = 0.5 * residual / deviations**2 + 2 * jnp.log(deviations)
    visible = weight**2 > _VISIBLE
    return (visible * density).sum() / jnp.maximum(visible.sum(), 1)


class Sums(NamedTuple):
    """Sums over one scene, of which `skill` and `calibration` are made.

    `error` and `guess`: squared errors of the estimate and of unpolarised light over the paper's
    five angles, times a common factor. `residual` and `visible`: squared standardised residuals,
    and the number of them.
    """

    error: JaxArray
    guess: JaxArray
    residual: JaxArray
    visible: JaxArray


def sums(light: JaxArray, mask: JaxArray, ratios: JaxArray, deviations: JaxArray) -> Sums:
    """Sums over one scene; skill is 1 - error/guess, once noise is taken from both.

    Parameters
    ----------
    light : (height, width, 3, 3) array
        True Stokes vectors over the mean of s0.
    mask : (height, width) array of bool
    ratios, deviations : arrays (height, width, 3, 2) and (height, width, 3)
        Estimates of s1/s0 and s2/s0, and their standard deviations.

    Examples
    --------
    >>> light = jnp.ones((2, 2, 3, 3)) * jnp.array([1.0, 0.3, 0.1])
    >>> found = sums(light, jnp.ones((2, 2), bool), jnp.zeros((2, 2, 3, 2)), jnp.ones((2, 2, 3)))
    >>> float(found.error) == float(found.guess) > 0
    True
    """
    s0, polarised = light[..., :1], light[..., 1:]
    matrix = jnp.asarray(angle_weights()[1:, 1:], jnp.float32)  # that of s0 is known

    def power(stokes: JaxArray) -> JaxArray:
        squares = jnp.einsum("...i,ij,...j->...", stokes, matrix, stokes, precision=PRECISION)
        return (squares.sum(axis=-1) * mask).sum()

    visible = mask[..., None] & (s0[..., 0] ** 2 > _VISIBLE)
    residuals = (polarised / jnp.maximum(s0, _VISIBLE) - ratios) / deviations[..., None]
    squared = jnp.where(visible[..., None], residuals**2, 0.0)
    return Sums(power(ratios * s0 - polarised), power(polarised), squared.sum(), 2 * visible.sum())
