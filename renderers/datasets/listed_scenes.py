"""What a dataset's folder already tells of its scenes, without reading any of them."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

from malus.renderers.datasets.dataset_record import (
    DATASET,
    DatasetRecord,
    SceneEntry,
    read_dataset,
)
from malus.renderers.datasets.part_list import (
    Part,
    PartContent,
    PlannedScene,
    read_parts,
    remove_lists,
)
from malus.renderers.datasets.scene_folder import SCENE, FileName
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import is_being_written, owned, remove_abandoned
from malus.scenes.core.remote import lstat


def listed_of(folder: Path, renders: str | None = None) -> PartContent:
    """Scenes, done and failed, of `dataset.json` and the lists of all parts, the lists last.

    With `renders` only those of that hash.
    """
    found = PartContent(Part())
    record = _record_of(folder)
    if record is not None and renders in (None, record.renders):
        found.add_all(record.failed, record.scenes)
    for content in read_parts(folder):
        if renders in (None, content.part.renders):
            found.add_all(content.failed.values(), content.done.values())
    return found


def _record_of(folder: Path) -> DatasetRecord | None:
    with contextlib.suppress(InputError):  # none yet, or damaged: scenes are looked at
        return read_dataset(folder)[0]
    return None


def has_record_of_scenes(folder: Path) -> bool:
    """Whether a folder's `dataset.json` lists scenes."""
    record = _record_of(folder)
    return record is not None and bool(record.scenes)


def check_same_dataset(
    folder: Path, planned: Collection[str], about: Mapping[str, Any], part: Part
) -> None:
    """Refuse a folder with scenes that a dataset would lose: others, or of other samples.

    Those of another version of malus are rendered anew. `about` is as for `DatasetWriter`.

    Raises
    ------
    InputError
        If the folder holds such a dataset, one that cannot be read, or a folder of something else
        by the name of a scene; nothing is changed.
    """
    _check_readable(folder)
    record = _record_of(folder)
    _check_own_folders(folder, planned, () if record is None else record.scenes)
    earlier = _suite(None if record is None else record.suite)
    replaced = _is_other_render(earlier, _suite(about.get("suite")))
    may_differ = part.count == 1 or (record is not None and _is_other_version(record, about))
    lost = any(
        (folder / entry.scene).exists()
        for renders, entries in _all_listed(folder, record)
        for entry in entries
        if replaced
        or not (may_differ or renders == part.renders)
        or (entry.scene not in planned if part.count == 1 else (entry.index or 0) >= part.in_all)
    )
    if lost:
        same = "scenes, samples and seed" + (", rendered alike" if part.count > 1 else "")
        expected = f"a new folder, or a dataset of the same {same}"
        hint = "choose another `out`, or delete that folder; nothing was changed"
        raise InputError(f"output folder {folder}", expected, _described(earlier), hint)


def check_parts_differ(folder: Path, planned: Mapping[str, PlannedScene], part: Part) -> None:
    """Refuse a part with a scene that another part has by another number: one would be lost.

    A part knows its own scenes alone; those of the others are told by their lists.

    Raises
    ------
    InputError
        Naming both.
    """
    for content in read_parts(folder) if part.count > 1 else ():
        if content.part.renders != part.renders:
            continue
        for name, entry in content.done.items():
            own = planned[name].index if name in planned else None
            if None not in (own, entry.index) and own != entry.index:
                found = f"scene {own} equal to scene {entry.index} of part {content.part.label}"
                hint = "draw a range in place of choices, or fewer scenes, into a new folder"
                raise InputError(f"part {part.label}", "scenes that differ", found, hint)


def _check_readable(folder: Path) -> None:
    """Refuse a folder whose `dataset.json` cannot be read: scenes that it lists would be lost."""
    if not (folder / DATASET).exists():
        return
    try:
        read_dataset(folder)
    except InputError as damaged:
        where, expected, found, _ = damaged.args
        hint = "choose another `out`; if its scenes may be rendered over, delete that file"
        raise InputError(where, expected, found, f"{hint}; nothing was changed") from None


def _check_own_folders(
    folder: Path, planned: Collection[str], listed: Iterable[SceneEntry]
) -> None:
    """Refuse a folder that has a folder by the name of a scene which is none: it would be lost.

    Of a scene that was not stored whole there may be some files.
    """
    if not folder.is_dir():
        return
    known = {entry.scene for entry in listed}
    for name in sorted(entry.name for entry in folder.iterdir()):
        if name in planned and name not in known and _is_foreign(folder / name):
            expected, hint = "a new folder, or a dataset", "choose another `out`"
            found = f"{name}, a folder of something else"
            raise InputError(
                f"output folder {folder}", expected, found, f"{hint}; nothing was changed"
            )


def _is_foreign(folder: Path) -> bool:
    """Whether a folder by the name of a scene has other files than a scene's."""
    own = {SCENE, *get_args(FileName)}
    if not folder.is_dir() or (folder / SCENE).exists():
        return False
    return any(entry.name not in own for entry in folder.iterdir())


def _all_listed(
    folder: Path, record: DatasetRecord | None
) -> Iterator[tuple[str, Iterable[SceneEntry]]]:
    """Hash of the renders, and the scenes that are done, of `dataset.json` and of every list."""
    if record is not None:
        yield record.renders, record.scenes
    for content in read_parts(folder):
        yield content.part.renders, content.done.values()


def _is_other_render(earlier: Mapping[str, Any], suite: Mapping[str, Any]) -> bool:
    """Whether a suite has other samples, or lacks maps or a sensor that an earlier one has."""
    maps = earlier.get("maps")
    return any(
        earlier.get(key) not in (None, suite.get(key)) for key in ("sampling", "renderer", "sensor")
    ) or (isinstance(maps, list) and not all(name in suite.get("maps", ()) for name in maps))


def _is_other_version(record: DatasetRecord, about: Mapping[str, Any]) -> bool:
    """Whether nothing but malus, or a program it uses, can differ from what made a dataset."""
    earlier, suite = _suite(record.suite), _suite(about.get("suite"))
    for each in (earlier, suite):
        if isinstance(each.get("random"), dict):
            each["random"].pop("count", None)  # a larger one goes on with a smaller
    variants = [record.variant.get("name"), (about.get("variant") or {}).get("name")]
    return earlier == suite and variants[0] == variants[1]


def _suite(content: Mapping[str, Any] | None) -> dict[str, Any]:
    """A copy of a suite's content as it stands in JSON: lists, where a record has tuples."""
    return dict(json.loads(json.dumps(content or {})))


def _described(suite: Mapping[str, Any]) -> str:
    """A suite in a few words, of a record that may hold anything."""
    camera, sampling = (
        part if isinstance(part := suite.get(key), dict) else {} for key in ("camera", "sampling")
    )
    side, samples, seed = camera.get("resolution"), sampling.get("samples"), sampling.get("seed")
    return f"{side}² pixels, {samples} samples, seed {seed}, suite {suite.get('name')}"


def folder_size(folder: Path) -> int | None:
    """Bytes of the files in a folder; None where it cannot be listed."""
    try:
        return sum(lstat(file).st_size for file in folder.iterdir())
    except OSError:
        return None


@contextlib.contextmanager
def being_written(folder: Path, part: Part) -> Iterator[None]:
    """Mark a dataset as being written; who leaves it last removes the lists of parts.

    Not before: another process may be about to write a `dataset.json` that lacks what a list has.

    Raises
    ------
    InputError
        While a process writes something else there.
    """
    entered = False
    try:
        with owned(folder, part.renders):
            entered = True
            yield
    finally:
        if entered:
            _remove_unneeded(folder, part)


def _remove_unneeded(folder: Path, part: Part) -> None:
    """Remove the lists whose scenes `dataset.json` has, where nobody writes the dataset.

    Those of parts stay until nothing is left.
    """
    remove_abandoned(folder)
    record = _record_of(folder)
    if record is None or is_being_written(folder):
        return
    listed = {entry.scene for entry in record.scenes} | {entry.scene for entry in record.failed}
    if part.count > 1 and len(listed) < part.in_all:
        return
    lists = [each for each in read_parts(folder) if listed >= each.done.keys() | each.failed]
    remove_lists(folder, [each.part for each in lists if each.part.renders == part.renders])
