"""What the paper's "normalised" may mean: readings of the mean squared error of its Figure 5.

The paper reports "the mean squared error (MSE) difference between the normalised reconstructed and
ground truth polarisation components". It does not say what is divided by what, nor over what. A
reading scales estimate and truth and takes the mean of the squared difference over the object's
pixels, its bands and the paper's five polariser images.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from malus.bench.scoring.image_sums import E_MAX, E_MIN, EE, ET, T_MAX, T_MIN, TT, E, T
from malus.scenes.core.arrays import Float64Array

Measure = Literal["peak", "range", "mean", "energy"]
Scope = Literal["image", "object", "dataset"]


class Reading(NamedTuple):
    """One meaning of "normalised": by which measure, and taken over what.

    Attributes
    ----------
    measure : 'peak', 'range', 'mean' or 'energy'
        Division by the largest value; to [0, 1] by least and largest; by the mean; by the root
        mean square of the truth.
    scope : 'image', 'object' or 'dataset'
        Over what the measure is taken: every polariser image has its own, estimate and truth apart;
        one object has one; all objects of a data set have one.
    title : str
    """

    measure: Measure
    scope: Scope
    title: str


READINGS = {
    "peak": Reading("peak", "object", "over the peak of the unpolarised image (malus)"),
    "own_peak": Reading("peak", "image", "each image over its own maximum"),
    "dataset_peak": Reading("peak", "dataset", "over the peak of the whole data set"),
    "own_range": Reading("range", "image", "each image to [0, 1] by its own range"),
    "object_range": Reading("range", "object", "each object's five images to [0, 1]"),
    "dataset_range": Reading("range", "dataset", "the whole data set to [0, 1]"),
    "own_mean": Reading("mean", "image", "each image over its own mean"),
    "mean": Reading("mean", "object", "over the mean of the unpolarised image"),
    "dataset_mean": Reading("mean", "dataset", "over the mean of the whole data set"),
    "energy": Reading("energy", "image", "each image over its true energy"),
}
"""Readings by name; with 'range', estimate and truth are each scaled by their own range."""

LIKELIEST = "own_range"
"""The reading that `fig5` shows beside that of malus: the one in which "normalised reconstructed
and ground truth polarisation components" can be taken by the word, and in which rough surfaces
come near the range that the paper reports (`malus bench paper`)."""


@dataclass(frozen=True)
class DatasetSums:
    """Sums of every polariser image of some objects.

    Attributes
    ----------
    sums : (objects, angles, 9)
        As `image_sums` returns them.
    counts : (objects,)
        Pixels times bands of each object.
    peaks, means : (objects,)
        Largest value and mean of the unpolarised image.

    Examples
    --------
    >>> from malus.bench.scoring.image_sums import image_sums
    >>> true = np.array([[1.0, 3.0]]), np.zeros((1, 2)), np.zeros((1, 2))
    >>> doubled = tuple(2 * plane for plane in true)
    >>> one = DatasetSums(image_sums(doubled, true), *map(np.array, ([2], [3.0], [2.0])))
    >>> one.errors("own_peak").tolist(), one.errors("energy").tolist()
    ([0.0], [1.0])
    """

    sums: Float64Array
    counts: Float64Array
    peaks: Float64Array
    means: Float64Array

    def errors(self, name: str) -> Float64Array:
        """Error (objects,) of every object, in the reading of that name; NaN for a flat image."""
        reading, moments = READINGS[name], np.moveaxis(self.sums, -1, 0)
        (e_low, e_size), (t_low, t_size) = self._scales(reading, moments)
        n = self.counts[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            ee = (moments[EE] - 2 * e_low * moments[E] + n * e_low**2) / e_size**2
            tt = (moments[TT] - 2 * t_low * moments[T] + n * t_low**2) / t_size**2
            cross = moments[ET] - e_low * moments[T] - t_low * moments[E] + n * e_low * t_low
            error = (ee + tt - 2 * cross / (e_size * t_size)) / n
        # The difference of two sums of squares that are equal can round below zero.
        return np.asarray(np.maximum(error, 0.0).mean(axis=1))

    def _scales(self, reading: Reading, moments: Float64Array) -> tuple[_Scale, _Scale]:
        """What is subtracted from estimate and truth, and what they are divided by."""
        n, scope = self.counts[:, None], reading.scope
        if reading.measure == "energy":
            size = np.sqrt(moments[TT] / n)
            return (0.0, size), (0.0, size)
        if reading.measure == "range":
            e = _range(moments[E_MIN], moments[E_MAX], scope)
            return e, _range(moments[T_MIN], moments[T_MAX], scope)
        if scope == "image":
            of_e, of_t = (
                (moments[E_MAX], moments[T_MAX])
                if reading.measure == "peak"
                else (moments[E] / n, moments[T] / n)
            )
            return (0.0, of_e), (0.0, of_t)
        values = self.peaks if reading.measure == "peak" else self.means
        if scope == "dataset":
            of_all = np.average(self.means, weights=self.counts)
            values = np.full_like(values, values.max() if reading.measure == "peak" else of_all)
        return (0.0, values[:, None]), (0.0, values[:, None])


_Scale = tuple[Float64Array | float, Float64Array]


def _range(low: Float64Array, high: Float64Array, scope: Scope) -> _Scale:
    """Least value (objects, angles) and distance to the largest, each over the scope."""
    axis = {"image": (), "object": (1,), "dataset": (0, 1)}[scope]
    if axis:
        low, high = low.min(axis=axis, keepdims=True), high.max(axis=axis, keepdims=True)
    return low, high - low
