"""Make a new example of a stored one: moved, recoloured, blurred, photographed.

Each step is a small function with a law of its own, in `warp`, `colours` and `camera`; everything
runs on the device, a batch at a time. Each is compiled on its own: compiled as one, the values of a
pixel were computed again for every neighbour that asks for them: 40 ms in place of 27.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from malus.bench.learning.arrays import JaxArray
from malus.bench.learning.camera import photographed, random_camera
from malus.bench.learning.colours import blurred, mixed, random_blur, random_mixture
from malus.bench.learning.warp import moved, random_motion

HIGHLIGHT = 10.0
"""Means of a picture above which a pixel counts no more than one of that brightness."""

WHOLE = 0.75
"""Share of valid pixels above which a picture fills the frame; edges are not valid."""

_DARK = 1e-6
"""Level below which nothing is divided."""


class Batch(NamedTuple):
    """What the network sees and shall tell.

    `picture` (batch, side, side, 3), linear light over its mean; `target` (batch, side, side, 3,
    2), s1/s0 and s2/s0; `weight` (batch, side, side, 3), the light of pixels that count, 0
    elsewhere.
    """

    picture: JaxArray
    target: JaxArray
    weight: JaxArray


def augmented(key: JaxArray, light: JaxArray, mask: JaxArray, turn_deg: float, side: int) -> Batch:
    """A batch of new examples from stored ones.

    Parameters
    ----------
    key : random key
    light : (batch, height, width, 3, 3) array
        Stokes vectors of three channels.
    mask : (batch, height, width) array of bool
    turn_deg : float
        Largest angle by which pictures are turned.
    side : int
        Pixels a side of the new pictures, a multiple of 16.
    """
    movement, company, others = jax.random.split(key, 3)
    light, mask = _moved(movement, light, mask, turn_deg, side)
    light, mask = _in_company(company, light, mask)
    colour, softness, how, noise = jax.random.split(others, 4)
    light = _blurred(softness, _mixed(colour, light))
    return Batch(*_photographed(how, noise, light, mask))


@partial(jax.jit, static_argnums=4)
def _moved(
    key: JaxArray, light: JaxArray, mask: JaxArray, turn_deg: float, side: int
) -> tuple[JaxArray, JaxArray]:
    # Of a picture that fills the frame nobody knows what is around it: it is not made smaller.
    least = jnp.where(_whole(mask), 1.0, 0.5)
    keys = jax.random.split(key, len(mask))
    motions = jax.vmap(random_motion, (0, None, None, 0))(keys, turn_deg, side, least)
    return jax.vmap(moved, (0, 0, 0, None))(light.astype(jnp.float32), mask, motions, side)


@partial(jax.jit)
def _in_company(key: JaxArray, light: JaxArray, mask: JaxArray) -> tuple[JaxArray, JaxArray]:
    """Some objects alone, some before another picture, most as they were rendered."""
    chance, whole = jax.random.uniform(key, (len(mask),)), _whole(mask)
    cut, collage = chance < jnp.where(whole, 0.25, 0.4), ~whole & (chance > 0.6)
    return before_others(without_surroundings(light, mask, cut), mask, collage)


def _whole(mask: JaxArray) -> JaxArray:
    """Which pictures fill their frame."""
    return mask.mean(axis=(1, 2)) > WHOLE


def without_surroundings(light: JaxArray, mask: JaxArray, whether: JaxArray) -> JaxArray:
    """Black off the mask in the pictures that are chosen, as where somebody gives a mask."""
    return jnp.where((mask | ~whether[:, None, None])[..., None, None], light, 0.0)


def before_others(light: JaxArray, mask: JaxArray, whether: JaxArray) -> tuple[JaxArray, JaxArray]:
    """Fill the darkness around objects, in the pictures that are chosen, with another picture.

    Its truth comes with it: light and mask are those of the collage.
    """
    dark = (light[..., 0] <= 0).all(axis=-1)
    behind = whether[:, None, None] & dark & ~mask
    other_light, other_mask = jnp.roll(light, 1, axis=0), jnp.roll(mask, 1, axis=0)
    return jnp.where(behind[..., None, None], other_light, light), mask | (behind & other_mask)


@partial(jax.jit)
def _mixed(key: JaxArray, light: JaxArray) -> JaxArray:
    return jax.vmap(mixed)(light, jax.vmap(random_mixture)(jax.random.split(key, len(light))))


@partial(jax.jit)
def _blurred(key: JaxArray, light: JaxArray) -> JaxArray:
    return jax.vmap(blurred)(light, jax.vmap(random_blur)(jax.random.split(key, len(light))))


@partial(jax.jit)
def _photographed(
    how: JaxArray, noise: JaxArray, light: JaxArray, mask: JaxArray
) -> tuple[JaxArray, JaxArray, JaxArray]:
    """Pictures, targets and weights."""
    light = light / jnp.maximum(_means(light[..., 0], mask), _DARK)[..., None]
    cameras = jax.vmap(random_camera)(jax.random.split(how, len(mask)))
    keys = jax.random.split(noise, len(mask))
    seen, lit = jax.vmap(photographed)(keys, light[..., 0], cameras)
    weight = jnp.where(mask[..., None] & lit, jnp.minimum(light[..., 0], HIGHLIGHT), 0.0)
    return seen / jnp.maximum(_means(seen, mask), _DARK), ratios(light), weight


def ratios(light: JaxArray) -> JaxArray:
    """s1/s0 and s2/s0 (..., 2) of Stokes vectors (..., 3); 0 in darkness.

    Examples
    --------
    >>> ratios(jnp.array([[4.0, 1.0, -2.0], [0.0, 0.0, 0.0]])).tolist()
    [[0.25, -0.5], [0.0, 0.0]]
    """
    s0 = light[..., :1]
    q = jnp.where(s0 > _DARK, light[..., 1:] / jnp.maximum(s0, _DARK), 0.0)
    return jnp.clip(q, -1.0, 1.0)


def _means(pictures: JaxArray, mask: JaxArray) -> JaxArray:
    """Means (count, 1, 1, 1) of pictures (count, height, width, 3) over valid pixels, channels."""
    counts = jnp.maximum(3 * mask.sum(axis=(1, 2)), 1)
    return ((pictures * mask[..., None]).sum(axis=(1, 2, 3)) / counts)[:, None, None, None]
