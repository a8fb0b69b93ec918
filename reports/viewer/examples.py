"""Images that a run keeps for the viewer: `examples/<scene>.npz`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.scenes.core.errors import InputError

Stokes = NDArray[np.floating[Any]]

_METHOD = "method."


@dataclass(frozen=True)
class Example:
    """One scene: Stokes images (height, width, bands, 3) of the truth and of every method."""

    scene: str
    label: str
    wavelengths_nm: tuple[float, ...]
    mask: NDArray[np.bool_]
    truth: Stokes
    methods: dict[str, Stokes]

    @property
    def pixels(self) -> int:
        """Number of the object's pixels."""
        return int(self.mask.sum())

    @property
    def planes(self) -> int:
        """Number of band images of the truth and all methods."""
        return len(self.wavelengths_nm) * (1 + len(self.methods))

    def bands(self, chosen: list[int]) -> Example:
        """The same with some of the bands."""
        return Example(
            self.scene,
            self.label,
            tuple(self.wavelengths_nm[band] for band in chosen),
            self.mask,
            self.truth[:, :, chosen],
            {name: stokes[:, :, chosen] for name, stokes in self.methods.items()},
        )


def read_examples(folder: Path) -> Iterator[Example]:
    """The examples in a folder, by name; none where there is no such folder."""
    for path in sorted(folder.glob("*.npz")):
        yield read_example(path)


def read_example(path: Path) -> Example:
    """One example.

    Raises
    ------
    InputError
        If the file is no such example.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            example = _example({name: arrays[name] for name in arrays.files})
    except Exception as error:  # a foreign parser raises anything on a broken file
        raise _bad(path, " ".join(str(error).split())) from None
    bands = len(example.wavelengths_nm)
    wanted = (*example.mask.shape, bands, 3)
    for name, stokes in {"truth": example.truth, **example.methods}.items():
        if stokes.shape != wanted or example.mask.ndim != 2:
            raise _bad(path, f"{name} of shape {stokes.shape}, mask {example.mask.shape}")
    return example


def _example(arrays: dict[str, NDArray[Any]]) -> Example:
    meta = json.loads(str(arrays["meta"]))
    methods = {
        name.removeprefix(_METHOD): array
        for name, array in arrays.items()
        if name.startswith(_METHOD)
    }
    return Example(
        scene=str(meta["scene"]),
        label=str(meta["label"]),
        wavelengths_nm=tuple(float(value) for value in meta["wavelengths_nm"]),
        mask=arrays["mask"].astype(bool),
        truth=arrays["truth"],
        methods=methods,
    )


def _bad(path: Path, found: str) -> InputError:
    expected = "truth and methods (height, width, bands, 3), mask (height, width), meta as JSON"
    return InputError(str(path), expected, found, "delete it and run the suite again")
