"""Types of the arrays on a device."""

from __future__ import annotations

from typing import Any, TypeAlias

JaxArray: TypeAlias = Any
"""An array of JAX, or a NumPy array where one is taken."""

Weights: TypeAlias = dict[str, Any]
"""Weights of a network: arrays by name."""
