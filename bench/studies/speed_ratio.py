"""Benchmark of R: tables and many points, beside a double integral for every point by scipy."""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import get_args

import numpy as np

from malus.bench.studies.reference import reference_dolp
from malus.bench.studies.study import Findings
from malus.bench.studies.timing import timed
from malus.reconstruct import polarisation_ratio, specular_dolp
from malus.reconstruct.facets.breakpoints import Measure
from malus.reconstruct.facets.table import DolpTable
from malus.scenes.core.arrays import Float64Array

TOLERANCE = 1e-6
_TABLES = 7  # surfaces a measure: a table is built once a process, so every run needs another


@dataclass(frozen=True)
class RatioSpeed:
    """Time and error of R for one measure of the integral, and of the same by scipy.

    Attributes
    ----------
    table_seconds : for the table of a surface, median over several
    points : number of scattered triples (zenith, eta, sigma)
    seconds : for R of all points
    error : largest error of ρ against the reference on a sample
    by_hand_seconds : for all points by scipy's dblquad, extrapolated from a few
    by_hand_error : largest error of ρ of those few
    """

    measure: str
    table_seconds: float
    points: int
    seconds: float
    error: float
    by_hand_seconds: float
    by_hand_error: float


def findings(folder: Path | None, points: int) -> Findings:
    """Run the benchmark, with so many points of R."""
    speeds = measure_speed(points)
    return Findings(tuple(report_lines(speeds)), [asdict(speed) for speed in speeds])


def scattered(count: int) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Random zeniths, indices of 1.3 to 1.8 and σ of roughness 0.05 to 0.5, (count,) each."""
    random = np.random.default_rng(0)
    alpha = np.exp(random.uniform(math.log(0.05), math.log(0.5), count))
    return random.uniform(0.0, np.pi / 2, count), random.uniform(1.3, 1.8, count), alpha**-2.0


def _table_seconds(measure: Measure) -> float:
    """Median seconds for the table of one surface."""
    seconds = []
    for surface in range(_TABLES + 1):
        # The clock makes the surfaces of every run different: none is in the cache.
        eta, sigma = 1.45 + 0.01 * surface, 11.1 + 1e-6 * (time.perf_counter() % 1.0)
        seconds.append(timed(partial(DolpTable, eta, sigma, measure)).clock)
    return float(np.median(seconds[1:]))  # the first one also makes the quadrature rules


def by_hand(zenith: float, eta: float, sigma: float, measure: Measure) -> float:
    """ρ by Equations 4 to 8 as they stand, with scipy.integrate.dblquad.

    By hand the shadowed measures need Smith's G1 on top; their time is taken as that of `visible`.
    """
    from scipy.integrate import dblquad

    reach = math.sqrt(36.0 / sigma)

    def total(sign: int) -> float:
        def integrand(phi: float, r: float) -> float:
            return _integrand(phi, r, (zenith, eta, sigma), measure, sign)

        return float(dblquad(integrand, 0.0, reach, 0.0, 2.0 * math.pi)[0])

    perpendicular, parallel = total(1), total(-1)
    return (perpendicular - parallel) / (perpendicular + parallel)


def _integrand(
    phi: float, r: float, point: tuple[float, float, float], measure: Measure, sign: int
) -> float:
    """Equation 4 of one facet, I_⊥ for sign 1 and I_∥ for −1, times the measure's weight."""
    zenith, eta, sigma = point
    x = r * math.sin(phi)
    y = math.sin(zenith) - r * math.cos(zenith) * math.cos(phi)
    facing = math.cos(zenith) + r * math.sin(zenith) * math.cos(phi)
    if facing <= 0.0:
        return 0.0
    cosine = min(facing / math.sqrt(1.0 + r * r), 1.0)
    inside = math.sqrt(1.0 - (1.0 - cosine * cosine) / eta**2)
    f_perpendicular = ((cosine - eta * inside) / (cosine + eta * inside)) ** 2
    f_parallel = ((eta * cosine - inside) / (eta * cosine + inside)) ** 2
    cos2_beta = y * y / max(x * x + y * y, 1e-300)
    if sign < 0:
        cos2_beta = 1.0 - cos2_beta
    reflected = f_perpendicular * cos2_beta + f_parallel * (1.0 - cos2_beta)
    weight = math.exp(-sigma * r * r) * (1.0 if measure == "eq8" else r * facing)
    return weight * reflected


def _by_hand(
    points: tuple[Float64Array, Float64Array, Float64Array], few: int, measure: Measure
) -> tuple[float, float]:
    """Seconds a point and largest error of ρ; zeniths up to 80°, where dblquad is at its best."""
    literal: Measure = "eq8" if measure == "eq8" else "visible"
    errors = []
    started = time.perf_counter()
    chosen = list(zip(*points, strict=True))[:few]
    for zenith, eta, sigma in chosen:
        with warnings.catch_warnings():  # it warns where it does not converge
            warnings.simplefilter("ignore")
            value = by_hand(min(zenith, 1.4), eta, sigma, literal)
        errors.append(abs(value - float(specular_dolp(min(zenith, 1.4), eta, sigma, literal))))
    return (time.perf_counter() - started) / len(chosen), max(errors)


def _error(
    points: tuple[Float64Array, Float64Array, Float64Array],
    rho: Float64Array,
    sample: int,
    measure: Measure,
) -> float:
    """Largest error of ρ against the independent reference, on an even sample of the points."""
    worst = 0.0
    for index in np.linspace(0, rho.size - 1, sample).astype(np.intp):
        zenith, eta, sigma = (float(axis[index]) for axis in points)
        exact = reference_dolp(zenith, eta, sigma, measure).value
        worst = max(worst, abs(float(rho[index]) - exact))
    return worst


def measure_speed(count: int, sample: int = 12, few: int = 3, repeats: int = 3) -> list[RatioSpeed]:
    """Time every measure: tables, R of scattered points, and the same by hand on a few."""
    return [_speed(measure, count, sample, few, repeats) for measure in get_args(Measure)]


def _speed(measure: Measure, count: int, sample: int, few: int, repeats: int) -> RatioSpeed:
    points = scattered(count)
    ratio = np.empty(0)

    def work() -> None:
        nonlocal ratio
        ratio = polarisation_ratio(*points, measure, tolerance=TOLERANCE)

    seconds = float(np.median([timed(work).clock for _ in range(repeats)]))
    rho = (1.0 - ratio) / (1.0 + ratio)
    by_hand_seconds, by_hand_error = _by_hand(points, few, measure)
    return RatioSpeed(
        measure,
        _table_seconds(measure),
        count,
        seconds,
        _error(points, rho, sample, measure),
        by_hand_seconds * count,
        by_hand_error,
    )


def report_lines(speeds: list[RatioSpeed]) -> list[str]:
    """Two lines a measure, for people."""
    lines = []
    for speed in speeds:
        lines += [
            f"{speed.measure}: table of a surface {speed.table_seconds * 1e3:.2f} ms; R of "
            f"{speed.points} points {speed.seconds:.3g} s, largest error of rho {speed.error:.1e}",
            f"  by hand (scipy.integrate.dblquad, extrapolated): {speed.by_hand_seconds:.3g} s, "
            f"{speed.by_hand_seconds / speed.seconds:.2g}x ours, error {speed.by_hand_error:.1e}",
        ]
    return lines
