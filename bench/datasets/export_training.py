"""Formats that training loops read: WebDataset shards, and one HDF5 file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from malus.bench.running.progress import Progress
from malus.renderers.datasets.dataset import Dataset
from malus.renderers.datasets.dataset_record import CONVENTIONS
from malus.renderers.datasets.hdf5 import write_hdf5
from malus.renderers.datasets.samples import WHOLE
from malus.renderers.datasets.shards import ShardScene, write_shards

SHARDS_WORDS = CONVENTIONS | {
    "<scene>.<array>.npy": "arrays of a scene, float32, bool or uint16, rows from the top; stokes"
    " (height, width, bands, 3), normals (height, width, 3), mask (height, width)",
    "<scene>.scene.json": "the scene: shape, surface, light, camera, bands",
}
HDF5_WORDS = CONVENTIONS | {
    "<array>": "one HDF5 dataset an array, (scenes, height, width, ...), a chunk a scene; stokes"
    " (scenes, height, width, bands, 3)",
    "scene, scene_json": "id and description of every scene",
}


def write_webdataset(dataset: Dataset, folder: Path, progress: Progress) -> None:
    """Write all scenes of a dataset as WebDataset shards."""
    write_shards(folder, _scenes(dataset, progress), {"splits": splits_of(dataset)})


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
    maps = [name for name in source.maps if name != "image"]
    for number, scene in enumerate(dataset.scenes):
        progress(number, len(dataset), scene)
        description: dict[str, Any] = dataset.scene(scene).scene.model_dump(mode="json")
        yield ShardScene(scene, source.read(number, maps, WHOLE), description)
