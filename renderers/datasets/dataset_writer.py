"""Write a dataset, in one part or several: scenes one at a time, listed at the end."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from malus.renderers.datasets.dataset_files import keep_files
from malus.renderers.datasets.dataset_record import (
    DATASET,
    DatasetRecord,
    FailedScene,
    SceneEntry,
)
from malus.renderers.datasets.listed_scenes import (
    check_parts_differ,
    check_same_dataset,
    folder_size,
    has_record_of_scenes,
    listed_of,
)
from malus.renderers.datasets.part_list import Part, PartList, PlannedScene
from malus.renderers.datasets.scene_folder import (
    is_whole,
    read_record,
    write_scene,
)
from malus.renderers.truth import Truth
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import remove_abandoned, replace_text
from malus.scenes.core.remote import as_path
from malus.scenes.scene import Scene

_ID = re.compile(r"[0-9a-f]{16}")


class DatasetWriter:
    """Writes a new dataset or continues one; a context manager that lists the scenes at its end.

    Parameters
    ----------
    folder : path
        Created if it is missing.
    planned : mapping of scene id to PlannedScene, optional
        Scenes that the dataset shall hold, or a part of it. A dataset of others in the folder is
        refused, and what is of another origin is left out. Without it every scene there is kept.
    about : mapping
        Keys 'suite', 'versions' and 'variant' of `dataset.json`.
    part : Part, optional
        The part of the dataset that `planned` is; by default all of it. What other parts of the
        same renders have listed is listed too.

    Attributes
    ----------
    done : mapping of scene id to SceneEntry
        Scenes of the part that need not be rendered.
    failed : mapping of scene id to FailedScene
        Scenes that could not be rendered, by this writer or an earlier one of the same origin.
    """

    def __init__(
        self,
        folder: Path | str,
        planned: Mapping[str, PlannedScene] | None = None,
        about: Mapping[str, Any] | None = None,
        part: Part | None = None,
    ) -> None:
        self.folder = as_path(folder)
        self.planned = planned
        self.about = dict(about or {})
        self.part = part or Part(planned=len(planned or ()), in_all=len(planned or ()))
        self.done: dict[str, SceneEntry] = {}
        self.failed: dict[str, FailedScene] = {}
        self._list: PartList | None = None
        self._earlier_stands = False
        self._kept: set[Path] = set()

    def __enter__(self) -> Self:
        """Keep the scenes that the folder already holds.

        Raises
        ------
        InputError
            If it holds another dataset, which would be lost, or another part with an equal scene.
        """
        if self.planned is not None:
            check_same_dataset(self.folder, self.planned, self.about, self.part)
            check_parts_differ(self.folder, self.planned, self.part)
        self.folder.mkdir(parents=True, exist_ok=True)
        remove_abandoned(self.folder)
        listed = listed_of(self.folder)
        self.done = dict(self._usable_scenes(listed.done))
        self.failed = {
            name: failure
            for name, failure in listed.failed.items()
            if self._is_still_failed(failure)
        }
        if self.planned is not None:
            self._list = PartList(self.folder, self.part).__enter__()
            for name, entry in self.done.items():
                if self.part.count > 1 and self._list.earlier.done.get(name) != entry:
                    self._list.add(entry)
        # The record of an earlier version's renders stands until the first of them is replaced.
        nothing = not self.done and not self.failed and self.part.count == 1
        self._earlier_stands = nothing and has_record_of_scenes(self.folder)
        if not self._earlier_stands:
            self._write_record()
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """List the scenes that are done, also after an error."""
        if self._list is not None:
            self._list.__exit__(error_type, error, trace)
        if not self._earlier_stands:
            self._write_record()

    def add(self, truth: Truth, origin: str = "") -> None:
        """Write one truth, as a whole or not at all.

        Raises
        ------
        InputError
            If it cannot be written.
        """
        name = truth.scene.id
        folder = self.folder / name
        if self._earlier_stands:
            self._earlier_stands = False
            self._write_record()
        keep_files(truth.scene, self.folder, self._kept)  # first: no scene is there without them
        write_scene(folder, truth, origin)
        self.done[name] = self._entry(truth.scene, read_record(folder)[1], origin)
        self.failed.pop(name, None)
        if self._list is not None:
            self._list.add(self.done[name])

    def keep_files_of_done(self, scenes: Iterable[Scene]) -> None:
        """Copy the files that scenes name which are done, where copies are missing or changed.

        Raises
        ------
        InputError
            If the content of one has changed.
        """
        for scene in scenes:
            if scene.id in self.done:
                keep_files(scene, self.folder, self._kept)

    def fail(self, failed: FailedScene) -> None:
        """Record a scene that could not be rendered."""
        self._earlier_stands = False
        self.failed[failed.scene] = failed
        if self._list is not None:
            self._list.add(failed)

    def _entry(self, scene: Scene, sha256: str, origin: str) -> SceneEntry:
        name = scene.id
        if self.planned is None:
            return SceneEntry.of(scene, sha256)
        place = self.planned[name]
        size = folder_size(self.folder / name)
        return SceneEntry.of(
            scene, sha256, origin=origin, bytes=size, index=place.index, split=place.split
        )

    def _is_still_failed(self, failure: FailedScene) -> bool:
        """Whether a recorded failure is one of the same origin, of a scene that is not there."""
        if failure.scene in self.done:
            return False
        if self.planned is None:
            return True
        place = self.planned.get(failure.scene)
        return place is not None and place.origin == failure.origin

    def _usable_scenes(self, listed: Mapping[str, SceneEntry]) -> Iterator[tuple[str, SceneEntry]]:
        """Ids and entries of complete scenes in the folder, of the planned origin."""
        present = {entry.name for entry in self.folder.iterdir()}
        for name in sorted(present) if self.planned is None else self.planned:
            if name not in present or not _ID.fullmatch(name):
                continue
            entry = self._listed_entry(name, listed.get(name)) or self._looked_at(name)
            if entry is not None:
                yield name, entry

    def _listed_entry(self, name: str, entry: SceneEntry | None) -> SceneEntry | None:
        """The entry of a list where the scene is planned so, and its files have their sizes."""
        if entry is None or self.planned is None:
            return None
        place = self.planned[name]
        known = entry.bytes is not None and entry.origin == place.origin
        if not known or entry.bytes != folder_size(self.folder / name):
            return None
        return entry.model_copy(update={"index": place.index, "split": place.split})

    def _looked_at(self, name: str) -> SceneEntry | None:
        """The entry of a scene by its files; None where they are damaged or of other renders."""
        if not (self.folder / name).is_dir():
            return None
        try:
            record, sha256 = read_record(self.folder / name)
        except InputError:
            return None  # damaged: it is rendered again
        expected = record.origin if self.planned is None else self.planned[name].origin
        if record.origin != expected or not is_whole(self.folder / name, record):
            return None
        return self._entry(record.scene, sha256, record.origin)

    def _write_record(self) -> None:
        """Write `dataset.json`, again if meanwhile another part has listed more.

        So who writes it last has read the lists of all.
        """
        while True:
            others = self._others()
            self._write_record_with(others)
            if self._others().keys() <= others.keys():
                return

    def _others(self) -> dict[str, SceneEntry | FailedScene]:
        """Scenes, done and failed, that other parts of the same renders have listed, by id."""
        if self.planned is None or self.part.count == 1:
            return {}
        found = listed_of(self.folder, self.part.renders)
        entries = found.done | found.failed
        return {name: entry for name, entry in entries.items() if name not in self.planned}

    def _write_record_with(self, others: Mapping[str, SceneEntry | FailedScene]) -> None:
        order = self.done if self.planned is None else self.planned
        done = [self.done[name] for name in order if name in self.done]
        failed = list(self.failed.values())
        if others:
            done += [entry for entry in others.values() if isinstance(entry, SceneEntry)]
            failed += [entry for entry in others.values() if isinstance(entry, FailedScene)]
            done.sort(key=lambda entry: -1 if entry.index is None else entry.index)
        record = DatasetRecord(
            planned=len(order) if self.planned is None else self.part.in_all,
            renders=self.part.renders,
            scenes=tuple(done),
            failed=tuple(failed),
            **self.about,
        )
        text = json.dumps(record.model_dump(mode="json"), indent=1, allow_nan=False)
        replace_text(self.folder / DATASET, text + "\n")
