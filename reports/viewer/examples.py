"""Images that a run keeps for the viewer: `examples/<scene>.npz`."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from malus.scenes.colour import band_weights, channel_weights, srgb_weights
from malus.scenes.core.arrays import AnyArray, BoolArray, Float64Array, FloatArray
from malus.scenes.core.errors import InputError, reading

_METHOD = "method."
_EXPECTED = "truth and methods (height, width, bands, 3), mask (height, width), meta as JSON"
_HINT = "delete it and run the suite again"


@dataclass(frozen=True)
class Example:
    """One scene: Stokes images (height, width, bands, 3) of the truth and of every method.

    `mixed` (height, width) are pixels that see more than one normal; None in older files.
    `channels` names the bands of a photograph, which has no `wavelengths_nm`. Every `step`-th row
    and column was kept.
    """

    scene: str
    label: str
    wavelengths_nm: tuple[float, ...]
    mask: BoolArray
    truth: FloatArray
    methods: dict[str, FloatArray]
    mixed: BoolArray | None = None
    channels: tuple[str, ...] = ()
    step: int = 1

    @property
    def band_names(self) -> tuple[str, ...]:
        """Names of the bands, for people."""
        return self.channels or tuple(f"{wavelength:g} nm" for wavelength in self.wavelengths_nm)

    @property
    def colour_weights(self) -> Float64Array:
        """What one unit of each band adds to X, Y, Z.

        Raises
        ------
        InputError
            If the bands show no colour.
        """
        if self.channels:
            return channel_weights(self.channels)
        return band_weights(self.wavelengths_nm)

    @property
    def screen_weights(self) -> Float64Array:
        """Matrix (bands, 3) to linear sRGB: the colour that people see of all bands together."""
        if self.channels:
            return np.eye(3) if len(self.channels) == 3 else np.ones((len(self.channels), 3))
        return srgb_weights(self.wavelengths_nm)

    @property
    def pixels(self) -> int:
        """Number of the object's pixels."""
        return int(self.mask.sum())

    @cached_property
    def beyond(self) -> BoolArray:
        """Pixels (height, width) off the mask at which there is light: edges, walls, ground."""
        lit = (self.truth[..., 0] != 0).any(axis=-1)
        known = np.isfinite(self.truth).all(axis=(-2, -1))
        return np.asarray(lit & known & ~self.mask)


def read_examples(folder: Path) -> Iterator[Example]:
    """The examples in a folder, in the order of their file names; none without the folder."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # most of the time is decompression
        yield from pool.map(read_example, sorted(folder.glob("*.npz")))


def read_example(path: Path) -> Example:
    """The example in a file.

    Raises
    ------
    InputError
        If the file holds none.
    """
    with (
        reading(str(path), _EXPECTED, _HINT),
        path.open("rb") as file,
        np.load(file, allow_pickle=False) as arrays,
    ):
        example = _example({name: arrays[name] for name in arrays.files})
    bands = len(example.band_names)
    expected_shape = (*example.mask.shape, bands, 3)
    for name, stokes in {"truth": example.truth, **example.methods}.items():
        if stokes.shape != expected_shape or example.mask.ndim != 2:
            shapes = f"{name} of shape {stokes.shape}, mask {example.mask.shape}"
            raise InputError(str(path), _EXPECTED, shapes, _HINT)
    if example.mixed is not None and example.mixed.shape != example.mask.shape:
        shapes = f"mixed of shape {example.mixed.shape}, mask {example.mask.shape}"
        raise InputError(str(path), _EXPECTED, shapes, _HINT)
    return example


def _example(arrays: dict[str, AnyArray]) -> Example:
    meta = json.loads(str(arrays["meta"]))
    methods = {
        name.removeprefix(_METHOD): array
        for name, array in arrays.items()
        if name.startswith(_METHOD)
    }
    return Example(
        scene=str(meta["scene"]),
        label=str(meta["label"]),
        wavelengths_nm=tuple(float(value) for value in meta.get("wavelengths_nm", ())),
        mask=arrays["mask"].astype(bool),
        truth=arrays["truth"],
        methods=methods,
        mixed=arrays["mixed"].astype(bool) if "mixed" in arrays else None,
        channels=tuple(str(name) for name in meta.get("channels", ())),
        step=int(meta.get("step", 1)),
    )
