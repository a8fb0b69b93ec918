"""Datasets of truths: a folder with `dataset.json` and one folder for each scene.

Scenes are written one at a time and listed at the end, so that memory holds two truths at most,
one that is written and the next, however many there are. A writer that was stopped resumes; scenes
of other renders (another seed, number of samples or variant) are rendered again, because their
`origin` differs.

Everything that is read is checked: `dataset.json` has the hash of every `scene.json`, which has the
hashes of its images; scene ids, which name the folders, are 16 hexadecimal digits, links are not
followed, and sizes are bounded before anything is decoded.
"""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from malus.renderers.datasets.dataset_files import keep_files, with_own_files
from malus.renderers.datasets.dataset_record import DatasetRecord, FailedScene, SceneEntry
from malus.renderers.datasets.scene_folder import (
    SCENE,
    SceneRecord,
    is_whole,
    read_maps,
    read_record,
    read_scene,
    read_sensor,
    write_scene,
)
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import read_json, remove_abandoned, replace_text
from malus.scenes.core.remote import as_path
from malus.scenes.maps import MapName
from malus.scenes.sensor_frame import SensorFrame

DATASET = "dataset.json"
MAX_DATASET_BYTES = 1 << 28
_ID = re.compile(r"[0-9a-f]{16}")


@dataclass(frozen=True)
class Dataset:
    """A dataset on disk, whose truths are read one by one when they are used.

    Attributes
    ----------
    path : Path
    record : DatasetRecord
    sha256 : str
        Hash of `dataset.json`, and through the hashes in it of the whole dataset.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> done = malus.render_dataset("quick", folder, resolution=8, samples=2)
    >>> dataset = malus.open_dataset(folder)
    >>> len(dataset), next(iter(dataset)).stokes.shape
    (16, (8, 8, 3, 3))
    """

    path: Path
    record: DatasetRecord
    sha256: str

    @property
    def scenes(self) -> tuple[str, ...]:
        """Ids of the scenes, in the order in which they were rendered."""
        return tuple(entry.scene for entry in self.record.scenes)

    def __len__(self) -> int:
        """Number of scenes."""
        return len(self.record.scenes)

    def __iter__(self) -> Iterator[Truth]:
        """Read one truth after the other."""
        return map(self.truth, self.scenes)

    def scene(self, scene_id: str) -> SceneRecord:
        """The content of a scene's `scene.json`, without its images.

        Raises
        ------
        InputError
            No such scene, or a `scene.json` with another hash than the dataset records.
        """
        expected_sha256 = self._digests.get(scene_id)
        if expected_sha256 is None:
            expected = f"one of the {len(self)} scenes of {self.path}"
            raise InputError("scene", expected, scene_id, f"see {self.path / DATASET}")
        record, sha256 = read_record(self.path / scene_id)
        if sha256 != expected_sha256:
            where, hint = str(self.path / scene_id / SCENE), "render the dataset again"
            raise InputError(where, f"SHA-256 {expected_sha256}", sha256, hint)
        return record

    @functools.cached_property
    def _digests(self) -> dict[str, str]:
        return {entry.scene: entry.sha256 for entry in self.record.scenes}

    @functools.cached_property
    def _checked(self) -> set[Path]:
        return set()

    def truth(self, scene_id: str) -> Truth:
        """Read the truth of a scene, equal to the bit to the one that was written.

        Raises
        ------
        InputError
            No such scene, or a file of it that is missing, cut or changed.
        """
        self.scene(scene_id)
        truth = read_scene(self.path / scene_id)
        return replace(truth, scene=with_own_files(truth.scene, self.path, self._checked))

    def maps(
        self, scene_id: str, names: Iterable[MapName] | None = None
    ) -> dict[MapName, AnyArray]:
        """Maps (height, width, ...) of a scene by name, by default all; see `scenes.maps`.

        Raises
        ------
        InputError
            No such scene, a map that it has not, or a file that is missing, cut or changed.
        """
        return read_maps(self.path / scene_id, self.scene(scene_id), names)

    def frame(self, scene_id: str) -> SensorFrame:
        """What a polarisation camera makes of a scene; raises InputError where it has none."""
        return read_sensor(self.path / scene_id, self.scene(scene_id))


def open_dataset(folder: Path | str) -> Dataset:
    """Open the dataset in a folder, by path or URL.

    Parameters
    ----------
    folder : path or URL of a folder

    Returns
    -------
    Dataset

    Raises
    ------
    InputError
        If the folder holds none, or its `dataset.json` is malformed.

    Examples
    --------
    >>> import tempfile
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=8))
    >>> folder = tempfile.mkdtemp()
    >>> with DatasetWriter(folder) as writer:
    ...     writer.add(render(scene, renderer="torrance-sparrow"))
    >>> open_dataset(folder).truth(scene.id).scene == scene
    True
    """
    opened = as_path(folder)
    file = opened / DATASET
    content, sha256 = read_json(file, MAX_DATASET_BYTES)
    return Dataset(opened, DatasetRecord.parse(content, str(file)), sha256)


class DatasetWriter:
    """Writes a new dataset or continues one; a context manager that lists the scenes at its end.

    Parameters
    ----------
    folder : path
        Created if it is missing.
    planned : mapping of scene id to origin, optional
        Scenes that the dataset shall hold. Others in the folder, and those of another origin, are
        left out. Without it every scene in the folder is kept.
    about : mapping
        Keys 'suite', 'versions' and 'variant' of `dataset.json`.

    Attributes
    ----------
    done : mapping of scene id to SceneEntry
        Scenes that need not be rendered.
    failed : mapping of scene id to FailedScene
        Scenes that could not be rendered, by this writer or an earlier one of the same origin.
    """

    def __init__(
        self,
        folder: Path | str,
        planned: Mapping[str, str] | None = None,
        about: Mapping[str, Any] | None = None,
    ) -> None:
        self.folder = as_path(folder)
        self.planned = planned
        self.about = dict(about or {})
        self.done: dict[str, SceneEntry] = {}
        self.failed: dict[str, FailedScene] = {}

    def __enter__(self) -> Self:
        """Keep the scenes that the folder already holds."""
        self.folder.mkdir(parents=True, exist_ok=True)
        remove_abandoned(self.folder)
        self.done = dict(self._usable_scenes())
        self.failed = {failure.scene: failure for failure in self._earlier_failures()}
        self._write_record()
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """List the scenes that are done, also after an error."""
        self._write_record()

    def add(self, truth: Truth, origin: str = "") -> None:
        """Write one truth, as a whole or not at all.

        Raises
        ------
        InputError
            If it cannot be written.
        """
        folder = self.folder / truth.scene.id
        write_scene(folder, truth, origin)
        keep_files(truth.scene, self.folder)
        self.done[truth.scene.id] = SceneEntry.of(truth.scene, read_record(folder)[1])
        self.failed.pop(truth.scene.id, None)

    def fail(self, failed: FailedScene) -> None:
        """Record a scene that could not be rendered."""
        self.failed[failed.scene] = failed

    def _earlier_failures(self) -> Iterator[FailedScene]:
        """Failures that an earlier writer of the same origins recorded."""
        try:
            failures = open_dataset(self.folder).record.failed
        except InputError:
            return  # no earlier writer, or a damaged list: what failed is tried again
        for failure in failures:
            same = self.planned is None or self.planned.get(failure.scene) == failure.origin
            if same and failure.scene not in self.done:
                yield failure

    def _usable_scenes(self) -> Iterator[tuple[str, SceneEntry]]:
        """Ids and entries of complete scenes in the folder, of the planned origin."""
        names = sorted(entry.name for entry in self.folder.iterdir())
        for name in names if self.planned is None else self.planned:
            if not _ID.fullmatch(name) or not (self.folder / name).is_dir():
                continue
            try:
                record, sha256 = read_record(self.folder / name)
            except InputError:
                continue  # damaged: it is rendered again
            expected = record.origin if self.planned is None else self.planned[name]
            if record.origin == expected and is_whole(self.folder / name, record):
                yield name, SceneEntry.of(record.scene, sha256)

    def _write_record(self) -> None:
        order = self.done if self.planned is None else self.planned
        entries = tuple(self.done[name] for name in order if name in self.done)
        record = DatasetRecord(
            planned=len(order), scenes=entries, failed=tuple(self.failed.values()), **self.about
        )
        text = json.dumps(record.model_dump(mode="json"), indent=1, allow_nan=False)
        replace_text(self.folder / DATASET, text + "\n")
