"""Change the spectrum of light, and blur it, without harm to its polarisation.

Everything here acts on s0, s1 and s2 alike, as filters and lenses do: that keeps (s1, s2)/s0
physical.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from malus.bench.learning.arrays import JaxArray

_REACH = 3
"""Pixels that a blur reaches."""


def mixed(light: JaxArray, weights: JaxArray) -> JaxArray:
    """Light (..., 3, 3) in channels that are mixtures of the old ones; weights (3, 3), at least 0.

    A diagonal of weights is a white balance and leaves (s1, s2)/s0 as it is.

    Examples
    --------
    >>> light = jnp.array([[2.0, 1.0, 0.0], [1.0, 0.0, 0.5], [1.0, 0.0, 0.0]])
    >>> mixed(light, jnp.diag(jnp.array([3.0, 1.0, 1.0])))[0].tolist()
    [6.0, 3.0, 0.0]
    """
    # Spelled out: a product of so small matrices, one a pixel, took five times as long.
    return sum(weights[:, k, None] * light[..., k, None, :] for k in range(3))


def random_mixture(key: JaxArray) -> JaxArray:
    """Weights (3, 3): channels exchanged, mixed and balanced at random, at times all the same."""
    order, kinds, how, how_much, gain, whether, grey = jax.random.split(key, 7)
    exchanged = jnp.where(
        jax.random.bernoulli(order, 0.3),
        jnp.eye(3)[jnp.argsort(jax.random.uniform(kinds, (3,)))],
        jnp.eye(3),
    )
    share = 0.4 * jax.random.uniform(how_much)
    weights = (1 - share) * exchanged + share * _shares(how, (3, 3))
    one = _shares(grey, (3,))
    weights = jnp.where(jax.random.bernoulli(whether, 0.08), one[None, :], weights)
    balance = jnp.exp(0.25 * jax.random.normal(gain, (3, 1)))
    return weights * balance


def _shares(key: JaxArray, shape: tuple[int, ...]) -> JaxArray:
    """Numbers from 0 to 1 whose sum along the last axis is 1."""
    parts = jax.random.exponential(key, shape)
    return parts / parts.sum(axis=-1, keepdims=True)


def blurred(light: JaxArray, sigma: JaxArray) -> JaxArray:
    """Light (height, width, ...) through a Gaussian blur of `sigma` pixels, 0 for none.

    Examples
    --------
    >>> blurred(jnp.ones((4, 4, 1)), jnp.array(1.0)).round(6).min().item()
    1.0
    """
    steps = jnp.arange(-_REACH, _REACH + 1)
    weights = jnp.exp(-0.5 * (steps / jnp.maximum(sigma, 1e-3)) ** 2)
    weights = weights / weights.sum()
    for axis in (0, 1):
        edges = [(0, 0)] * light.ndim
        edges[axis] = (_REACH, _REACH)
        padded = jnp.pad(light, edges, mode="edge")
        length = light.shape[axis]
        light = sum(
            weights[k] * jax.lax.slice_in_dim(padded, k, k + length, axis=axis)
            for k in range(2 * _REACH + 1)
        )
    return light


def random_blur(key: JaxArray) -> JaxArray:
    """Standard deviation of a blur in pixels: none in two thirds of the pictures, else to 1.2."""
    whether, how_much = jax.random.split(key)
    sigma = jax.random.uniform(how_much, minval=0.3, maxval=1.2)
    return jnp.where(jax.random.bernoulli(whether, 0.35), sigma, 0.0)
