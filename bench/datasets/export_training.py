"""Formats that training loops read: WebDataset shards, and one HDF5 file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from malus.bench.running.progress import Progress
from malus.renderers.datasets.dataset import Dataset
from malus.renderers.datasets.dataset_record import CONVENTIONS
from malus.renderers.datasets.hdf5 import OTHER_FORMAT, h5py, write_hdf5
from malus.renderers.datasets.planes import S3
from malus.renderers.datasets.samples import whole
from malus.renderers.datasets.scene_samples import arrays_of
from malus.renderers.datasets.shards import ShardScene, write_shards
from malus.scenes.core.errors import InputError

SHARDS_WORDS = CONVENTIONS | {
    "<scene>.<array>.npy": "arrays of a scene, float32, bool, uint16 or, the map eta, complex64;"
    " rows from the top; stokes (height, width, bands, 3), normals (height, width, 3), mask"
    " (height, width); of a polarisation camera sensor (height, width, channels, 3), a Stokes"
    " image, and raw (height, width, frames), digital numbers",
    "<scene>.scene.json": "the scene: shape, surface, light, camera, bands; sensor, exposure and"
    " channels of raw where there is one",
}
HDF5_WORDS = CONVENTIONS | {
    "<array>": "one HDF5 dataset an array, (scenes, height, width, ...), a chunk a scene; stokes"
    " (scenes, height, width, bands, 3)",
    "scene, scene_json": "id and description of every scene",
}


def write_webdataset(dataset: Dataset, folder: Path, progress: Progress) -> None:
    """Write all scenes of a dataset as WebDataset shards."""
    write_shards(folder, _scenes(dataset, progress), {"splits": splits_of(dataset)})


def check_alike(dataset: Dataset) -> None:
    """Raise InputError where the arrays of two scenes differ, which no single HDF5 file holds."""
    h5py()
    expected: tuple[Any, ...] = ()
    for scene in dataset.scenes:
        record = dataset.scene(scene)
        kind = record.shape, len(record.scene.wavelengths_nm), arrays_of(record)
        expected = expected or kind
        if kind != expected:
            found = "another size, or other bands or arrays"
            raise InputError(f"scene {scene}", "what the first scene has", found, OTHER_FORMAT)


def write_one_hdf5(dataset: Dataset, folder: Path, progress: Progress) -> None:
    """Write all scenes of a dataset as one HDF5 file."""
    about = {"splits": splits_of(dataset), "conventions": CONVENTIONS}
    write_hdf5(folder, len(dataset), _scenes(dataset, progress), about)


def splits_of(dataset: Dataset) -> dict[str, list[str]]:
    """Ids of the scenes of each split of a dataset."""
    source = dataset.samples().source
    return {split: list(scenes) for split, scenes in source.splits.items()}


def _scenes(dataset: Dataset, progress: Progress) -> Iterator[ShardScene]:
    """Every scene with all its arrays; the picture is s0 of the Stokes image."""
    source = dataset.samples().source
    # It is zero wherever no scene has it.
    circular = any(S3 in dataset.scene(scene).dtypes for scene in dataset.scenes)
    left_out = ("image",) if circular else ("image", S3)
    for number, scene in enumerate(dataset.scenes):
        progress(number, len(dataset), scene)
        record = dataset.scene(scene)
        maps = [name for name in arrays_of(record) if name not in left_out]
        description: dict[str, Any] = record.scene.model_dump(mode="json")
        if record.sensor is not None:
            description["sensor"] = record.sensor.model_dump(mode="json")
        yield ShardScene(scene, source.read(number, maps, whole), description)
