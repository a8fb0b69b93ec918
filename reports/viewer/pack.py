"""Stokes images as text in a page: 16 bits a number, only the object's pixels.

Every plane has its own step, so that the rounding is at most half of 1/65533 of its range: below a
hundredth of one grey level of a screen.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from malus.reports.viewer.examples import Example
from malus.scenes.core.arrays import AnyArray, Float64Array
from malus.scenes.core.errors import printable

BUDGET = 10_500_000
"""Characters of image data in a page: what is left of 15 MB is for figures and tables."""

_WAYS = ((None, True), (None, False), (3, True), (1, True))
"""How a page is made smaller: single bands (None is all) beside the colour, surroundings."""

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


@dataclass(frozen=True)
class Shown:
    """An example with what the page shows of it.

    Attributes
    ----------
    example : Example
    bands : sequence of int
        Its bands that can be looked at one by one.
    with_colour : bool
        Whether linear red, green and blue are packed beside these bands; otherwise all bands are
        there, and the page makes the colour of them.
    with_surroundings : bool
        Whether the light beside the object is packed.
    stored : dict of str to list of int
        Of every method the Stokes components that are neither the truth's nor all zero.
    """

    example: Example
    bands: Sequence[int]
    with_colour: bool
    with_surroundings: bool
    stored: Mapping[str, list[int]]

    @property
    def size(self) -> int:
        """Characters in the page."""
        example = self.example
        numbers = example.pixels * (3 + sum(map(len, self.stored.values())))
        if self.with_surroundings:
            numbers += 3 * int(example.beyond.sum())
        return (len(self.bands) + 3 * self.with_colour) * numbers * 2 * 4 // 3

    @property
    def colours(self) -> Float64Array:
        """Matrix (3, planes) from what is packed to linear red, green and blue."""
        if self.with_colour:
            return np.concatenate([np.zeros((3, len(self.bands))), np.eye(3)], axis=1)
        return self.example.screen_weights.T


def _stored(example: Example) -> dict[str, list[int]]:
    """Of every method the Stokes components that are neither the truth's nor all zero."""
    truth = example.truth[example.mask]
    return {
        name: _own_components(stokes[example.mask], truth)
        for name, stokes in example.methods.items()
    }


def _own_components(stokes: AnyArray, truth: AnyArray) -> list[int]:
    """Components of (pixels, bands, 3) that cannot be left out: s0 that is not the truth's, …"""
    own = [k for k in (1, 2) if not (stokes[..., k] == 0).all()]
    return own if _equal_when_stored(stokes[..., 0], truth[..., 0]) else [0, *own]


def fitted(examples: Sequence[Example], budget: int = BUDGET) -> tuple[list[Shown], int]:
    """What of the examples fits a page, and the number of those left out.

    Where all bands are too many, surroundings go first, then bands; colour stays.
    """
    stored = [_stored(example) for example in examples]
    chosen: list[Shown] = []
    for few, with_surroundings in _WAYS:
        chosen = [
            _shown(example, few, with_surroundings, components)
            for example, components in zip(examples, stored, strict=True)
        ]
        if sum(shown.size for shown in chosen) <= budget:
            break
    kept: list[Shown] = []
    room = budget
    for shown in chosen:
        if shown.size <= room:
            room -= shown.size
            kept.append(shown)
    return kept, len(examples) - len(kept)


def _shown(
    example: Example, few: int | None, with_surroundings: bool, stored: dict[str, list[int]]
) -> Shown:
    """All bands, or so few and the colour of all where that is less."""
    count = len(example.band_names)
    if few is None or few + 3 >= count:
        return Shown(example, range(count), False, with_surroundings, stored)
    kept = np.linspace(0, count - 1, few + 2)[1:-1]  # those at the ends are the darkest
    return Shown(example, kept.round().astype(int).tolist(), True, with_surroundings, stored)


@dataclass
class Packer:
    """Image data of the viewer, as blocks of base64 text that the images name by number."""

    blocks: list[str] = field(default_factory=list)

    def scene(self, shown: Shown, about: dict[str, Any]) -> dict[str, Any]:
        """A scene for the viewer; its images go into blocks.

        Parameters
        ----------
        shown : Shown
        about : dict
            Anything else that the viewer shall know of the scene, as JSON.
        """
        example = shown.example
        height, width = example.mask.shape
        mask, beyond = example.mask, example.beyond & shown.with_surroundings
        mixed = mask[mask] & False if example.mixed is None else example.mixed[mask]
        return about | {
            "mixed": self._block(np.packbits(mixed)) if mixed.any() else None,
            "id": example.scene,
            "label": printable(example.label),
            "width": width,
            "height": height,
            "step": example.step,
            "pixels": example.pixels,
            "bands": [example.band_names[band] for band in shown.bands],
            "colours": np.round(shown.colours, 9).tolist(),
            "mask": self._block(np.packbits(mask)),
            "truth": self._planes(example.truth[mask], shown, [0, 1, 2]),
            "methods": {
                printable(name): self._planes(stokes[mask], shown, shown.stored[name])
                for name, stokes in example.methods.items()
            },
            "beyond": {
                "pixels": int(beyond.sum()),
                "mask": self._block(np.packbits(beyond)),
                "truth": self._planes(example.truth[beyond], shown, [0, 1, 2]),
            },
        }

    def _planes(self, stokes: AnyArray, shown: Shown, components: list[int]) -> list[Planes]:
        """Description of (pixels, bands, 3), one entry a plane: some components, others left out.

        What is not among `components` is the truth's (s0) or zero (s1, s2).
        """
        planes = [stokes[:, band] for band in shown.bands]
        if shown.with_colour:
            planes += list(np.einsum("pbs,bc->cps", stokes, shown.example.screen_weights))
        return [self._plane(plane, components) for plane in planes]

    def _plane(self, stokes: AnyArray, components: list[int]) -> Planes:
        planes = [quantised(stokes[:, component]) for component in components]
        numbers = [q for q, _, _ in planes] or [np.zeros(0, np.uint16)]
        block = self._block(np.concatenate(numbers).astype("<u2"))
        firsts, steps = [low for _, low, _ in planes], [step for _, _, step in planes]
        return {"block": block, "components": components, "first": firsts, "step": steps}

    def _block(self, array: AnyArray) -> int:
        self.blocks.append(base64.b64encode(array.tobytes()).decode("ascii"))
        return len(self.blocks) - 1


def _equal_when_stored(planes: AnyArray, reference: AnyArray) -> bool:
    """Whether planes (pixels, bands) differ by less than half a step of the stored reference."""
    if not np.isfinite(planes).all() or not planes.size:
        return False
    half_steps = 0.5 * np.ptp(reference, axis=0) / STEPS
    return bool((np.abs(planes - reference).max(axis=0) <= half_steps).all())
