"""Lists of what each part of a dataset has so far: a line a scene, added when it is written.

A dataset is made in one part or in several, at once or one after the other, by processes that need
not know of each other. Each adds to a list of its own, `parts/3-of-16.jsonl`; `dataset.json` is
made of all lists. Who resumes reads the lists and not every scene. In a store elsewhere, where
nothing can be added to a file, a list is written when its part ends.
"""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, TextIO

from pydantic import Field, ValidationError, model_validator

from malus.renderers.datasets.dataset_record import MAX_DATASET_BYTES, FailedScene, SceneEntry
from malus.scenes.core.errors import InputError, first_line
from malus.scenes.core.files import read_bounded, replace_text
from malus.scenes.core.model import Model
from malus.scenes.core.remote import is_here
from malus.scenes.core.result_files import PARTS
from malus.scenes.random_suite.splits import SplitName

_NAME = re.compile(r"[0-9]+-of-[0-9]+\.jsonl")


@dataclass(frozen=True)
class PlannedScene:
    """A scene that a dataset shall hold.

    Attributes
    ----------
    origin : str
        Name of the renders that it shall come from.
    index : int or None
        Its number in the suite, by which scenes are listed.
    split : str or None
    """

    origin: str
    index: int | None = None
    split: SplitName | None = None


class Part(Model):
    """One of several parts of a dataset, and the first line of its list.

    Attributes
    ----------
    number, count : int
        This one, from 1, and how many there are.
    planned : int
        Scenes of this part; in all parts together there are `in_all`.
    renders : str
        Hash of what decides the scenes of all parts and their images.

    Examples
    --------
    >>> Part(number=3, count=16, planned=5, in_all=80).label
    '3/16'
    """

    format: Literal["malus part 1"] = "malus part 1"
    number: int = Field(default=1, ge=1)
    count: int = Field(default=1, ge=1, le=1_000_000)
    planned: int = Field(default=0, ge=0)
    in_all: int = Field(default=0, ge=0)
    renders: str = Field(default="", max_length=64)

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if self.number > self.count:
            raise ValueError(f"a number of at most {self.count}")
        return self

    @property
    def label(self) -> str:
        """Number and count."""
        return f"{self.number}/{self.count}"


@dataclass
class PartContent:
    """What a list tells: the part, and its scenes that are done and that failed, by their ids."""

    part: Part
    done: dict[str, SceneEntry] = field(default_factory=dict)
    failed: dict[str, FailedScene] = field(default_factory=dict)

    def add(self, entry: SceneEntry | FailedScene) -> None:
        """Count a scene as done or as failed, whatever it was."""
        self.done.pop(entry.scene, None)
        self.failed.pop(entry.scene, None)
        if isinstance(entry, SceneEntry):
            self.done[entry.scene] = entry
        else:
            self.failed[entry.scene] = entry

    def add_all(self, failed: Iterable[FailedScene], done: Iterable[SceneEntry]) -> None:
        """Count scenes as failed, and others as done."""
        for failure in failed:
            self.add(failure)
        for entry in done:
            self.add(entry)


class PartList:
    """Adds to the list of a part; a context manager.

    A list of other renders in its place is replaced.
    """

    def __init__(self, folder: Path, part: Part) -> None:
        self.path = _path(folder, part)
        self.part = part
        self.earlier = PartContent(part)
        self._file: TextIO | None = None

    def __enter__(self) -> Self:
        """Begin the list, or go on with one of the same part."""
        while True:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            try:
                self._begin()
                return self
            except (InputError, OSError) as error:
                # Who made the dataset whole may have removed the empty folder at this moment.
                if not isinstance(error.__cause__ or error, FileNotFoundError):
                    raise

    def _begin(self) -> None:
        earlier = read_part(self.path)
        if earlier is not None and earlier.part == self.part:
            self.earlier = earlier
        else:
            replace_text(self.path, _line(self.part))
        if is_here(self.path):
            self._file = self.path.open("a", encoding="utf-8")
            self._append("\n")  # a killed process may have left half a line

    def add(self, entry: SceneEntry | FailedScene) -> None:
        """Add a scene that is done or that failed.

        Raises
        ------
        InputError
            Where there is no room.
        """
        self.earlier.add(entry)
        if self._file is not None:
            self._append(_line(entry))

    def _append(self, line: str) -> None:
        assert self._file is not None
        try:
            self._file.write(line)
            self._file.flush()
        except OSError as error:
            found, hint = first_line(error), "mend that and give the command again"
            raise InputError(str(self.path), "a file that can be written", found, hint) from error

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Write what is left, also after an error."""
        if self._file is not None:
            with contextlib.suppress(OSError):  # `add` has told
                self._file.close()
            return
        entries = (*self.earlier.done.values(), *self.earlier.failed.values())
        replace_text(self.path, "".join(map(_line, (self.part, *entries))))


def remove_lists(folder: Path, parts: Iterable[Part]) -> None:
    """Remove the lists of parts that `dataset.json` lists, and their folder when it is empty."""
    for part in parts:
        with contextlib.suppress(OSError):
            _path(folder, part).unlink()
    with contextlib.suppress(OSError):  # others are left
        (folder / PARTS).rmdir()


def _path(folder: Path, part: Part) -> Path:
    return folder / PARTS / f"{part.number}-of-{part.count}.jsonl"


def read_parts(folder: Path) -> Iterator[PartContent]:
    """What the lists in a folder tell; damaged lines count as not written."""
    try:
        names = sorted(path.name for path in (folder / PARTS).iterdir())
    except (FileNotFoundError, NotADirectoryError):
        return
    for name in filter(_NAME.fullmatch, names):
        content = read_part(folder / PARTS / name)
        if content is not None:
            yield content


def read_part(path: Path) -> PartContent | None:
    """What a list tells; None where there is none, or it is none of ours."""
    try:
        lines = read_bounded(path, MAX_DATASET_BYTES).decode("utf-8", "replace").split("\n")
        content = PartContent(Part.model_validate_json(lines[0]))
    except (InputError, ValueError, IndexError):
        return None
    for line in lines[1:]:
        try:
            values = json.loads(line)
            kind = FailedScene if "reason" in values else SceneEntry
            content.add(kind.model_validate(values))
        except (ValidationError, ValueError, TypeError):
            continue  # cut short when its process was killed: that scene is looked at itself
    return content


def _line(entry: Model) -> str:
    return entry.model_dump_json() + "\n"
