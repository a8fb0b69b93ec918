"""Datasets as WebDataset shards: tar files whose members are the arrays of scenes as `.npy`.

Members of a scene follow one another, `<scene>.stokes.npy`, `<scene>.mask.npy`, …, and
`<scene>.scene.json`, so that WebDataset streams them; `<shard>.index.json` has their offsets, so
that any scene is read alone, without the rest of the shard. Nothing is compressed or rounded.
Source of the layout: the WebDataset project's documentation of its file format.
"""

from __future__ import annotations

import functools
import io
import json
import math
import os
import tarfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from malus.renderers.datasets.samples import Cut
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.files import digest, replace_text, write_whole
from malus.scenes.core.model import Model

SHARDS = "shards.json"
SUMS = "SHA256SUMS"
"""SHA-256 of every file, as `sha256sum --check` reads them."""
SHARD_BYTES = 256 << 20
"""Bytes after which a new shard begins: large enough to stream, small enough to shuffle."""

_FORMAT = "malus shards 1"
_NPY = ".npy"
_AGAIN = "export the dataset again"


@dataclass(frozen=True)
class ShardScene:
    """A scene that is to be written: its arrays by name, and what describes it."""

    id: str
    arrays: Mapping[str, AnyArray]
    description: Mapping[str, Any]


def write_shards(
    folder: Path, scenes: Iterable[ShardScene], about: Mapping[str, Any], limit: int = SHARD_BYTES
) -> None:
    """Write scenes as shards of about `limit` bytes, then `shards.json` and `SHA256SUMS`.

    What an older export left in the folder is removed first: no mixture of both is ever read.

    Raises
    ------
    InputError
        If they cannot be written.
    """
    for old in (folder / SHARDS, folder / SUMS, *folder.glob("malus-*.tar*")):
        old.unlink(missing_ok=True)
    shards: list[dict[str, Any]] = []
    waiting: list[ShardScene] = []
    size, shape, maps = 0, None, None
    for scene in scenes:
        shape = shape or list(next(iter(scene.arrays.values())).shape[:2])
        maps = maps or sorted(scene.arrays)
        waiting.append(scene)
        size += sum(array.nbytes for array in scene.arrays.values())
        if size >= limit:
            shards.append(_write_shard(folder, len(shards), waiting))
            waiting, size = [], 0
    if waiting:
        shards.append(_write_shard(folder, len(shards), waiting))
    record = {"format": _FORMAT, "shape": shape, "maps": maps, "shards": shards}
    replace_text(folder / SHARDS, json.dumps(record | dict(about), indent=1) + "\n")
    files = sorted([SHARDS, *(path.name for path in folder.glob("malus-*.tar*"))])
    replace_text(folder / SUMS, "".join(f"{digest(folder / name)[1]}  {name}\n" for name in files))


def _write_shard(folder: Path, number: int, scenes: Sequence[ShardScene]) -> dict[str, Any]:
    name = f"malus-{number:06}.tar"
    offsets: dict[str, dict[str, int]] = {}

    def write(path: Path) -> None:
        with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
            for scene in scenes:
                offsets[scene.id] = {key: _add(tar, *member) for key, member in _members(scene)}

    write_whole(folder / name, write)
    replace_text(folder / f"{name}.index.json", json.dumps(offsets) + "\n")
    return {"file": name, "scenes": [scene.id for scene in scenes]}


def _members(scene: ShardScene) -> Iterator[tuple[str, tuple[str, bytes]]]:
    """Name of each array, with the name and content of its member."""
    for name, array in scene.arrays.items():
        buffer = io.BytesIO()
        np.save(buffer, array, allow_pickle=False)
        yield name, (f"{scene.id}.{name}{_NPY}", buffer.getvalue())
    content = json.dumps(scene.description).encode()
    yield "scene", (f"{scene.id}.scene.json", content)


def _add(tar: tarfile.TarFile, name: str, content: bytes) -> int:
    """Add a member, and return where its content begins."""
    info = tarfile.TarInfo(name)  # of 1970 and nobody: the same content gives the same bytes
    info.size = len(content)
    begin = tar.offset + tarfile.BLOCKSIZE
    tar.addfile(info, io.BytesIO(content))
    return begin


class _Shard(Model):
    """A shard in `shards.json`: its name, and the ids of its scenes in order."""

    file: str
    scenes: tuple[str, ...]


class _Record(Model):
    """What is read of `shards.json`."""

    shape: tuple[int, int]
    maps: tuple[str, ...]
    shards: tuple[_Shard, ...]
    splits: dict[str, tuple[str, ...]] = Field(default_factory=dict)


class Shards:
    """Shards on disk as a source of samples; no file stays open, in any process or thread."""

    def __init__(self, folder: Path) -> None:
        """Read `shards.json`; what it lists is opened when it is read.

        Raises
        ------
        InputError
            If it is missing or malformed.
        """
        self.folder = folder
        where = str(folder / SHARDS)
        with reading(where, "shards of a dataset", _AGAIN):
            content = json.loads((folder / SHARDS).read_text("utf-8"))
            if content["format"] != _FORMAT:
                raise ValueError(f"the format {content['format']}; {_FORMAT} is known")
            known = {key: content[key] for key in _Record.model_fields & content.keys()}
        record = _Record.parse(known, where)
        self.shape: tuple[int, int] = record.shape
        self.maps: tuple[str, ...] = (*record.maps, "image")
        self.splits: dict[str, tuple[str, ...]] = record.splits
        self._files: list[str] = [shard.file for shard in record.shards]
        of_shard = [shard.scenes for shard in record.shards]
        if any("/" in name or name.startswith(".") for name in self._files):
            raise InputError(where, "names of files", "a path", _AGAIN)
        self.ids: tuple[str, ...] = tuple(scene for scenes in of_shard for scene in scenes)
        self._shard_of = np.repeat(np.arange(len(of_shard)), [len(scenes) for scenes in of_shard])

    def read(self, number: int, maps: Sequence[str], cut: Cut) -> dict[str, AnyArray]:
        """Arrays of a scene by name; only the rows of a crop are read.

        Raises
        ------
        InputError
            If the shard is cut, or lacks an array where its index has it; or if a crop is larger
            than the picture.
        """
        shard, scene = self._files[self._shard_of[number]], self.ids[number]
        path, index = self.folder / shard, self.folder / f"{shard}.index.json"
        with reading(str(index), f"where scene {scene} is in its shard", _AGAIN):
            offsets = _index(index, index.stat().st_mtime_ns)[scene]
        expected = f"the arrays of scene {scene}"
        with reading(str(path), expected, _AGAIN), path.open("rb", buffering=0) as file:
            stored = dict.fromkeys("stokes" if name == "image" else name for name in maps)
            for name in stored:
                _check_member(file.fileno(), offsets[name], f"{scene}.{name}{_NPY}")
            arrays = {name: _array(file.fileno(), offsets[name], cut) for name in stored}
        # A copy: who divides the picture by its mean shall not change the truth with it.
        return {
            name: arrays["stokes"][..., 0].copy() if name == "image" else arrays[name]
            for name in maps
        }


@functools.lru_cache(maxsize=256)
def _index(path: Path, written_ns: int) -> dict[str, dict[str, int]]:
    """Offsets of the arrays of every scene of a shard; of one that was written again, its own."""
    content: dict[str, dict[str, int]] = json.loads(path.read_text("utf-8"))
    return content


def _check_member(descriptor: int, offset: int, name: str) -> None:
    """Raise ValueError unless the member of that name begins at an offset of a shard.

    An index of another export, after a copy that was cut short, has other scenes there.
    """
    header = os.pread(descriptor, tarfile.BLOCKSIZE, offset - tarfile.BLOCKSIZE)
    found = tarfile.TarInfo.frombuf(header, "utf-8", "strict").name
    if found != name:
        raise ValueError(f"{found} where its index has {name}")


_HEADER = 256
"""Bytes that hold the header of any array here: NumPy pads it to a multiple of 64."""


def _array(descriptor: int, offset: int, cut: Cut) -> AnyArray:
    """Rows and columns of the array that begins at an offset of a file."""
    header = io.BytesIO(os.pread(descriptor, _HEADER, offset))
    if np.lib.format.read_magic(header) != (1, 0):
        raise ValueError("another version of .npy than 1.0")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(header)
    if fortran or dtype.hasobject:
        raise ValueError("an array that is not in rows of plain numbers")
    rows, columns = cut(shape[:2])
    top, bottom, _ = rows.indices(shape[0])
    row_bytes = dtype.itemsize * math.prod(shape[1:])
    begin = offset + header.tell() + top * row_bytes
    data = os.pread(descriptor, (bottom - top) * row_bytes, begin)
    array = np.frombuffer(bytearray(data), dtype).reshape(bottom - top, *shape[1:])
    return array[:, columns] if columns != slice(None) else array
