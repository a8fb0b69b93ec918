"""Degree and angle of polarisation as grey pictures of 16 bits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from malus.scenes import polarisation
from malus.scenes.core.arrays import FloatArray

WHITE = 65535
"""Largest value of a 16-bit image."""


def to_16bit(values: FloatArray) -> NDArray[np.uint16]:
    """Values in [0, 1] as 16 bits; what lies outside is clipped.

    Examples
    --------
    >>> to_16bit(np.array([0.0, 0.5, 1.0, 1.5])).tolist()
    [0, 32768, 65535, 65535]
    """
    scaled = np.rint(np.clip(values, 0.0, 1.0).astype(np.float64) * WHITE)
    return scaled.astype(np.uint16)


def aolp_16bit(stokes: FloatArray) -> NDArray[np.uint16]:
    """Angle of linear polarisation of Stokes vectors (..., 3) on a circle of 65536 steps.

    Examples
    --------
    >>> int(aolp_16bit(np.array([1.0, 0.0, 1.0])))  # +45°
    16384
    """
    turns = polarisation.aolp(stokes).astype(np.float64) / np.pi
    return (np.rint(turns * (WHITE + 1)) % (WHITE + 1)).astype(np.uint16)


def save_16bit(path: Path, values: NDArray[np.uint16]) -> None:
    """Write one grey 16-bit image."""
    import PIL.Image

    # Of maps, stronger compression takes three times as long and saves nothing.
    PIL.Image.fromarray(np.ascontiguousarray(values)).save(path, compress_level=3)
