"""What a camera does to a picture: saturation, noise, a tone curve, eight bits, JPEG.

These act on the picture that the network sees, never on the Stokes vectors that it shall tell.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from malus.bench.learning.arrays import PRECISION, JaxArray

_GAMMA = 2.2
_CODES = 255.0
_BLOCK = 8

_FREQUENCY = np.arange(_BLOCK)
_COSINES = np.cos(np.pi * np.outer(_FREQUENCY, 2 * _FREQUENCY + 1) / (2 * _BLOCK))
_COSINES *= np.sqrt(np.where(_FREQUENCY[:, None] == 0, 1.0, 2.0) / _BLOCK)
"""The cosine transform (8, 8) of a block's rows, orthonormal."""

_STEPS = 1.0 + 1.5 * (_FREQUENCY[:, None] + _FREQUENCY[None, :])
"""Coarseness of each frequency, relative to the lowest, about that of JPEG's own table."""


class Camera(NamedTuple):
    """How one picture is taken; every field is a number.

    `white` is the level that saturates, in means of the picture; `shot` and `read` are the
    noise at the mean and in darkness, in means; `eight_bits` is 0 or 1; `jpeg` the coarseness in
    codes, 0 for none; `tone` the exponent by which an unknown tone curve is misjudged.
    """

    white: JaxArray
    shot: JaxArray
    read: JaxArray
    eight_bits: JaxArray
    jpeg: JaxArray
    tone: JaxArray


def photographed(key: JaxArray, picture: JaxArray, camera: Camera) -> tuple[JaxArray, JaxArray]:
    """A camera's picture (height, width, 3) in linear light, and which values are not saturated.

    Parameters
    ----------
    picture : (height, width, 3) array
        Linear light; sides are multiples of 8.

    Examples
    --------
    >>> ideal = Camera(*map(jnp.array, (2.0, 0.0, 0.0, 0.0, 0.0, 1.0)))
    >>> seen, lit = photographed(jax.random.key(0), jnp.full((8, 8, 3), 3.0), ideal)
    >>> seen.max().item(), lit.any().item()
    (2.0, False)
    """
    lit = picture < camera.white
    deviation = jnp.sqrt(camera.shot**2 * picture + camera.read**2)
    noisy = picture + deviation * jax.random.normal(key, picture.shape)
    level = jnp.clip(noisy / camera.white, 0.0, 1.0)
    codes = _CODES * jnp.maximum(level, 1e-12) ** (1 / _GAMMA)
    codes = jnp.where(camera.jpeg > 0, in_blocks(codes, jnp.maximum(camera.jpeg, 1e-3)), codes)
    decoded = (jnp.clip(jnp.round(codes), 0, _CODES) / _CODES) ** _GAMMA
    level = jnp.where(camera.eight_bits > 0, decoded, level)
    return camera.white * jnp.maximum(level, 1e-12) ** camera.tone, lit


def in_blocks(codes: JaxArray, coarseness: JaxArray) -> JaxArray:
    """Codes (height, width, 3) after the frequencies of 8 × 8 blocks were rounded, as JPEG does.

    Examples
    --------
    >>> flat = jnp.full((8, 8, 3), 100.0)
    >>> bool(abs(in_blocks(flat, jnp.array(2.0)) - 100.0).max() < 1e-3)
    True
    """
    height, width, channels = codes.shape
    blocks = codes.reshape(height // _BLOCK, _BLOCK, width // _BLOCK, _BLOCK, channels)
    waves = _transformed("ui,vj,aibjc->aubvc", blocks)
    steps = coarseness * _STEPS[None, :, None, :, None]
    rounded = jnp.round(waves / steps) * steps
    return _transformed("ui,vj,aubvc->aibjc", rounded).reshape(codes.shape)


def _transformed(axes: str, blocks: JaxArray) -> JaxArray:
    """The cosine transform of rows and columns of blocks, along the axes that are named."""
    return jnp.einsum(axes, _COSINES, _COSINES, blocks, precision=PRECISION)


def random_camera(key: JaxArray) -> Camera:
    """A camera drawn at random; one in five never saturates, and most others have eight bits."""
    white, never, shot, read, bits, jpeg, coarse, tone = jax.random.split(key, 8)
    limit = jnp.where(jax.random.bernoulli(never, 0.2), 200.0, _log_uniform(white, 1.5, 30.0))
    # A picture of eight bits is exposed so that its mean is not dark.
    eight_bits = jax.random.bernoulli(bits, 0.8) & (limit < 15.0)
    return Camera(
        white=limit,
        shot=_log_uniform(shot, 1e-3, 5e-2),
        read=_log_uniform(read, 1e-4, 1e-2),
        eight_bits=eight_bits,
        jpeg=jnp.where(jax.random.bernoulli(jpeg) & eight_bits, _log_uniform(coarse, 0.5, 5), 0.0),
        tone=jnp.exp(0.1 * jax.random.normal(tone)),
    )


def _log_uniform(key: JaxArray, low: float, high: float) -> JaxArray:
    return jnp.exp(jax.random.uniform(key, minval=np.log(low), maxval=np.log(high)))
