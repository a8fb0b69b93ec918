"""Copies of the files that a dataset's scenes name: radiance maps, meshes, pictures, materials.

They are named by the hash of their content. A scene of a dataset from elsewhere may name any file
of this machine; only the copy in the dataset is opened.
"""

from __future__ import annotations

import re
import shutil
import stat
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from malus.scenes.core.errors import InputError
from malus.scenes.core.files import digest, replace_file
from malus.scenes.core.model import Model
from malus.scenes.core.named_file import NamedFile
from malus.scenes.core.remote import lstat
from malus.scenes.scene import Scene

FOLDERS = {
    "radiance map": "maps",
    "mesh file": "meshes",
    "picture": "pictures",
    "pBRDF file": "materials",
}
_DIGEST = re.compile(r"[0-9a-f]{16}")
_SUFFIX = re.compile(r"\.[a-z0-9]{1,8}")


def keep_files(scene: Scene, folder: Path, kept: set[Path]) -> None:
    """Copy the files that a scene names into the dataset, where their hash is known.

    Copies that are missing or changed are made again. Those in `kept` are not hashed again; those
    that are there now are added.

    Raises
    ------
    InputError
        If the content of one has changed.
    """

    def keep(named: NamedFile) -> NamedFile:
        copy = _copy_of(named, folder)
        if named.digest and copy not in kept:
            if not _is_whole(copy, named.digest):
                file = named.checked()
                copy.parent.mkdir(parents=True, exist_ok=True)
                replace_file(copy, lambda temporary: shutil.copyfile(file, temporary))
            kept.add(copy)
        return named

    _with_files(scene, keep)


def names_files(value: Any) -> bool:
    """Whether a scene or a suite names a file, at any depth."""
    if isinstance(value, NamedFile) and value.file_name is not None:
        return True
    if isinstance(value, Model):
        return any(names_files(getattr(value, name)) for name in type(value).model_fields)
    if isinstance(value, Mapping):  # what a random suite draws from
        return bool(value.get("digest")) or any(map(names_files, value.values()))
    return isinstance(value, tuple | list) and any(map(names_files, value))


def _is_whole(copy: Path, expected: str) -> bool:
    """Whether a copy is there, no link, and has the digest of its name."""
    try:
        return stat.S_ISREG(lstat(copy).st_mode) and digest(copy)[1][:16] == expected
    except (OSError, InputError):
        return False


def with_own_files(scene: Scene, folder: Path, checked: set[Path]) -> Scene:
    """The scene with its files read from the dataset instead of the paths that it names.

    Files in `checked` are not hashed again, as scenes share them and a measured material has 1 GB;
    those that match their hash are added. Opening one checks it once more.

    Raises
    ------
    InputError
        If a file of the dataset is a link, or its content does not match its name.
    """

    def own(named: NamedFile) -> NamedFile:
        copy = _copy_of(named, folder)
        if copy in checked:
            return named.read_from(copy)
        try:
            lstat(copy)
        except OSError:
            pass  # a missing file is reported when it is read
        else:
            actual = digest(copy)[1][:16]
            if actual != named.digest:
                hint = "render the dataset again"
                raise InputError(str(copy), f"digest {named.digest}", actual, hint)
            checked.add(copy)
        return named.read_from(copy)

    changed = _with_files(scene, own)
    assert isinstance(changed, Scene)
    return changed


def _with_files(value: Any, change: Callable[[NamedFile], NamedFile]) -> Any:
    """A value with `change` applied to every named file in it, at any depth."""
    if isinstance(value, NamedFile):
        return value if value.file_name is None else change(value)
    if isinstance(value, tuple):
        return tuple(_with_files(part, change) for part in value)
    if isinstance(value, Model):
        parts = ((name, getattr(value, name)) for name in type(value).model_fields)
        return value.model_copy(update={name: _with_files(part, change) for name, part in parts})
    return value


def _copy_of(named: NamedFile, folder: Path) -> Path:
    """Path of the dataset's copy of a file."""
    # Digest and suffix become a file name: nothing in them may lead out of the folder.
    name = named.digest if _DIGEST.fullmatch(named.digest) else "unknown"
    suffix = Path(named.file_name or "").suffix.lower()
    return (
        folder / FOLDERS[named.file_kind] / (name + (suffix if _SUFFIX.fullmatch(suffix) else ""))
    )
