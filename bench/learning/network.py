"""The network: a small U-Net from a picture in linear light to polarisation and its uncertainty.

It has no normalisation layers, so that what it says of a pixel depends on nothing farther away than
`radius` and not on the picture's size or on its batch: large pictures may be cut into tiles.

Its first level has half the picture's resolution: the values of 2 × 2 pixels are its inputs, side
by side, and its last convolution answers for the four at once. Nothing of the picture is lost by
that, and convolutions at full resolution, which had half of the work and a hundredth of the
weights, are none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from malus.bench.learning.arrays import PRECISION, JaxArray, Weights

STRIDE = 16
"""Sides of pictures are multiples of this."""

FOLD = 2
"""Side of the square of pixels that are one place of the network's first level."""

SLOPE = 0.1
"""Slope of the activation for negative values."""

DIM = 0.02
"""Added to brightness before the logarithm: what is darker is noise."""

MOST = 0.999999
"""Bound of √(s1² + s2²)/s0, so that rounding does not pass 1."""

LEAST_DEVIATION = 1e-3
"""Smallest standard deviation that is told."""

_GROWTH = (1.0, 2.0, 3.5, 5.0)
"""Channels of the four levels over those of the first."""

_DEEPEST = len(_GROWTH) - 1
_OUTPUTS = 9
"""Two ratios and a deviation for each of three channels."""


class Layer(NamedTuple):
    """One convolution: its name, channels in and out, side of the kernel, step, initial gain."""

    name: str
    inputs: int
    outputs: int
    kernel: int
    step: int
    gain: float


class Architecture(NamedTuple):
    """What tells one network from another: channels of its first level, and the prior's inputs."""

    width: int
    prior: str

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels of the four levels."""
        return tuple(4 * math.ceil(self.width * growth / 4) for growth in _GROWTH)

    @property
    def inputs(self) -> int:
        """Channels that are made of a picture, a pixel."""
        return 6 if self.prior == "none" else 8


def layers(architecture: Architecture) -> Iterator[Layer]:
    """The convolutions of a network, in the order in which they act."""
    channels = architecture.channels
    yield Layer("stem", FOLD**2 * architecture.inputs, channels[0], 3, 1, 1.0)
    for level in range(1, len(channels)):
        yield Layer(f"down{level}", channels[level - 1], channels[level], 3, 2, 1.0)
        for number in range(_blocks(level)):
            yield from _block(f"down{level}_{number}", channels[level])
    for level in reversed(range(_DEEPEST)):
        yield Layer(f"up{level}", channels[level + 1], channels[level], 1, 1, 1.0)
        yield from _block(f"up{level}_0", channels[level])
    # Begins with the guess: unpolarised.
    yield Layer("head", channels[0], FOLD**2 * _OUTPUTS, 1, 1, 0.0)


def _blocks(level: int) -> int:
    return 2 if level == _DEEPEST else 1


def _block(name: str, channels: int) -> Iterator[Layer]:
    """A residual block; it begins as the identity, nearly."""
    yield Layer(f"{name}a", channels, channels, 3, 1, 1.0)
    yield Layer(f"{name}b", channels, channels, 3, 1, 0.2)


def initial_weights(seed: int, architecture: Architecture) -> Weights:
    """Random weights: kernels (side, side, inputs, outputs) and biases (outputs,) by layer.

    Examples
    --------
    >>> weights = initial_weights(0, Architecture(width=32, prior="none"))
    >>> round(sum(w.size for w in weights.values()) / 1e6, 1)
    1.8
    """
    weights, random = {}, np.random.default_rng(seed)
    for layer in layers(architecture):
        shape = (layer.kernel, layer.kernel, layer.inputs, layer.outputs)
        # He's initial weights, for activations that lose half of the variance.
        deviation = layer.gain * math.sqrt(2 / (layer.kernel**2 * layer.inputs))
        kernel = deviation * random.normal(size=shape)
        weights[f"{layer.name}.kernel"] = kernel.astype(np.float32)
        weights[f"{layer.name}.bias"] = np.zeros(layer.outputs, np.float32)
    return weights


def radius(architecture: Architecture) -> int:
    """Pixels beyond which nothing has an influence on what the network says of a pixel.

    Examples
    --------
    >>> radius(Architecture(width=32, prior="none"))
    147
    """
    reach, scale = FOLD - 1, FOLD
    for layer in layers(architecture):
        if layer.name.startswith("up") and layer.kernel == 1:
            scale //= 2
            reach += scale  # the pixel of the coarser level may lie beside
        reach += scale * (layer.kernel // 2)
        scale *= layer.step
    return reach


def operations(architecture: Architecture) -> float:
    """Multiply-adds a pixel.

    Examples
    --------
    >>> operations(Architecture(width=32, prior="none")) < 30e3
    True
    """
    total, scale = 0.0, FOLD
    for layer in layers(architecture):
        if layer.name.startswith("up") and layer.kernel == 1:
            total += layer.inputs * layer.outputs / scale**2  # before it is enlarged
            scale //= 2
            continue
        scale *= layer.step
        total += layer.kernel**2 * layer.inputs * layer.outputs / scale**2
    return total


def features(picture: JaxArray, prior: str) -> JaxArray:
    """Inputs (..., height, width, channels) of the network from linear light over its mean.

    Brightness on a logarithmic scale, and the share of each channel; of the prior `lobes` also the
    smallest and the largest share, by which mirrored light is told from a body's colour.
    """
    bright = jnp.log(jnp.maximum(picture, 0.0) + DIM)
    lifted = jnp.maximum(picture, 0.0) + DIM / 3
    shares = 3 * lifted / lifted.sum(axis=-1, keepdims=True) - 1
    parts = [bright, shares]
    if prior == "lobes":
        parts += [shares.min(axis=-1, keepdims=True), shares.max(axis=-1, keepdims=True)]
    return jnp.concatenate(parts, axis=-1)


def folded(values: JaxArray) -> JaxArray:
    """Values (batch, height, width, channels) of squares of pixels as the channels of one place.

    Examples
    --------
    >>> folded(jnp.arange(4.0).reshape(1, 2, 2, 1)).tolist()
    [[[[0.0, 1.0, 2.0, 3.0]]]]
    """
    batch, height, width, channels = values.shape
    squares = values.reshape(batch, height // FOLD, FOLD, width // FOLD, FOLD, channels)
    shape = (batch, height // FOLD, width // FOLD, FOLD**2 * channels)
    return squares.transpose(0, 1, 3, 2, 4, 5).reshape(shape)


def unfolded(values: JaxArray) -> JaxArray:
    """The inverse of `folded`.

    Examples
    --------
    >>> values = jnp.arange(96.0).reshape(1, 4, 2, 12)
    >>> bool((folded(unfolded(values)) == values).all())
    True
    """
    batch, height, width, channels = values.shape
    squares = values.reshape(batch, height, width, FOLD, FOLD, channels // FOLD**2)
    shape = (batch, FOLD * height, FOLD * width, channels // FOLD**2)
    return squares.transpose(0, 1, 3, 2, 4, 5).reshape(shape)


def forward(
    weights: Weights, picture: JaxArray, prior: str, dtype: Any = jnp.float32
) -> tuple[JaxArray, JaxArray]:
    """What the network says: ratios (batch, height, width, 3, 2) and deviations (…, 3).

    Parameters
    ----------
    weights : dict of arrays, see `initial_weights`
    picture : (batch, height, width, 3) array
        Linear light over its mean; sides are multiples of `STRIDE`.
    dtype : type of the arithmetic inside
    """
    net = _Convolutions({name: jnp.asarray(w, dtype) for name, w in weights.items()})
    values = net("stem", folded(features(picture, prior)).astype(dtype))
    levels = [values]
    for level in range(1, _DEEPEST + 1):
        values = net(f"down{level}", values, step=2)
        for number in range(_blocks(level)):
            values = net.block(f"down{level}_{number}", values)
        levels.append(values)
    for level in reversed(range(_DEEPEST)):
        values = levels[level] + _enlarged(net(f"up{level}", values))
        values = net.block(f"up{level}_0", values)
    return _answers(unfolded(net("head", _activated(values)).astype(jnp.float32)))


class _Convolutions:
    """The convolutions of a network with their weights."""

    def __init__(self, weights: Weights) -> None:
        self.weights = weights

    def __call__(self, name: str, values: JaxArray, step: int = 1) -> JaxArray:
        """Values through the convolution of that name."""
        kernel = self.weights[f"{name}.kernel"]
        edge = kernel.shape[0] // 2
        result = jax.lax.conv_general_dilated(
            values,
            kernel,
            window_strides=(step, step),
            padding=[(edge, edge)] * 2,
            dimension_numbers=("NHWC", "HWIO", "NHWC"),
            precision=PRECISION,
        )
        return result + self.weights[f"{name}.bias"]

    def block(self, name: str, values: JaxArray) -> JaxArray:
        """Values plus what two convolutions make of them."""
        inner = self(f"{name}a", _activated(values))
        return values + self(f"{name}b", _activated(inner))


def _activated(values: JaxArray) -> JaxArray:
    return jnp.maximum(values, SLOPE * values)


def _enlarged(values: JaxArray) -> JaxArray:
    """Twice as high and wide, every pixel four times."""
    return jnp.repeat(jnp.repeat(values, 2, axis=1), 2, axis=2)


def _answers(raw: JaxArray) -> tuple[JaxArray, JaxArray]:
    """Ratios inside the unit circle, and deviations above 0, from nine numbers a pixel.

    The numbers are in the order of the model file: s1 of three channels, s2 of three, deviations.
    """
    pairs = jnp.stack([raw[..., 0:3], raw[..., 3:6]], axis=-1)
    length = jnp.sqrt(1.0 + (pairs**2).sum(axis=-1, keepdims=True))
    # Begins at a standard deviation of about 0.1.
    deviations = jax.nn.softplus(raw[..., 6:9] - 2.0) + LEAST_DEVIATION
    return MOST * pairs / length, deviations


def rounded(weights: Weights) -> Weights:
    """Weights as the model file has them: in half precision."""
    return {name: np.asarray(w).astype(np.float16) for name, w in weights.items()}
