"""Make a new example of a stored one: moved, recoloured, blurred, photographed.

Each step is a small function with a law of its own, in `warp`, `colours` and `camera`; everything
runs on the device, a batch at a time.
"""

from __future__ import annotations

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
    movement, seen, others = jax.random.split(key, 3)
    count = light.shape[0]
    whole = mask.mean(axis=(1, 2)) > WHOLE
    # Of a picture that fills the frame nobody knows what is around it: it is not made smaller.
    least = jnp.where(whole, 1.0, 0.5)
    motions = jax.vmap(random_motion, (0, None, None, 0))(
        jax.random.split(movement, count), turn_deg, side, least
    )
    light, mask = jax.vmap(moved, (0, 0, 0, None))(light.astype(jnp.float32), mask, motions, side)
    chance = jax.random.uniform(seen, (count,))
    cut, collage = chance < jnp.where(whole, 0.25, 0.4), ~whole & (chance > 0.6)
    light, mask = before_others(without_surroundings(light, mask, cut), mask, collage)
    return Batch(*jax.vmap(_one)(jax.random.split(others, count), light, mask))


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


def _one(key: JaxArray, light: JaxArray, mask: JaxArray) -> tuple[JaxArray, JaxArray, JaxArray]:
    """Picture, target and weight of one example."""
    colour, softness, how, noise = jax.random.split(key, 4)
    light = blurred(mixed(light, random_mixture(colour)), random_blur(softness))
    shown = light[..., 0]
    light = light / jnp.maximum(_mean(shown, mask), _DARK)
    seen, lit = photographed(noise, light[..., 0], random_camera(how))
    target = ratios(light)
    weight = jnp.where(mask[..., None] & lit, jnp.minimum(light[..., 0], HIGHLIGHT), 0.0)
    return seen / jnp.maximum(_mean(seen, mask), _DARK), target, weight


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


def _mean(picture: JaxArray, mask: JaxArray) -> JaxArray:
    """Mean of a picture (height, width, 3) over its valid pixels and channels."""
    return (picture * mask[..., None]).sum() / jnp.maximum(3 * mask.sum(), 1)
