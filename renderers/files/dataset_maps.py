"""Radiance maps of a dataset's scenes: copied into it, known by their content, and read only there.

A scene from elsewhere may name any file of this machine as its map. That name is never opened.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

from malus.renderers.files.storage import digest, replace_file
from malus.renderers.files.stores import lstat
from malus.scenes.content import check_content
from malus.scenes.errors import InputError
from malus.scenes.lights import Environment
from malus.scenes.scene import Scene

MAPS = "maps"
_DIGEST = re.compile(r"[0-9a-f]{16}")


def keep_map(scene: Scene, folder: Path) -> None:
    """Copy the file of a scene's radiance map into the dataset, if it has one of known content.

    Raises
    ------
    InputError
        If the map is no longer what it was.
    """
    light = scene.light
    if not isinstance(light, Environment) or light.name == "studio" or not light.digest:
        return
    kept = _kept(light, folder)
    if kept.exists():
        return
    check_content(light.file, light.digest, "radiance map")
    kept.parent.mkdir(parents=True, exist_ok=True)
    replace_file(kept, lambda temporary: shutil.copyfile(light.file, temporary))


def with_own_map(scene: Scene, folder: Path) -> Scene:
    """The scene whose map, if it has one, is read from the dataset and from nowhere else.

    Raises
    ------
    InputError
        If the dataset's file is a link, or has another content than its name tells.
    """
    light = scene.light
    if not isinstance(light, Environment) or light.name == "studio":
        return scene
    kept = _kept(light, folder)
    try:
        lstat(kept)
    except OSError:
        pass  # a missing map is told when a method asks for it
    else:
        found = digest(kept)[1][:16]
        if found != light.digest:
            hint = "render the dataset again"
            raise InputError(str(kept), f"digest {light.digest}", found, hint)
    return scene.model_copy(update={"light": light.read_from(kept)})


def _kept(light: Environment, folder: Path) -> Path:
    # The digest becomes a file name: nothing else may lead out of the folder.
    name = light.digest if _DIGEST.fullmatch(light.digest) else "unknown"
    suffix = ".hdr" if light.name.lower().endswith(".hdr") else ".exr"
    return folder / MAPS / f"{name}{suffix}"
