"""Captures to fit and score together, and their methods, as a TOML file names them."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, model_validator

from malus.reconstruct.learned.net import is_network
from malus.reconstruct.photos.capture import Capture, read_capture
from malus.reconstruct.photos.masks_and_normals import read_labels, read_mask
from malus.scenes.core.arrays import BoolArray
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.model import Model
from malus.scenes.core.registry import FolderName, several

MAX_BYTES = 1 << 20
METHODS = ("paper", "blind", "net")
"""What is run where no method is named."""

_LONGEST_NAME = 100


class CaptureEntry(Model):
    """One capture of a suite: where its pictures are, how they are read, and what is seen on them.

    All but `name`, `group`, `mask` and `labels` is what `malus.read_capture` takes.

    Attributes
    ----------
    folder : path of the pictures, or of one file that holds them
    name : what it is called in tables; by default the folder's name
    group : such as "indoor"; groups stand apart in Table I and Figure 9
    mask : path of a picture of its size, lighter than half where the object is
    labels : in place of `mask`, path of a label image: one value an object, black is none

    Examples
    --------
    >>> CaptureEntry(folder="photos/kettle", zero="horizontal", group="indoor").called
    'kettle'
    """

    folder: str = Field(min_length=1)
    name: str = Field(default="", max_length=_LONGEST_NAME)
    group: str = Field(default="captures", min_length=1, max_length=100)
    mask: str | None = Field(default=None, min_length=1)
    labels: str | None = Field(default=None, min_length=1)
    zero: Literal["vertical", "horizontal"] | None = None
    sense: Literal["anticlockwise", "clockwise"] = "anticlockwise"
    offset: float = 0.0
    angles: tuple[float, ...] | None = None
    unit: Literal["degrees", "radians"] | None = None
    linear: bool = False
    black: float | str | None = None
    white: float | None = None
    mosaic: tuple[float, ...] | None = None
    bayer: Literal["rggb", "bggr", "grbg", "gbrg"] | None = None
    size: tuple[int, int] | None = None
    packing: str | None = None

    @model_validator(mode="after")
    def _one_mask(self) -> Self:
        if self.mask is not None and self.labels is not None:
            raise ValueError("a `mask` of one object, or `labels` of several, not both")
        return self

    @property
    def called(self) -> str:
        """Name in tables."""
        return self.name or Path(self.folder).resolve().name or self.folder

    def from_folder(self, folder: Path) -> CaptureEntry:
        """The same entry with paths that are found from a folder."""
        changes: dict[str, Any] = {
            key: str(folder / value)
            for key in ("folder", "mask", "labels")
            if (value := getattr(self, key)) is not None
        }
        if isinstance(self.black, str) and (folder / self.black).exists():
            changes["black"] = str(folder / self.black)
        return self.model_copy(update=changes)

    def read(self) -> Capture:
        """The pictures, as `malus.read_capture` reads them.

        Raises
        ------
        InputError
            From `read_capture`.
        """
        keys = ("zero", "sense", "linear", "angles", "unit", "black", "white", "mosaic")
        told = {key: getattr(self, key) for key in (*keys, "bayer", "size", "packing")}
        return read_capture(self.folder, offset_deg=self.offset, **told)

    def objects(self, shape: tuple[int, int]) -> tuple[BoolArray, ...]:
        """Masks (height, width) of its objects; the whole picture where none is given.

        Raises
        ------
        InputError
            From `read_mask` or `read_labels`.
        """
        if self.labels is not None:
            labels = read_labels(self.labels, shape)
            return tuple(labels == number for number in range(1, int(labels.max()) + 1))
        if self.mask is not None:
            return (read_mask(self.mask, shape),)
        import numpy as np

        return (np.ones(shape, dtype=bool),)


class CaptureSuite(Model):
    """Captures that are fitted and scored together, and the methods that reconstruct them.

    Attributes
    ----------
    name : what the results are called
    description : one line about them
    methods : names of methods, or `package.module:object`
    capture : tuple of CaptureEntry
        In a TOML file, a `[[capture]]` each.

    Examples
    --------
    >>> suite = CaptureSuite(capture=(CaptureEntry(folder="kettle"), CaptureEntry(folder="car")))
    >>> [entry.called for entry in suite.capture], suite.methods
    (['kettle', 'car'], ('paper', 'blind', 'net'))
    """

    name: FolderName = Field(default="captures", min_length=1, max_length=100)
    description: str = ""
    methods: tuple[str, ...] = Field(default=METHODS, min_length=1)
    capture: tuple[CaptureEntry, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        counts = Counter(entry.called for entry in self.capture)
        name, count = counts.most_common(1)[0]
        if count > 1:
            raise ValueError(f"captures of different names: give each `{name}` a `name` of its own")
        return self

    @classmethod
    def of_folders(
        cls, folders: Sequence[Path | str], methods: Sequence[str] = (), **told: Any
    ) -> CaptureSuite:
        """A suite of folders or files that are all read alike; `told` are keys of `CaptureEntry`.

        Folders of one name, such as morning/kettle and evening/kettle, are called by their paths.

        Raises
        ------
        InputError
            A value that is not valid, or folders of one name.
        """
        counts = Counter(Path(folder).resolve().name for folder in folders)
        shared = {folder for folder in folders if counts[Path(folder).resolve().name] > 1}
        entries = tuple(
            {"folder": str(folder), "name": _end_of(folder) if folder in shared else "", **told}
            for folder in folders
        )
        content = {"capture": entries, "methods": several(methods) or METHODS}
        return cls.parse(content, "captures")


def _end_of(folder: Path | str) -> str:
    """As much of a folder's path as a name may be long."""
    return str(Path(folder))[-_LONGEST_NAME:]


def load_captures(path: Path | str) -> CaptureSuite:
    """Read a suite of captures from a TOML file; paths in it are found from its folder.

    Parameters
    ----------
    path : path of a TOML file

    Returns
    -------
    CaptureSuite
        The captures and methods that the file names.

    Raises
    ------
    InputError
        An unreadable file, a wrong key or value.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "two.toml"
    >>> _ = path.write_text('''
    ... name = "two"
    ... [[capture]]
    ... folder = "kettle"
    ... zero = "horizontal"
    ... group = "indoor"
    ... [[capture]]
    ... folder = "lake"
    ... group = "outdoor"
    ... ''')
    >>> suite = load_captures(path)
    >>> [entry.group for entry in suite.capture], suite.capture[0].folder.startswith("/")
    (['indoor', 'outdoor'], True)
    """
    path = Path(path)
    where, hint = str(path), "guides/captures.md shows one"
    with reading(where, "a readable TOML file of captures", hint):
        if path.is_file() and path.stat().st_size > MAX_BYTES:
            raise InputError(where, f"at most {MAX_BYTES} bytes", "more", hint)
        data = tomllib.loads(path.read_text("utf-8-sig"))
    suite = CaptureSuite.parse(data, where)
    entries = tuple(entry.from_folder(path.absolute().parent) for entry in suite.capture)
    methods = tuple(_found_from(path.parent, reference) for reference in suite.methods)
    return suite.model_copy(update={"capture": entries, "methods": methods})


def _found_from(folder: Path, reference: str) -> str:
    """A method `net:FILE` with the file found from a folder; a file may stand where one is, too."""
    kind, _, file = reference.partition(":")
    if not (file and is_network(reference)):
        return reference
    is_here_alone = Path(file).exists() and not (folder / file).exists()
    return reference if is_here_alone else f"{kind}:{folder / file}"
