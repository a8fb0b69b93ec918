"""Differences between two methods, or two runs, over the scenes that both have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from statistics import NormalDist

import numpy as np
import pandas as pd

from malus.reports.tables.kept import kept
from malus.reports.tables.metric_definitions import MetricDefinition, definition_of
from malus.reports.tables.paper_table import default_metrics, number_with_error
from malus.reports.tables.rows import distinct, overall_rows
from malus.reports.tables.text_tables import TextTable
from malus.scenes.core.arrays import Float64Array

CONFIDENCE = 0.95
"""Probability that an interval holds the mean difference, if scenes were drawn at random."""

LEAST_SCENES = 3
"""Scenes below which a spread, and so an interval, means nothing."""


@dataclass(frozen=True)
class PairedDifference:
    """Difference of a metric between two lists of values of the same scenes.

    Attributes
    ----------
    better, worse, scenes : int
        On how many scenes the first is better and worse, and how many both have.
    difference, half_width : float
        Mean of first − second, and half the width of its confidence interval (Student's t); NaN
        below three scenes.

    Examples
    --------
    >>> higher = definition_of("psnr")
    >>> PairedDifference.of(np.array([31.0, 32, 33]), np.array([30.0, 31, 33.5]), higher).better
    2
    """

    metric: MetricDefinition
    better: int
    worse: int
    scenes: int
    difference: float
    half_width: float

    @classmethod
    def of(
        cls,
        first: Float64Array,
        second: Float64Array,
        metric: MetricDefinition,
        confidence: float = CONFIDENCE,
    ) -> PairedDifference:
        """Compare values scene by scene; those that neither or only one has are left out."""
        both = ~(np.isnan(first) | np.isnan(second))
        a, b = first[both], second[both]
        equal = a == b  # two infinite ratios are, though their difference is no number
        with np.errstate(invalid="ignore"):
            gains = metric.goodness(a) - metric.goodness(b)
            difference = np.where(equal, 0.0, a - b)
            mean = float(difference.mean()) if len(a) else math.nan
        return cls(
            metric,
            int((gains > 0).sum()),
            int((gains < 0).sum()),
            len(a),
            mean,
            half_width(difference, confidence),
        )

    @property
    def significant(self) -> bool:
        """Whether the interval leaves out zero."""
        return abs(self.difference) > self.half_width

    def __str__(self) -> str:
        """In words.

        Examples
        --------
        >>> str(PairedDifference(definition_of("psnr"), 83, 17, 100, 0.81, 0.32))
        'better in 83 of 100 scenes, difference 0.81 ± 0.32 dB'
        """
        unit = f" {self.metric.unit}" if self.metric.unit else ""
        amount = number_with_error(self.difference, self.half_width)
        return f"better in {self.better} of {self.scenes} scenes, difference {amount}{unit}"


def half_width(differences: Float64Array, confidence: float = CONFIDENCE) -> float:
    """Half the width of the interval of the mean (Student's t); NaN below three values.

    Examples
    --------
    >>> round(half_width(np.array([1.0, 2.0, 3.0])), 3)
    2.484
    """
    count = len(differences)
    if count < LEAST_SCENES or not np.isfinite(differences).all():
        return math.nan
    return student_width(confidence, count - 1) * float(differences.std(ddof=1)) / math.sqrt(count)


def student_width(confidence: float, freedom: float) -> float:
    """Half the width of the interval that holds Student's t with a probability, in (0, 1).

    With t = √ν tan θ the density of θ is that of cos^(ν−1) θ. Computed here because the report
    would wait for the import of scipy longer than for all else that it counts.

    Parameters
    ----------
    confidence : float
    freedom : float
        Degrees of freedom ν, at least 1.

    Examples
    --------
    >>> round(student_width(0.95, 2), 6), round(student_width(0.95, 1e6), 3)
    (4.302653, 1.96)
    """
    nodes, weights = np.polynomial.legendre.leggauss(64)
    scale = 2.0 * math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2))
    scale /= math.sqrt(math.pi)
    # The probability is concave in θ, so that Newton's steps from below stay below.
    angle = math.atan(NormalDist().inv_cdf(0.5 + confidence / 2) / math.sqrt(freedom))
    for _ in range(_NEWTON_STEPS):
        within = 0.5 * angle * (weights @ np.cos(0.5 * angle * (nodes + 1.0)) ** (freedom - 1))
        angle += (confidence / scale - float(within)) / math.cos(angle) ** (freedom - 1)
    return math.sqrt(freedom) * math.tan(angle)


_NEWTON_STEPS = 40
"""More than enough: from the normal distribution's angle each step doubles the digits."""


def paired(table: pd.DataFrame, metric: str, first: str, second: str) -> PairedDifference:
    """Difference of a metric between two methods of a results table, over scenes of both.

    Examples
    --------
    >>> from malus.reports.tables import sample
    >>> str(paired(sample.table(), "nmse", "half_vector", "eq8")).split(",")[0]
    'better in 6 of 6 scenes'
    """
    wide = _by_scene(table, metric).reindex(columns=[first, second])
    a, b = (wide[name].to_numpy(np.float64) for name in (first, second))
    return PairedDifference.of(a, b, definition_of(metric))


@kept
def ranked_pairs(table: pd.DataFrame) -> TextTable:
    """Is each method really better than the next? Neighbours in the ranking of every error.

    Methods that have every scene are ranked by their mean, and each is compared with the next.
    One that left scenes out is compared with the best of these, over the scenes that it has.
    """
    lines = []
    for name in default_metrics(table):
        definition = definition_of(name)
        if name != "nmse" and definition.unit != "dB":
            continue
        wide = _by_scene(table, name)
        means = wide.mean().to_numpy(np.float64)
        goodness = pd.Series(definition.goodness(means), wide.columns)
        complete = wide.notna().sum() == wide.notna().sum().max()
        order = list(goodness[complete].sort_values(ascending=False).index)
        others = [(method, order[0]) for method in wide.columns[~complete]]
        for first, second in (*pairwise(order), *others):
            pair = paired(table, name, first, second)
            if pair.scenes >= LEAST_SCENES:
                verdict = "yes" if pair.significant else "no"
                lines.append([name, first, second, str(pair), verdict])
    return TextTable(("metric", "method", "against", "scene by scene", "beyond chance"), lines)


def _by_scene(table: pd.DataFrame, metric: str) -> pd.DataFrame:
    """Values of a metric: a row a scene, a column a method, in the order of the table."""
    rows = overall_rows(table, metric)
    wide = rows.pivot_table(
        index="scene", columns="method", values="value", aggfunc="first", observed=True
    )
    return wide[[name for name in distinct(rows["method"]) if name in wide]]
