"""Predictions in the layouts of published projects, decoded to Stokes images.

Names are those of the dataset's scenes, or their numbers in its order: `0000`, `0001`, … Channels
are red, green and blue: the bands, the longest wavelength first.

- `rgb2pol`: `NAME/s1.png`, `s2.png` (and s0, s3, not needed), 8 or 16 bits: each component between
  the truth's smallest code 0 and its largest, over the whole picture and all channels.
- `polaranything`: `AoLP_16bit/NAME.png`, −90° … 90° anticlockwise from the horizontal, and
  `DoLP_16bit/NAME.png`, 0 … 1; one channel for all bands.
- `pol`: `pol000/NAME.png`, `pol045`, `pol090`, `pol135`: linear intensities behind a polariser
  whose angle counts anticlockwise from the horizontal, as S1 = I0 − I90 says.

Where a layout tells degree and angle alone, the intensity is that of the picture, which every
method was given; of `pol` too, whose unit is not known.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from malus.bench.datasets.predictions import Predictions
from malus.bench.scoring.profiles import Pictured
from malus.reconstruct.photos.read_picture import read_picture
from malus.renderers.datasets.dataset import Dataset
from malus.renderers.datasets.scene_folder import SceneRecord
from malus.scenes.core.arrays import Float64Array, FloatArray, IntArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.registry import lookup
from malus.scenes.core.remote import is_here

LARGEST_ANGLE_DEG = 90.0
"""Angle that the largest code of `AoLP_16bit` stands for; the smallest is its opposite."""

FROM_HORIZONTAL_DEG = (0, 45, 90, 135)
"""Polariser angles of a polarisation camera, as makers and networks count them."""

_HINT = "the help of `malus score` tells the layouts"


@dataclass(frozen=True)
class Layout:
    """Files of a prediction, relative to a folder, and how they become a Stokes image."""

    files: tuple[str, ...]
    decode: Callable[[Sequence[FloatArray], Pictured], FloatArray]


def _of_components(components: Sequence[FloatArray], truth: Pictured) -> FloatArray:
    """Codes of s1 and s2 on the truth's own scale; see `malus.bench.scoring.profiles.rgb2pol`."""
    parts = [truth.image]
    for k, codes in enumerate(components, start=1):
        true = np.where(truth.mask[..., None], truth.stokes[..., k], 0.0)
        parts.append(true.min() + codes * (true.max() - true.min()))
    return np.stack(parts, axis=-1)


def _of_angle_and_degree(pictures: Sequence[FloatArray], truth: Pictured) -> FloatArray:
    angle, degree = pictures
    radians = np.radians((2.0 * angle - 1.0) * LARGEST_ANGLE_DEG)
    return _partly_polarised(
        truth.image, degree * np.cos(2 * radians), degree * np.sin(2 * radians)
    )


def _of_polarisers(pictures: Sequence[FloatArray], truth: Pictured) -> FloatArray:
    i0, i45, i90, i135 = pictures
    total = (i0 + i45 + i90 + i135) / 2.0
    lit = total > 0
    s1, s2 = (
        np.divide(difference, total, out=np.zeros_like(total), where=lit)
        for difference in (i0 - i90, i45 - i135)
    )
    return _partly_polarised(truth.image, s1, s2)


def _partly_polarised(image: FloatArray, s1: FloatArray, s2: FloatArray) -> FloatArray:
    """Stokes vectors of a picture whose s1 and s2 are told over s0."""
    return np.stack(np.broadcast_arrays(image, image * s1, image * s2), axis=-1)


LAYOUTS: Mapping[str, Layout] = {
    "rgb2pol": Layout(("{name}/s1.png", "{name}/s2.png"), _of_components),
    "polaranything": Layout(
        ("AoLP_16bit/{name}.png", "DoLP_16bit/{name}.png"), _of_angle_and_degree
    ),
    "pol": Layout(
        tuple(f"pol{angle:03}/{{name}}.png" for angle in FROM_HORIZONTAL_DEG), _of_polarisers
    ),
}
"""Layouts by name."""


@dataclass(frozen=True)
class LayoutPredictions(Predictions):
    """Predictions in the layout of a published project.

    Attributes
    ----------
    dataset : Dataset
        Whose truths tell the scale of codes, and the intensity where none is predicted.
    layout : Layout
    names : dict of scene id to name of its files
    """

    dataset: Dataset
    layout: Layout
    names: Mapping[str, str]

    def stokes(self, record: SceneRecord) -> FloatArray:
        """The predicted Stokes image (height, width, bands, 3) of a scene.

        Raises
        ------
        InputError
            The first problem of this prediction.
        """
        pictures = [self._picture(path, record) for path in self._files(record.scene.id)]
        return self.layout.decode(pictures, self.dataset.truth(record.scene.id))

    def problems(self, record: SceneRecord) -> list[InputError]:
        """What is wrong with the prediction of a scene, file by file."""
        problems = []
        for path in self._files(record.scene.id):
            try:
                self._picture(path, record)
            except InputError as problem:
                problems.append(problem)
        return problems

    def of(self, scenes: Collection[str]) -> LayoutPredictions:
        """Those of some scenes, by the names that they have among all."""
        chosen = {scene: name for scene, name in self.names.items() if scene in scenes}
        return replace(self, names=chosen)

    def _every_file(self) -> Iterator[Path]:
        yield from sorted(path for scene in self.names for path in self._files(scene))

    def _files(self, scene: str) -> Iterator[Path]:
        for pattern in self.layout.files:
            yield self.folder / pattern.format(name=self.names[scene])

    def _picture(self, path: Path, record: SceneRecord) -> Float64Array:
        """Codes over the largest one (height, width, 1 or bands)."""
        if not path.is_file():
            raise InputError(str(self.folder), str(path.relative_to(self.folder)), "none", _HINT)
        values = np.asarray(read_picture(path, linear=True).linear, dtype=np.float64)
        bands = len(record.scene.wavelengths_nm)
        if values.shape[:2] != record.shape or values.shape[2] not in (1, bands):
            expected = f"{record.shape[1]} × {record.shape[0]} pixels, 1 or {bands} channels"
            found = f"{values.shape[1]} × {values.shape[0]}, {values.shape[2]} channels"
            raise InputError(str(path), expected, found, "predict every pixel of the picture")
        of_bands = np.broadcast_to(values, (*record.shape, bands))
        return of_bands[..., np.argsort(red_first(record.scene.wavelengths_nm))]


def red_first(wavelengths_nm: Sequence[float]) -> IntArray:
    """Numbers of the bands in the order of a picture's channels: the longest wavelength first.

    Examples
    --------
    >>> red_first((450.0, 650.0, 550.0)).tolist()
    [1, 2, 0]
    """
    return np.argsort(wavelengths_nm)[::-1]


def scene_numbers(dataset: Dataset) -> dict[str, str]:
    """Number of every scene of a whole dataset, as text of one length: `0000`, `0001`, …"""
    width = max(4, len(str(len(dataset.scenes) - 1)))
    return {scene: f"{number:0{width}}" for number, scene in enumerate(dataset.scenes)}


def check_is_here(folder: Path) -> None:
    """Refuse a store elsewhere: pictures of published layouts are read from files.

    Raises
    ------
    InputError
        For a folder that is not on this machine.
    """
    if not is_here(folder):
        raise InputError(str(folder), "a folder on this machine", "a store", "copy it here first")


def layout_predictions(dataset: Dataset, folder: Path, layout: str) -> LayoutPredictions:
    """Find predictions in a published layout, by the ids of scenes or by their numbers.

    Raises
    ------
    InputError
        An unknown layout, or a folder that has no file of it.
    """
    chosen = lookup(layout, LAYOUTS, "layout", f"one of {', '.join(LAYOUTS)}")
    check_is_here(folder)
    ids = list(dataset.scenes)
    for names in ({scene: scene for scene in ids}, scene_numbers(dataset)):
        first = chosen.files[0]
        if any((folder / first.format(name=name)).is_file() for name in names.values()):
            return LayoutPredictions(folder, {}, dataset, chosen, names)
    expected = f"{chosen.files[0].format(name=ids[0])} or {chosen.files[0].format(name='0000')}"
    raise InputError(str(folder), expected, "none", _HINT)
