"""Detect predictions whose intensity is not that of the picture that the method was given.

Predicted s0 is compared with the picture as it is, with the picture flipped, turned or with its
bands reversed, and with the pictures of the other scenes, each at the scale that fits best. A
picture that is smoothed or noisy stays nearest to itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from malus.renderers.truth import Truth
from malus.scenes.core.arrays import Float32Array, Float64Array, FloatArray, IntArray

_BETTER = 4.0
"""Factor by which squared differences must be smaller before a mistake is suspected."""
_LEAST = 1e-4
"""Least squared difference, over that of no prediction, that is a fault at all: 1 % of s0."""
_OTHER_BETTER, _OTHER_LEAST = 16.0, 1e-2
"""The same for other scenes' pictures, which may be much alike: smoothing a highlight may make it
that of a rougher surface, but not nearly as well."""
_OTHERS = 0.2
"""Share of the scenes, two at least, that must fit others."""
_CELLS = 8
"""Cells a side in which pictures of different scenes are compared."""
_MOST_SCENES = 2000
"""Scenes that are compared with each other, the first ones."""

MISTAKES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "upside down: rows are counted from the top": lambda image: image[::-1],
    "mirrored: columns are counted from the left": lambda image: image[:, ::-1],
    "turned by 180°: rows are counted from the top, columns from the left": (
        lambda image: image[::-1, ::-1]
    ),
    "with rows and columns exchanged: arrays are (height, width, ...)": (
        lambda image: image.swapaxes(0, 1)
    ),
    "turned by 90°: arrays are (height, width, ...), rows from the top": np.rot90,
    "turned by -90°: arrays are (height, width, ...), rows from the top": (
        lambda image: np.rot90(image, -1)
    ),
    "with its bands reversed: they are in the order of the picture": lambda image: image[..., ::-1],
}
"""What fits better, in words, and what it makes of a picture (height, width, bands)."""


@dataclass
class PictureCheck:
    """Differences of predicted s0 from pictures, gathered over scenes.

    Attributes
    ----------
    as_is : float
        Σ of squared differences from the picture, over those of no prediction.
    mistaken : dict of str to float
        The same from what each of `MISTAKES` makes of the picture.
    scenes : int
        Number of scenes with a prediction that is not dark.
    """

    as_is: float = 0.0
    mistaken: dict[str, float] = field(default_factory=lambda: dict.fromkeys(MISTAKES, 0.0))
    scenes: int = 0
    _ids: list[str] = field(default_factory=list)
    _small: list[tuple[Float32Array, Float32Array]] = field(default_factory=list)

    def add(self, predicted: FloatArray, truth: Truth) -> None:
        """Take the predicted s0 (height, width, bands) of a scene."""
        lit = _scaled(predicted)[truth.mask]
        if not lit.any():
            return
        self.scenes += 1
        self.as_is += _difference(lit, truth.image[truth.mask])
        for words, change in MISTAKES.items():
            changed = change(truth.image)
            fits = changed.shape == truth.image.shape
            picture = changed if fits else truth.image  # another shape was refused
            self.mistaken[words] += _difference(lit, picture[truth.mask])
        if len(self._ids) < _MOST_SCENES:
            self._ids.append(truth.scene.id)
            self._small.append((_small(predicted), _small(truth.image)))

    def suspicions(self) -> Iterator[str]:
        """What looks as if another picture was predicted, one sentence each.

        Examples
        --------
        >>> first, *_ = MISTAKES
        >>> print(*PictureCheck(as_is=0.5, mistaken={first: 0.01}, scenes=2).suspicions())
        predicted s0 fits the picture 50 times better upside down: rows are counted from the top
        """
        best = min(self.mistaken, key=self.mistaken.__getitem__)
        better = self.as_is / max(self.mistaken[best], 1e-3 * self.as_is, 1e-300)
        if better > _BETTER and self.as_is > _LEAST * self.scenes:
            times = f"{better:.0f}" if better < 999 else "1000+"
            yield f"predicted s0 fits the picture {times} times better {best}"
        others = list(self._others())
        if len(others) >= max(2.0, _OTHERS * len(self._ids)):
            scene, other = others[0]
            yield (
                f"predicted s0 of {len(others)} scenes fits the picture of another scene better,"
                f" that of {scene} the picture of {other}: the name is the id of the scene"
            )

    def _others(self) -> Iterator[tuple[str, str]]:
        """Scenes whose prediction fits the picture of another one, and that one."""
        by_shape: dict[int, list[int]] = {}
        for number, (_, picture) in enumerate(self._small):
            by_shape.setdefault(len(picture), []).append(number)
        for numbers in by_shape.values():
            predicted, pictures = (np.stack([self._small[n][k] for n in numbers]) for k in (0, 1))
            squares = 1.0 - np.clip(predicted @ pictures.T, 0.0, 1.0) ** 2
            own, best = squares.diagonal(), squares.argmin(axis=1)
            for k in _fitting_others(own, squares.min(axis=1)):
                yield self._ids[numbers[k]], self._ids[numbers[best[k]]]


def _fitting_others(own: FloatArray, other: FloatArray) -> IntArray:
    floor = np.maximum(other, 1e-6)  # single precision
    return np.flatnonzero((own > _OTHER_LEAST) & (own > _OTHER_BETTER * floor))


def _scaled(values: FloatArray) -> Float64Array:
    """Values over the largest of them, whose squares are finite."""
    largest = float(np.abs(values).max(initial=0.0))
    return values.astype(np.float64) / (largest or 1.0)


def _difference(predicted: FloatArray, picture: FloatArray) -> float:
    """Σ of squared differences at the scale that fits best, over that of no prediction."""
    picture = _scaled(picture)
    square = float(np.sum(picture**2))
    scale = max(float(np.sum(predicted * picture)) / square, 0.0) if square else 0.0
    return float(np.sum((predicted - scale * picture) ** 2) / np.sum(predicted**2))


def _small(picture: FloatArray) -> Float32Array:
    """A picture in few cells, as one vector of length 1."""
    cells = _scaled(picture)
    for axis in (0, 1):
        edges = np.linspace(0, picture.shape[axis], _CELLS, endpoint=False).astype(int)
        cells = np.add.reduceat(cells, edges, axis=axis)
    return (cells.ravel() / (np.linalg.norm(cells) or 1.0)).astype(np.float32)
