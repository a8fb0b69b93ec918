"""Scenes of made-up light for the viewer of a page: every degree and angle of polarisation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from malus.scenes.core.arrays import BoolArray, Float32Array

EVIL = "<script>alert(1)</script>"
SIZE = 40
WAVELENGTHS = (450.0, 650.0)
COLOURED_NM = (450, 550, 650)


def disc(size: int = SIZE) -> BoolArray:
    y, x = np.mgrid[:size, :size]
    middle = (size - 1) / 2
    return (x - middle) ** 2 + (y - middle) ** 2 < (0.47 * size) ** 2


def mixed_part(size: int = SIZE) -> BoolArray:
    """Some of the disc's pixels, not symmetric in any way."""
    y, x = np.mgrid[:size, :size]
    return disc(size) & ((x - 0.3 * size) ** 2 + (y - 0.6 * size) ** 2 < (0.15 * size) ** 2)


def stokes_image(seed: int, size: int = SIZE) -> Float32Array:
    """Every degree and angle of polarisation, and no two pixels alike."""
    random = np.random.default_rng(seed)
    s0 = random.uniform(0.05, 1.0, (size, size, len(WAVELENGTHS)))
    degree = random.uniform(0.0, 1.0, s0.shape)
    angle = random.uniform(0.0, 2 * np.pi, s0.shape)
    parts = [s0, s0 * degree * np.cos(angle), s0 * degree * np.sin(angle)]
    return np.stack(parts, axis=-1).astype(np.float32)


def save_example(
    folder: Path, scene: str, label: str, mixed: BoolArray | None = None, **methods: Float32Array
) -> Float32Array:
    size = len(next(iter(methods.values())))
    truth = stokes_image(1, size)
    meta = {"scene": scene, "label": label, "wavelengths_nm": WAVELENGTHS}
    arrays: dict[str, Any] = {f"method.{name}": stokes for name, stokes in methods.items()}
    if mixed is not None:
        arrays["mixed"] = mixed
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / f"{scene}.npz", truth=truth, mask=disc(size), meta=np.array(json.dumps(meta)),
             allow_pickle=False, **arrays)  # fmt: skip
    return truth


def coloured_stokes(seed: int) -> Float32Array:
    """Three bands of every degree and angle, for COLOURED_NM."""
    return np.concatenate([stokes_image(seed), stokes_image(seed + 10)[:, :, :1]], axis=2)
