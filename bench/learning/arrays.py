"""Types of the arrays on a device, and the precision of their products."""

from __future__ import annotations

from typing import Any, TypeAlias

import jax

JaxArray: TypeAlias = Any
"""An array of JAX, or a NumPy array where one is taken."""

Weights: TypeAlias = dict[str, Any]
"""Weights of a network: arrays by name."""

PRECISION = jax.lax.Precision.HIGHEST
"""Of products in single precision: a graphics card would else round their factors to ten bits."""
