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
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, SupportsIndex

from malus.renderers.datasets.dataset_files import with_own_files
from malus.renderers.datasets.dataset_record import (
    DATASET,
    DatasetRecord,
    read_dataset,
)
from malus.renderers.datasets.hdf5 import HDF5
from malus.renderers.datasets.samples import Samples, scenes_of
from malus.renderers.datasets.scene_folder import (
    SCENE,
    SceneRecord,
    read_maps,
    read_record,
    read_scene,
    read_sensor,
)
from malus.renderers.datasets.scene_samples import SceneFolders
from malus.renderers.datasets.shards import SHARDS
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.remote import as_path
from malus.scenes.maps import MapName
from malus.scenes.sensor_frame import SensorFrame


@dataclass(frozen=True)
class Dataset:
    """A dataset on disk, whose truths are read one by one when they are used.

    Attributes
    ----------
    path : Path
        Its folder.
    record : DatasetRecord
        What its `dataset.json` says: the suite, the variant, every scene.
    sha256 : str
        Hash of `dataset.json`, and through the hashes in it of the whole dataset.
    part_of : Dataset or None
        The whole, where this one was reduced to a split; see `whole`.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> done = malus.render_dataset("quick", folder, resolution=8, samples=2)
    >>> dataset = malus.open_dataset(folder)
    >>> len(dataset), dataset[0]["stokes"].shape
    (16, (8, 8, 3, 3))
    """

    path: Path
    record: DatasetRecord
    sha256: str
    part_of: Dataset | None = None

    def __repr__(self) -> str:
        """Folder and number of scenes, in one line."""
        return f"Dataset({str(self.path)!r}, {len(self)} scenes)"

    @property
    def whole(self) -> Dataset:
        """The dataset with the scenes of all splits, by whose order layouts number the scenes."""
        return self.part_of or self

    @property
    def scenes(self) -> tuple[str, ...]:
        """Ids of the scenes, in the order in which they were rendered."""
        return tuple(entry.scene for entry in self.record.scenes)

    def check_begun(self) -> None:
        """Raise InputError where no scene is listed; those of a render that was killed are kept."""
        if not self.scenes:
            hint = "`malus render` with the same suite and folder goes on with it"
            raise InputError(str(self.path), "a dataset with scenes", "none listed yet", hint)

    def __len__(self) -> int:
        """Number of scenes."""
        return len(self.record.scenes)

    @property
    def splits(self) -> dict[str, list[str]]:
        """Ids of the scenes of each split; empty where the dataset was not split."""
        splits: dict[str, list[str]] = {}
        for entry in self.record.scenes:
            if entry.split is not None:
                splits.setdefault(entry.split, []).append(entry.scene)
        return splits

    def of_split(self, split: str) -> Dataset:
        """The same dataset with the scenes of a split alone.

        Raises
        ------
        InputError
            If it has no such split.
        """
        chosen = scenes_of(split, self.splits)
        entries = tuple(entry for entry in self.record.scenes if entry.scene in chosen)
        record = self.record.model_copy(update={"scenes": entries})
        return replace(self, record=record, part_of=self.whole)

    def samples(
        self,
        split: str | None = None,
        maps: Sequence[str] | str | None = None,
        crop: int | None = None,
        seed: int = 0,
    ) -> Samples:
        """Scenes as dictionaries of arrays for training, see `malus.open_dataset`.

        Raises
        ------
        InputError
            A split or an array that the dataset does not have, or a crop larger than its pictures.
        """
        self.check_begun()
        source = SceneFolders(self.path, self.scenes, self.splits, self.scene)
        return Samples.of(source, split, maps, crop, seed)

    def __getitem__(self, index: SupportsIndex) -> dict[str, Any]:
        """Image, Stokes image, mask and normals of the scene of that number."""
        return self._samples[index]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Image, Stokes image, mask and normals of one scene after the other."""
        return iter(self._samples) if self.scenes else iter(())

    def set_epoch(self, epoch: int) -> None:
        """Change nothing: only crops differ from epoch to epoch, and a whole dataset has none."""
        self._samples.set_epoch(epoch)

    def truths(self) -> Iterator[Truth]:
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
    def _samples(self) -> Samples:
        return self.samples()

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


def open_folder(folder: Path | str) -> Dataset:
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
        If the folder holds none, or an export of one, or its `dataset.json` is malformed.

    Examples
    --------
    >>> import tempfile
    >>> from malus.renderers import render
    >>> from malus.scenes import Camera, Dielectric, Distant, Scene, Sphere
    >>> scene = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3, body="unpolarised"),
    ...               light=Distant(incidence_deg=60), camera=Camera(resolution=8))
    >>> folder = tempfile.mkdtemp()
    >>> from malus.renderers.datasets.dataset_writer import DatasetWriter
    >>> with DatasetWriter(folder) as writer:
    ...     writer.add(render(scene, renderer="torrance-sparrow"))
    >>> open_folder(folder).truth(scene.id).scene == scene
    True
    """
    opened = as_path(folder)
    if not (opened / DATASET).exists() and any((opened / name).exists() for name in (SHARDS, HDF5)):
        expected, hint = "the folder of a dataset", "give the folder it was made of"
        raise InputError(str(folder), expected, "its export", hint)
    return Dataset(opened, *read_dataset(opened))
