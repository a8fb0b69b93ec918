"""Scenes of a dataset as named arrays, for training: by index, lazily, in any process.

A source (folders of scenes, shards, one HDF5 file) reads arrays of one scene; `Samples` chooses
scenes of a split, arrays, and crops. It has a length and is indexed, which is all that a PyTorch
DataLoader asks for, and holds no open file when it is sent to another process.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, SupportsIndex, get_args

import numpy as np

from malus.scenes.core.arrays import AnyArray, IntArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.registry import lookup, several
from malus.scenes.random_suite.splits import SplitName

DEFAULT_MAPS = ("image", "stokes", "mask", "normals")
"""Arrays of a sample unless others are asked for: what a network sees, and what it shall tell."""

RAW = "raw"
"""Digital numbers (height, width, frames) of a polarisation camera, behind its mosaic."""

MOSAIC_STEP = 4
"""Pixels after which a mosaic repeats, that of polarisers under a Bayer pattern too."""

Window = tuple[slice, slice]
"""Rows and columns of a picture."""

Cut = Callable[[Sequence[int]], Window]
"""The window of a picture of some height and width; the same whenever it is asked."""


def whole(_shape: Sequence[int]) -> Window:
    """All rows and columns."""
    return slice(None), slice(None)


class SampleSource(Protocol):
    """Where the arrays of scenes come from."""

    @property
    def ids(self) -> Sequence[str]:
        """Ids of the scenes, in the order of the dataset."""

    @property
    def maps(self) -> Sequence[str]:
        """Names of the arrays that every scene has."""

    @property
    def splits(self) -> Mapping[str, Sequence[str]]:
        """Ids of the scenes of each split; empty where the dataset was not split."""

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the first picture."""

    def read(self, number: int, maps: Sequence[str], cut: Cut) -> dict[str, AnyArray]:
        """Arrays of the scene of that number, by name, in the window of its own size."""


@dataclass
class Samples:
    """Scenes as dictionaries of arrays, indexed like a list.

    `samples[0]` has the key `scene`, its id, and the arrays that were asked for. `stokes` is
    (height, width, bands, 3), `image` (height, width, bands), `mask` (height, width), `normals`
    (height, width, 3).

    Attributes
    ----------
    source : SampleSource
        Where the arrays are read from: a dataset's folder or shards.
    numbers : (n,) array
        Of the scenes in the source.
    maps : tuple of str
        Names of the arrays that were asked for.
    crop : int or None
        Side of a square that is cut out at random: the same for the same seed, epoch and index, in
        whichever process; where `raw` is asked for, at multiples of 4, so that every crop begins
        with the same square of the mosaic. None gives whole pictures.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> done = malus.render_dataset("quick", folder, resolution=12, samples=2)
    >>> samples = malus.open_dataset(folder).samples(maps=("image", "mask"), crop=8)
    >>> len(samples), samples[-1]["image"].shape, samples[0]["mask"].dtype.name
    (16, (8, 8, 3), 'bool')
    """

    source: SampleSource
    numbers: IntArray
    maps: tuple[str, ...] = DEFAULT_MAPS
    crop: int | None = None
    seed: int = 0
    epoch: int = field(default=0)

    def __repr__(self) -> str:
        """Number of samples and what they hold, in one line."""
        return f"Samples({len(self)} samples, maps={self.maps}, crop={self.crop})"

    @classmethod
    def of(
        cls,
        source: SampleSource,
        split: str | None = None,
        maps: Sequence[str] | str | None = None,
        crop: int | None = None,
        seed: int = 0,
    ) -> Samples:
        """Choose scenes and arrays of a source.

        Raises
        ------
        InputError
            A split or an array that the dataset does not have, or a crop larger than its pictures.
        """
        numbers = np.arange(len(source.ids))
        if split is not None:
            chosen = scenes_of(split, source.splits)
            numbers = numbers[[scene in chosen for scene in source.ids]]
        names = _names(maps, source.maps)
        for name in names:
            lookup(name, dict.fromkeys(source.maps), "maps", "the name of an array of this dataset")
        side = min(source.shape)
        if crop is not None:
            _check_whole("crop", crop, 1, side, f"1 to {side} pixels")
        _check_whole("seed", seed, 0, math.inf, "a whole number, 0 or larger")
        return cls(source, numbers, names, crop, seed)

    def __len__(self) -> int:
        """Number of samples."""
        return len(self.numbers)

    def __getitem__(self, index: SupportsIndex) -> dict[str, Any]:
        """The sample of that index; negative ones count from the end."""
        position = operator.index(index)
        if not -len(self) <= position < len(self):
            raise IndexError(f"sample {position} of {len(self)}")
        position %= len(self)
        number = int(self.numbers[position])
        scene = self.source.ids[number]
        return {"scene": scene} | self.source.read(number, self.maps, self._cut(position))

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """One sample after the other."""
        return (self[index] for index in range(len(self)))

    def set_epoch(self, epoch: int) -> None:
        """Draw other crops from now on; the same ones for the same epoch.

        Workers that stay from epoch to epoch have copies, which hear nothing of it.

        Raises
        ------
        InputError
            An epoch that is no whole number, or negative.
        """
        _check_whole("epoch", epoch, 0, math.inf, "a whole number, 0 or larger")
        self.epoch = epoch

    def _cut(self, position: int) -> Cut:
        """The crop of a sample, anywhere in its own picture: others may have other sizes."""
        crop = self.crop
        if crop is None:
            return whole

        def window(shape: Sequence[int]) -> Window:
            if min(shape) < crop:
                where = f"scene {self.source.ids[int(self.numbers[position])]}"
                expected, found = f"at least {crop} × {crop} pixels", f"{shape[0]} × {shape[1]}"
                raise InputError(where, expected, found, "choose a smaller crop")
            rng = np.random.default_rng((self.seed, self.epoch, position))
            step = MOSAIC_STEP if RAW in self.maps else 1
            free = ((side - crop) // step for side in shape)
            top, left = (step * int(rng.integers(0, steps + 1)) for steps in free)
            return slice(top, top + crop), slice(left, left + crop)

        return window


def scenes_of(split: str, splits: Mapping[str, Sequence[str]]) -> set[str]:
    """Ids of the scenes of a split.

    Raises
    ------
    InputError
        If there is none of that name.

    Examples
    --------
    >>> scenes_of("test", {"train": ["a", "b"], "test": ["c"]})
    {'c'}
    """
    if not splits:
        hint = "leave `split` out, or render a suite with `[splits]`"
        raise InputError("split", "a dataset with splits", "one without", hint)
    if split in get_args(SplitName) and split not in splits:
        expected = f"a scene in it; there are some in {', '.join(splits)}"
        hint = "leave `split` out, or render more scenes: so few gave it none"
        raise InputError(f"split {split}", expected, "none", hint)
    return set(lookup(split, splits, "split"))


def _names(maps: Sequence[str] | str | None, known: Sequence[str]) -> tuple[str, ...]:
    """Names of arrays, of one, or of all that there are."""
    if maps is None:
        return DEFAULT_MAPS
    return tuple(known) if isinstance(maps, str) and maps == "all" else several(maps)


def _check_whole(name: str, value: object, least: int, most: float, expected: str) -> None:
    """Raise InputError unless a value is a whole number in a range."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or not least <= operator.index(value) <= most:  # type: ignore[arg-type]
        raise InputError(name, expected, repr(value), f"choose another {name}")
