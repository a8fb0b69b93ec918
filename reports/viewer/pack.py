"""Stokes images as text in a page: 16 bits a number, only the object's pixels.

Every plane has its own step, so that the rounding is at most half of 1/65533 of its range: below a
hundredth of one grey level of a screen.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reports.viewer.examples import Example
from malus.scenes.core.arrays import AnyArray

BUDGET = 11_000_000
"""Characters of image data in a page: what is left of 15 MB is for figures and tables."""

FEWER_BANDS = 3
NOT_FINITE = 65535
STEPS = NOT_FINITE - 2  # one is lost where the range does not begin at a whole step

Planes = dict[str, Any]


def quantised(values: AnyArray) -> tuple[NDArray[np.uint16], int, float]:
    """Whole numbers q with values ≈ step · (first + q); 65535 stands for one that is not finite.

    Zero stays exactly zero: the angle of light that is not polarised is no accident of rounding.

    Returns
    -------
    q, first, step

    Examples
    --------
    >>> q, first, step = quantised(np.array([0.0, 3.0, np.nan]))
    >>> q.tolist(), first, round(step * 65533, 9)
    ([0, 65533, 65535], 0, 3.0)
    """
    finite = np.isfinite(values)
    wide = np.where(finite, values, 0.0).astype(np.float64)
    low, high = (wide[finite].min(), wide[finite].max()) if finite.any() else (0.0, 0.0)
    # All equal: one step is the value itself.
    step = float((high - low) / STEPS or abs(low) or 1.0)
    first = math.floor(low / step)
    q = np.clip(np.rint(wide / step) - first, 0, NOT_FINITE - 1)
    return np.where(finite, q, NOT_FINITE).astype(np.uint16), first, step


def fitted(examples: Sequence[Example], budget: int = BUDGET) -> tuple[list[Example], int]:
    """Examples that fit a page, with fewer bands where that helps; and the number left out."""
    chosen = list(examples)
    if sum(map(_size, chosen)) > budget:
        chosen = [_thinned(example) for example in chosen]
    kept: list[Example] = []
    room = budget
    for example in chosen:
        room -= _size(example)
        if room >= 0:
            kept.append(example)
    return kept, len(examples) - len(kept)


def _size(example: Example) -> int:
    return example.planes * example.pixels * 3 * 2 * 4 // 3


def _thinned(example: Example) -> Example:
    bands = len(example.band_names)
    kept = np.unique(np.linspace(0, bands - 1, min(bands, FEWER_BANDS)).round().astype(int))
    return example.bands(kept.tolist())


@dataclass
class Packer:
    """Image data of the viewer, as blocks of base64 text that the images name by number."""

    blocks: list[str] = field(default_factory=list)

    def scene(self, example: Example, about: dict[str, Any]) -> dict[str, Any]:
        """A scene for the viewer; its images go into blocks.

        Parameters
        ----------
        example : Example
        about : dict
            Anything else that the viewer shall know of the scene, as JSON.
        """
        height, width = example.mask.shape
        bands = range(len(example.band_names))
        mask = example.mask
        truth = [example.truth[mask][:, band] for band in bands]
        mixed = mask[mask] & False if example.mixed is None else example.mixed[mask]
        return about | {
            "mixed": self._block(np.packbits(mixed)) if mixed.any() else None,
            "id": example.scene,
            "label": example.label,
            "width": width,
            "height": height,
            "pixels": example.pixels,
            "bands": list(example.band_names),
            "mask": self._block(np.packbits(mask)),
            "truth": [self._planes(stokes) for stokes in truth],
            "methods": {
                name: [self._planes(stokes[mask][:, band], truth[band]) for band in bands]
                for name, stokes in example.methods.items()
            },
        }

    def _planes(self, stokes: AnyArray, truth: AnyArray | None = None) -> Planes:
        """Description of (pixels, 3); s0 is left out where it equals the truth's."""
        first = 1 if truth is not None and _equal_when_stored(stokes[:, 0], truth[:, 0]) else 0
        planes = [quantised(stokes[:, plane]) for plane in range(first, 3)]
        block = self._block(np.concatenate([q for q, _, _ in planes]).astype("<u2"))
        firsts, steps = [low for _, low, _ in planes], [step for _, _, step in planes]
        return {"block": block, "first": firsts, "step": steps}

    def _block(self, array: AnyArray) -> int:
        self.blocks.append(base64.b64encode(array.tobytes()).decode("ascii"))
        return len(self.blocks) - 1


def _equal_when_stored(planes: AnyArray, reference: AnyArray) -> bool:
    """Whether planes differ by less than half a step of the stored reference."""
    if not np.isfinite(planes).all() or not planes.size:
        return False
    return bool(np.abs(planes - reference).max() <= 0.5 * float(np.ptp(reference)) / STEPS)
