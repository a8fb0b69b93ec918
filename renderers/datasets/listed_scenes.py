"""What a dataset's folder already tells of its scenes, without reading any of them."""

from __future__ import annotations

import contextlib
from pathlib import Path

from malus.renderers.datasets.dataset_record import read_dataset
from malus.renderers.datasets.part_list import Part, PartContent, read_parts, remove_lists
from malus.scenes.core.errors import InputError
from malus.scenes.core.remote import lstat


def listed_of(folder: Path, renders: str | None = None) -> PartContent:
    """Scenes, done and failed, of `dataset.json` and the lists of all parts, the lists last.

    With `renders` only those of that hash.
    """
    found = PartContent(Part())
    with contextlib.suppress(InputError):  # none yet, or damaged: scenes are looked at
        record = read_dataset(folder)[0]
        if renders in (None, record.renders):
            found.add_all(record.failed, record.scenes)
    for content in read_parts(folder):
        if renders in (None, content.part.renders):
            found.add_all(content.failed.values(), content.done.values())
    return found


def folder_size(folder: Path) -> int | None:
    """Bytes of the files in a folder; None where it cannot be listed."""
    try:
        return sum(lstat(file).st_size for file in folder.iterdir())
    except OSError:
        return None


def remove_unneeded(folder: Path, part: Part) -> None:
    """Remove the lists of a dataset that `dataset.json` makes unneeded.

    They are those of the whole, and those of all parts when nothing is left.
    """
    listed = [content.part for content in read_parts(folder)]
    if part.count > 1:
        record = read_dataset(folder)[0]
        if len(record.scenes) + len(record.failed) < part.in_all:
            return
    remove_lists(folder, [each for each in listed if each.renders == part.renders])
