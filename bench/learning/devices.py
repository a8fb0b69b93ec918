"""The devices that share the pictures of a step: the cores of a processor, or graphics cards.

A convolution of small pictures keeps one core busy, not several. So cores are devices of their own,
and each makes new examples and their gradients for its part of the pictures. Nothing waits for
another device inside a compiled function: such functions of jax stood still on processors, once
several were under way.
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Any

import jax

from malus.scenes.core.cores import usable_cores

MOST_CORES = 8
"""Cores that are devices at most: each needs the weights at every step, which takes 3 ms."""


def use_cores() -> None:
    """Make cores devices; without effect where this process has computed with jax before."""
    with suppress(RuntimeError):
        jax.config.update("jax_num_cpu_devices", min(usable_cores(), MOST_CORES))


def sharing(pictures: int) -> list[Any]:
    """Devices that share that many pictures: as many as have parts of one size.

    Examples
    --------
    >>> len(sharing(1))
    1
    """
    devices = jax.devices()
    return devices[: max(n for n in range(1, len(devices) + 1) if pictures % n == 0)]


def described(pictures: int) -> str:
    """The kind and number of the devices that share that many pictures.

    Examples
    --------
    >>> described(1)  # 'cpu: cpu × 1', or a graphics card's name
    '...: ... × 1'
    """
    devices = sharing(pictures)
    return f"{devices[0].platform}: {devices[0].device_kind} × {len(devices)}"


def mean_on_first(trees: list[Any]) -> Any:
    """The mean of the trees of arrays that the devices made, on the first device.

    Examples
    --------
    >>> float(mean_on_first([{"a": 1.0}, {"a": 3.0}])["a"])
    2.0
    """
    first = jax.devices()[0]
    return _mean([jax.device_put(tree, first) for tree in trees])


@partial(jax.jit)
def _mean(trees: list[Any]) -> Any:
    return jax.tree.map(lambda *each: sum(each) / len(each), *trees)
