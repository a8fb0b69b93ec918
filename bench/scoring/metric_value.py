"""Numbers of a results table, for what scores and for what only reads tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple, Protocol, Self

import numpy as np

from malus.scenes.core.arrays import Float64Array, FloatArray

Place = tuple[str, float | None, float | None]
"""What a number is: metric, band and angle; both are None where it is over all of them."""


class MetricValue(NamedTuple):
    """One number of a results table; band and angle are None where it is over all of them."""

    metric: str
    value: float
    noise: float = 0.0
    band_nm: float | None = None
    angle_deg: float | None = None


class StokesMetric(Protocol):
    """Function of the estimated Stokes vectors (pixels, bands, 3) of the mask's pixels."""

    def __call__(
        self, stokes: FloatArray, change: FloatArray | None = None, /
    ) -> Iterable[MetricValue]:
        """Values; `change` is what a draw of the noise changes in the errors, where it is known."""
        ...


class MetricColumns(NamedTuple):
    """All numbers of one score, column by column: a tenth of the time of one object each.

    Attributes
    ----------
    places : tuple of Place
        Scores of the same kind share it.
    value, noise : (places,)
    """

    places: tuple[Place, ...]
    value: Float64Array
    noise: Float64Array

    @classmethod
    def of(cls, values: Iterable[MetricValue]) -> Self:
        """The columns of some numbers.

        Examples
        --------
        >>> MetricColumns.of([MetricValue("nmse", 0.1), MetricValue("skill", 0.9)]).value.tolist()
        [0.1, 0.9]
        """
        rows = list(values)
        places = tuple((row.metric, row.band_nm, row.angle_deg) for row in rows)
        value, noise = ([row[column] for row in rows] for column in (1, 2))
        return cls(places, np.array(value, np.float64), np.array(noise, np.float64))

    def each(self) -> Iterator[MetricValue]:
        """The numbers one by one."""
        columns = zip(self.places, self.value.tolist(), self.noise.tolist(), strict=True)
        for (metric, band, angle), value, noise in columns:
            yield MetricValue(metric, value, noise, band, angle)
