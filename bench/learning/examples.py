"""Pictures of a dataset in memory: the Stokes vectors of three channels, and the mask."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from malus.bench.learning.options import SMALLEST
from malus.bench.running.progress import Progress
from malus.bench.running.worker_process import WorkerProcess
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.scenes.core.arrays import AnyArray, BoolArray, Float64Array, IntArray
from malus.scenes.core.cores import usable_cores
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import angle_weights

MEMORY = 8e9
"""Bytes that the pictures of a split may take; of a larger one a part is drawn at random."""

ALONE = 150
"""Scenes that one process has read before others would have started."""

_WORKERS = 8
_LARGEST = 6e4
"""Largest number that half precision holds, nearly."""

HINT = "render a suite with [random] and [splits], such as random"


class Examples(NamedTuple):
    """Pictures of one split.

    `light` (count, height, width, 3, 3), half precision: Stokes vectors of the channels red, green,
    blue, over the mean of s0 over the valid pixels of all channels; `mask` (count, height, width);
    `noise` (count,): what the truth's own noise adds to both sums of squares of
    `objective.Sums`.
    """

    light: AnyArray
    mask: BoolArray
    noise: Float64Array


def splits_of(dataset: Dataset) -> dict[str, int]:
    """Number of scenes of each split.

    Raises
    ------
    InputError
        Unless the dataset has `train` and `val`, and pictures of three bands that are large enough.
    """
    counts: dict[str, int] = {}
    for entry in dataset.record.scenes:
        if entry.split is not None:
            counts[entry.split] = counts.get(entry.split, 0) + 1
    missing = [name for name in ("train", "val") if not counts.get(name)]
    if missing:
        found = f"no scenes of {' and '.join(missing)}"
        raise InputError(str(dataset.path), "a dataset with splits train and val", found, HINT)
    first = dataset.scene(dataset.scenes[0])
    bands = first.scene.wavelengths_nm
    if len(bands) != 3:
        hint = "render the suite in three bands"
        raise InputError(str(dataset.path), "pictures of three bands", f"{len(bands)}", hint)
    height, width = first.shape
    if min(height, width) < SMALLEST:
        expected, hint = (
            f"at least {SMALLEST} pixels a side",
            "render the suite in a higher resolution",
        )
        raise InputError(str(dataset.path), expected, f"{width} × {height}", hint)
    return counts


def read_examples(
    dataset: Dataset,
    split: str,
    seed: int,
    progress: Progress,
    side: int | None = None,
    memory: float = MEMORY,
) -> Examples:
    """Read the pictures of a split, in several processes where there are many.

    Parameters
    ----------
    side : int, optional
        Pixels a side that they are reduced to, see `TrainingOptions`.

    Raises
    ------
    InputError
        A damaged dataset, pictures of different sizes or bands, or no light in any; a side that
        does not divide theirs.
    """
    numbers = np.arange(sum(entry.split == split for entry in dataset.record.scenes))
    rendered = dataset.scene(dataset.scenes[0]).shape
    factor = _factor(rendered, side)
    height, width = (length // factor for length in rendered)
    most = max(1, int(memory // (19 * height * width)))  # nine halves and the mask
    if len(numbers) > most:
        numbers = np.sort(np.random.default_rng(seed).choice(numbers, most, replace=False))
    light = np.zeros((len(numbers), height, width, 3, 3), np.float16)
    mask, noise = np.zeros((len(numbers), height, width), bool), np.zeros(len(numbers))
    for done, (place, one, valid, power) in enumerate(
        _in_processes(dataset.path, split, numbers, factor)
    ):
        progress(done, len(numbers), f"reading {split}")
        light[place], mask[place], noise[place] = one, valid, power
    return Examples(light, mask, noise)


def _factor(shape: tuple[int, int], side: int | None) -> int:
    """How many pixels along a side become one."""
    if side is None:
        return 1
    if any(length % side for length in shape) or shape[0] != shape[1]:
        expected = f"a divisor of the pictures' sides, {shape[1]} × {shape[0]} pixels"
        raise InputError("side", expected, f"{side}", "choose another, or leave it out")
    return shape[0] // side


_One = tuple[int, AnyArray, BoolArray, float]
"""Position of a picture, its light, its mask and the power of its noise."""


def _in_processes(folder: Path, split: str, numbers: IntArray, factor: int) -> Iterator[_One]:
    """Pictures in any order, each with its position in `numbers`."""
    places = np.arange(len(numbers))
    if len(numbers) <= ALONE:
        yield from read_some(folder, split, places, numbers, factor)
        return
    count = min(_WORKERS, usable_cores())
    parts = [(places[k::count], numbers[k::count]) for k in range(count)]
    with ThreadPoolExecutor(count) as pool:
        for part in pool.map(lambda part: _in_one(folder, split, part[0], part[1], factor), parts):
            yield from part


def _in_one(
    folder: Path, split: str, places: IntArray, numbers: IntArray, factor: int
) -> list[_One]:
    with WorkerProcess() as worker:
        return list(worker.stream(read_some, folder, split, places, numbers, factor))


def read_some(
    folder: Path, split: str, places: IntArray, numbers: IntArray, factor: int
) -> Iterator[_One]:
    """Pictures of those numbers in a split, one after the other; `factor`² pixels become one."""
    dataset = open_folder(folder)
    samples = dataset.samples(split, maps=("stokes", "mask", "standard_error"))
    rendered = dataset.scene(dataset.scenes[0]).shape
    for place, number in zip(places, numbers, strict=True):
        sample = samples[int(number)]
        if (shape := sample["mask"].shape) != rendered:
            where, hint = f"scene {sample['scene']}", "render all in one resolution"
            expected = f"{rendered[1]} × {rendered[0]} pixels, as the first scene has"
            raise InputError(where, expected, f"{shape[1]} × {shape[0]}", hint)
        bands = dataset.scene(sample["scene"]).scene.wavelengths_nm
        if len(bands) != 3:
            where, hint = f"scene {sample['scene']}", "render it in three bands"
            raise InputError(where, "three bands", f"{len(bands)}", hint)
        order = np.argsort(bands)[::-1]  # red first
        stokes = averaged(_clean(sample["stokes"][:, :, order]), factor)
        mask = averaged(sample["mask"], factor) == 1.0
        power = noise_power(averaged_errors(sample["standard_error"], factor), mask)
        noise = power / (mean_light(stokes, mask) or 1.0) ** 2
        yield int(place), normalised(stokes, mask), mask, noise


def averaged(plane: AnyArray, factor: int) -> AnyArray:
    """Means over squares of `factor`² pixels of a plane (height, width, ...), in float32.

    Examples
    --------
    >>> averaged(np.array([[1.0, 3.0], [5.0, 7.0]]), 2).tolist()
    [[4.0]]
    """
    if factor == 1:
        return plane
    height, width = (length // factor for length in plane.shape[:2])
    squares = plane.reshape(height, factor, width, factor, *plane.shape[2:])
    return squares.mean(axis=(1, 3), dtype=np.float32)


def averaged_errors(standard_error: AnyArray, factor: int) -> AnyArray:
    """Standard errors of means over squares of `factor`² pixels, whose errors are independent.

    Examples
    --------
    >>> averaged_errors(np.full((2, 2), 0.5), 2).tolist()
    [[0.25]]
    """
    return np.sqrt(averaged(np.square(standard_error), factor)) / factor


def noise_power(standard_error: AnyArray, mask: BoolArray) -> float:
    """Expected mean square over the paper's angles of s1, s2 that are noise, summed over the mask.

    Parameters
    ----------
    standard_error : (height, width, bands, 3) array
    mask : (height, width) array of bool

    Examples
    --------
    >>> noise_power(np.zeros((1, 1, 3, 3)), np.ones((1, 1), bool))
    0.0
    """
    # s1 and s2 vary independently, nearly; what is not finite is no light, see `normalised`.
    variance = np.square(np.nan_to_num(standard_error[mask][..., 1:], posinf=0.0), dtype=np.float64)
    return float((variance * np.diag(angle_weights())[1:]).sum())


def mean_light(stokes: AnyArray, mask: BoolArray) -> float:
    """Mean of s0 over the valid pixels and channels; 0 without light."""
    light = _clean(stokes)[mask][..., 0]
    return float(light.mean(dtype=np.float64)) if light.size else 0.0


def _clean(stokes: AnyArray) -> AnyArray:
    """Stokes vectors, black where they are not finite or s0 is negative."""
    valid = np.isfinite(stokes).all(axis=-1, keepdims=True) & (stokes[..., :1] >= 0)
    return np.where(valid, stokes, 0.0)


def normalised(stokes: AnyArray, mask: BoolArray) -> AnyArray:
    """Stokes vectors over the mean of s0 in the mask, in half precision.

    Light off the mask stays: pixels on edges lie there, which a photograph shows too. Light that is
    not finite or negative counts as none.

    Examples
    --------
    >>> normalised(np.full((1, 1, 3, 3), 4.0), np.ones((1, 1), bool))[0, 0, 0].tolist()
    [1.0, 1.0, 1.0]
    """
    mean = mean_light(stokes, mask)
    if mean <= 0:
        return np.zeros(stokes.shape, np.float16)
    light = _clean(stokes) / mean
    brightest = np.maximum(light[..., :1] / _LARGEST, 1.0)
    return (light / brightest).astype(np.float16)
