"""Files that a dataset's scenes name: copied into it, known by their content, read only there.

A scene from elsewhere may name any file of this machine as its radiance map, mesh, picture or
measured material. That name is never opened.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
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


def keep_files(scene: Scene, folder: Path) -> None:
    """Copy the files that a scene names into the dataset, if their content is known.

    Raises
    ------
    InputError
        If one is no longer what it was.
    """

    def keep(named: NamedFile) -> NamedFile:
        kept = _kept(named, folder)
        if named.digest and not kept.exists():
            file = named.checked()
            kept.parent.mkdir(parents=True, exist_ok=True)
            replace_file(kept, lambda temporary: shutil.copyfile(file, temporary))
        return named

    _with_files(scene, keep)


def with_own_files(scene: Scene, folder: Path, checked: set[Path]) -> Scene:
    """The scene whose files are read from the dataset and from nowhere else.

    Files in `checked` are not looked at again, as scenes share them and a measured material has
    1 GB; those that are found right are added. Who opens one checks it once more.

    Raises
    ------
    InputError
        If a file of the dataset is a link, or has another content than its name tells.
    """

    def own(named: NamedFile) -> NamedFile:
        kept = _kept(named, folder)
        if kept in checked:
            return named.read_from(kept)
        try:
            lstat(kept)
        except OSError:
            pass  # a missing file is told when it is asked for
        else:
            found = digest(kept)[1][:16]
            if found != named.digest:
                hint = "render the dataset again"
                raise InputError(str(kept), f"digest {named.digest}", found, hint)
            checked.add(kept)
        return named.read_from(kept)

    changed = _with_files(scene, own)
    assert isinstance(changed, Scene)
    return changed


def _with_files(value: Any, change: Callable[[NamedFile], NamedFile]) -> Any:
    """A value whose named files are changed, however deep in it they are."""
    if isinstance(value, NamedFile):
        return value if value.file_name is None else change(value)
    if isinstance(value, tuple):
        return tuple(_with_files(part, change) for part in value)
    if isinstance(value, Model):
        parts = ((name, getattr(value, name)) for name in type(value).model_fields)
        return value.model_copy(update={name: _with_files(part, change) for name, part in parts})
    return value


def _kept(named: NamedFile, folder: Path) -> Path:
    # Digest and suffix become a file name: nothing in them may lead out of the folder.
    name = named.digest if _DIGEST.fullmatch(named.digest) else "unknown"
    suffix = Path(named.file_name or "").suffix.lower()
    return folder / FOLDERS[named.what] / (name + (suffix if _SUFFIX.fullmatch(suffix) else ""))
