"""Datasets as one HDF5 file: the arrays of all scenes stacked, a scene along the first axis.

`stokes` is (scenes, height, width, bands, 3); a chunk is one scene, compressed without loss (gzip
behind a byte shuffle, which every HDF5 library reads). h5py is the optional package `malus[hdf5]`.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from malus.renderers.datasets.samples import Cut
from malus.renderers.datasets.shards import ShardScene
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.files import write_whole

HDF5 = "dataset.h5"
OTHER_FORMAT = "choose webdataset, whose scenes may differ"
_AGAIN = "export the dataset again"


def h5py() -> Any:
    """The package h5py, or one line that says how to install it."""
    try:
        import h5py as package
    except ImportError:
        hint = "pip install h5py"
        raise InputError("HDF5", "the package h5py", "nothing", hint) from None
    return package


def write_hdf5(
    folder: Path, count: int, scenes: Iterable[ShardScene], about: Mapping[str, Any]
) -> None:
    """Write `count` scenes of one size as one file, which appears when it is whole.

    Raises
    ------
    InputError
        Without h5py, or if it cannot be written.
    """
    package = h5py()

    def write(path: Path) -> None:
        names: set[str] = set()
        with package.File(path, "w") as file:
            ids = file.create_dataset("scene", (count,), dtype=package.string_dtype())
            words = file.create_dataset("scene_json", (count,), dtype=package.string_dtype())
            for number, scene in enumerate(scenes):
                _check_room(path, scene)
                ids[number], words[number] = scene.id, json.dumps(scene.description)
                names = names or set(scene.arrays)
                if set(scene.arrays) != names:
                    found, expected = ", ".join(sorted(scene.arrays)), ", ".join(sorted(names))
                    raise InputError(f"scene {scene.id}", expected, found, OTHER_FORMAT)
                for name, array in scene.arrays.items():
                    stack = _stack(file, name, array, count)
                    if (stack.dtype, stack.shape[1:]) != (array.dtype, array.shape):
                        expected = f"{name} of {stack.dtype} {stack.shape[1:]}, as of other scenes"
                        found = f"{array.dtype} {array.shape}"
                        raise InputError(f"scene {scene.id}", expected, found, OTHER_FORMAT)
                    stack[number] = array
            file.attrs["format"] = "malus hdf5 1"
            file.attrs["about"] = json.dumps(about)

    write_whole(folder / HDF5, write)


_SPARE_BYTES = 4 << 20
"""Room for what HDF5 writes beside arrays, and for those it still holds when it is closed."""


def _check_room(path: Path, scene: ShardScene) -> None:
    """Refuse to go on where the disk is nearly full: HDF5 ends the process when it meets its end.

    Raises
    ------
    InputError
        Where a scene might not fit.
    """
    needed = 2 * sum(array.nbytes for array in scene.arrays.values()) + _SPARE_BYTES
    free = shutil.disk_usage(path.parent).free
    if free < needed:
        expected, found = f"room for {needed / 1e6:.1f} MB", f"{free / 1e6:.1f} MB"
        hint = "free some space or choose another folder"
        raise InputError(f"folder {path.parent}", expected, found, hint)


def _stack(file: Any, name: str, array: AnyArray, count: int) -> Any:
    """The dataset of an array, made when its first scene comes."""
    if name not in file:
        options = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
        shape, chunks = (count, *array.shape), (1, *array.shape)
        file.create_dataset(name, shape, dtype=array.dtype, chunks=chunks, **options)
    return file[name]


class Hdf5File:
    """An HDF5 file as a source of samples; every process opens it for itself."""

    def __init__(self, path: Path) -> None:
        """Read names, sizes and ids.

        Raises
        ------
        InputError
            Without h5py, or if it is no such file.
        """
        self.path = path
        self._file: Any = None
        self._process = 0
        package = h5py()
        with reading(str(path), "a dataset as HDF5", _AGAIN), package.File(path, "r") as file:
            about = json.loads(file.attrs["about"])
            self.ids: tuple[str, ...] = tuple(file["scene"].asstr()[:])
            stacks = [name for name in file if name not in ("scene", "scene_json")]
            self.maps: tuple[str, ...] = (*stacks, "image")
            self.shape: tuple[int, int] = file["stokes"].shape[1:3]
            self.splits: dict[str, list[str]] = about.get("splits", {})

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs: no open file."""
        return self.__dict__ | {"_file": None}

    def read(self, number: int, maps: Sequence[str], cut: Cut) -> dict[str, AnyArray]:
        """Arrays of a scene by name.

        Raises
        ------
        InputError
            If the file is cut or changed.
        """
        with reading(str(self.path), f"the arrays of scene {self.ids[number]}", _AGAIN):
            if self._file is None or self._process != os.getpid():
                self._file, self._process = h5py().File(self.path, "r"), os.getpid()
            file, window = self._file, cut(self.shape)
            return {
                name: file["stokes"][(number, *window, slice(None), 0)]
                if name == "image"
                else file[name][(number, *window)]
                for name in maps
            }
