"""Turn, mirror, scale and shift pictures of Stokes vectors, as a camera would see them then.

Stokes vectors turn with the picture: by φ anticlockwise, (s1, s2) turn by 2φ; a mirror from left
to right changes the sign of s2. Under a perspective camera the frame of a pixel far from the centre
is turned a little against the image's (`scenes.polarisation.viewing_frame`), which is left out
here. Mirrored pictures are right even so; turned by 20°, the most by default, AoLP is wrong by at
most 1.3° in a field of 40° and 3.2° in one of 60°, turned by a right angle by 6.7° and 14.5°.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from malus.bench.learning.arrays import JaxArray


class Motion(NamedTuple):
    """How one picture moves: mirrored first, then turned, scaled and shifted.

    `mirror` is -1 or 1, `turn` in radians anticlockwise, `zoom` the magnification, `shift` (2,) in
    pixels to the right and up.
    """

    mirror: JaxArray
    turn: JaxArray
    zoom: JaxArray
    shift: JaxArray


def with_picture(stokes: JaxArray, motion: Motion) -> JaxArray:
    """Stokes vectors (..., 3) after their picture was mirrored and turned.

    Examples
    --------
    Light polarised along +x, in a picture turned by a right angle, is polarised along y:

    >>> motion = Motion(jnp.array(1.0), jnp.array(jnp.pi / 2), jnp.array(1.0), jnp.zeros(2))
    >>> with_picture(jnp.array([2.0, 1.0, 0.0]), motion).round(6).tolist()
    [2.0, -1.0, -0.0]
    """
    s0, s1, s2 = stokes[..., 0], stokes[..., 1], motion.mirror * stokes[..., 2]
    cosine, sine = jnp.cos(2 * motion.turn), jnp.sin(2 * motion.turn)
    return jnp.stack([s0, cosine * s1 - sine * s2, sine * s1 + cosine * s2], axis=-1)


def moved(light: JaxArray, mask: JaxArray, motion: Motion, side: int) -> tuple[JaxArray, JaxArray]:
    """A square of `side` pixels of a moved picture: light (side, side, 3, 3), valid (side, side).

    Beyond the picture's edge its light goes on as at the edge, and no pixel is valid.

    Parameters
    ----------
    light : (height, width, 3, 3) array
        Stokes vectors of three channels.
    mask : (height, width) array of bool
    """
    height, width = mask.shape
    rows, columns = _origins((height, width), motion, side)
    planes = jnp.concatenate([light.reshape(height, width, 9), mask[..., None]], axis=-1)
    sampled = bilinear(planes, rows, columns)
    inside = (rows >= 0) & (rows <= height - 1) & (columns >= 0) & (columns <= width - 1)
    stokes = with_picture(sampled[..., :9].reshape(side, side, 3, 3), motion)
    return stokes, inside & (sampled[..., 9] > 0.999)  # all four neighbours, but for rounding


def _origins(shape: tuple[int, int], motion: Motion, side: int) -> tuple[JaxArray, JaxArray]:
    """Rows and columns (side, side) of the old picture where the new one's pixels come from."""
    steps = jnp.arange(side) - (side - 1) / 2
    x = (steps[None, :] - motion.shift[0]) / motion.zoom
    y = (-steps[:, None] - motion.shift[1]) / motion.zoom  # rows count downwards, y upwards
    cosine, sine = jnp.cos(motion.turn), jnp.sin(motion.turn)
    old_x = motion.mirror * (cosine * x + sine * y)
    old_y = cosine * y - sine * x
    return (shape[0] - 1) / 2 - old_y, old_x + (shape[1] - 1) / 2


def bilinear(planes: JaxArray, rows: JaxArray, columns: JaxArray) -> JaxArray:
    """Values (..., channels) between the pixels of planes (height, width, channels).

    Positions beyond the edge have the values at the edge.

    Examples
    --------
    >>> planes = jnp.array([[[0.0], [4.0]]])
    >>> bilinear(planes, jnp.array([0.0, 0.0]), jnp.array([0.25, 9.0])).tolist()
    [[1.0], [4.0]]
    """
    height, width = planes.shape[:2]
    rows, columns = jnp.clip(rows, 0, height - 1), jnp.clip(columns, 0, width - 1)
    top = jnp.clip(jnp.floor(rows).astype(int), 0, max(height - 2, 0))
    left = jnp.clip(jnp.floor(columns).astype(int), 0, max(width - 2, 0))
    below, right = jnp.minimum(top + 1, height - 1), jnp.minimum(left + 1, width - 1)
    down, across = (rows - top)[..., None], (columns - left)[..., None]
    upper = planes[top, left] * (1 - across) + planes[top, right] * across
    lower = planes[below, left] * (1 - across) + planes[below, right] * across
    return upper * (1 - down) + lower * down


def random_motion(key: JaxArray, turn_deg: float, side: int, least: JaxArray) -> Motion:
    """A motion drawn at random: turned by at most `turn_deg`, scaled by `least` to 2, shifted."""
    mirror, turn, zoom, shift = jax.random.split(key, 4)
    limit = jnp.deg2rad(turn_deg)
    scale = 2.0 ** jax.random.uniform(zoom, minval=jnp.log2(least), maxval=1.0)
    return Motion(
        mirror=jnp.where(jax.random.bernoulli(mirror), 1.0, -1.0),
        turn=jax.random.uniform(turn, minval=-limit, maxval=limit),
        zoom=scale,
        # A magnified picture may move further: its parts come to lie in the middle.
        shift=side * (0.1 + 0.25 * jnp.maximum(scale - 1, 0)) * _in_square(shift),
    )


def _in_square(key: JaxArray) -> JaxArray:
    return jax.random.uniform(key, (2,), minval=-1.0, maxval=1.0)
