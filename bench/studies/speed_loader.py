"""Benchmark of reading a dataset for training: scenes a second, beside reading the EXR files."""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from malus.bench.datasets.export import export
from malus.bench.datasets.render import render_dataset
from malus.bench.studies.study import Findings
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.datasets.opened import open_dataset
from malus.renderers.datasets.samples import DEFAULT_MAPS
from malus.renderers.variant import Variant, choose
from malus.scenes.core.errors import InputError

CROP = 64
"""Side of the crops of the last way, or the whole picture where it is smaller."""


@dataclass(frozen=True)
class LoaderSpeed:
    """Reading every scene of a dataset `epochs` times, in one process, from a warm disk cache.

    `kilobytes_grown` is how much the largest memory of the process grew from the first epoch to
    the last.
    """

    way: str
    scenes: int
    items_a_second: float
    times_plain: float
    kilobytes_grown: int


def findings(folder: Path | None, resolution: int, epochs: int, backend: str) -> Findings:
    """Run the benchmark on a dataset of so many pixels a side."""
    speeds = compare(choose(backend), resolution, epochs)
    return Findings(tuple(report_lines(speeds)), [asdict(speed) for speed in speeds])


def compare(variant: Variant, resolution: int, epochs: int) -> list[LoaderSpeed]:
    """Render a dataset, export it, and read it in every way that users have.

    The arrays are the same in every way: image, Stokes image, mask and normals of three bands.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        render_dataset("quick", folder / "dataset", variant, resolution=resolution, samples=4)
        dataset = open_folder(folder / "dataset")
        ways: dict[str, Callable[[], Iterator[Any]]] = {
            "EXR files, plainly": lambda: _plainly(dataset),
            "dataset": lambda: iter(dataset.samples()),
        }
        for form in ("hdf5", "webdataset"):
            try:
                export(dataset, form, folder / form)
            except InputError:
                continue  # h5py is optional
            ways[form] = partial(_samples, folder / form)
        crop = min(CROP, resolution)
        ways[f"webdataset, {crop}² crops"] = partial(_samples, folder / "webdataset", crop)
        return _measured(ways, epochs)


def _samples(folder: Path, crop: int | None = None) -> Iterator[Any]:
    return iter(open_dataset(folder, maps=DEFAULT_MAPS, crop=crop))


def _measured(ways: dict[str, Callable[[], Iterator[Any]]], epochs: int) -> list[LoaderSpeed]:
    speeds: list[LoaderSpeed] = []
    for way, read in ways.items():
        count = sum(1 for _ in read())  # the first epoch opens files and fills the disk cache
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        started = time.perf_counter()
        for _ in range(epochs):
            for _ in read():
                pass
        rate = epochs * count / (time.perf_counter() - started)
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory
        plain = speeds[0].items_a_second if speeds else rate
        speeds.append(LoaderSpeed(way, count, rate, rate / plain, grown))
    return speeds


def _plainly(dataset: Dataset) -> Iterator[dict[str, Any]]:
    """The same arrays by OpenEXR alone, as a script of a few lines would read them."""
    import OpenEXR

    for scene in dataset.scenes:
        with OpenEXR.File(str(dataset.path / scene / "stokes.exr"), separate_channels=True) as file:
            planes = {name: channel.pixels for name, channel in file.channels().items()}
        bands = sorted(name.split(".", 1)[1] for name in planes if name.startswith("S0."))
        stokes = np.stack(
            [np.stack([planes[f"S{k}.{band}"] for k in range(3)], axis=-1) for band in bands],
            axis=2,
        )
        path = str(dataset.path / scene / "geometry.exr")
        with OpenEXR.File(path, separate_channels=True) as file:
            planes = {name: channel.pixels for name, channel in file.channels().items()}
        normals = np.stack([planes[f"normals.{axis}"] for axis in "XYZ"], axis=-1)
        mask = planes["mask"] != 0
        yield {"image": stokes[..., 0], "stokes": stokes, "mask": mask, "normals": normals}


def report_lines(speeds: list[LoaderSpeed]) -> Iterator[str]:
    """One line a way."""
    for speed in speeds:
        yield (
            f"{speed.way}: {speed.items_a_second:.0f} scenes a second, "
            f"{speed.times_plain:.1f} times EXR plainly; memory grew by "
            f"{speed.kilobytes_grown} kB over the epochs"
        )
