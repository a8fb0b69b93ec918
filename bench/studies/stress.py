"""Stress study: stiff and extreme cases, each with its value, error, seconds and a verdict."""

from __future__ import annotations

import math
import re
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from malus.bench.studies.reference import reference_dolp
from malus.bench.studies.stress_images import (
    DTYPES,
    METHODS,
    ImageCase,
    image_cases,
    image_faults,
    ordinary,
)
from malus.bench.studies.stress_surfaces import surface_cases
from malus.bench.studies.study import Findings
from malus.reconstruct import get_method, specular_dolp
from malus.reconstruct.facets.breakpoints import Measure
from malus.reports.tables.formats import as_csv
from malus.reports.tables.text_tables import stress_cells
from malus.scenes.core.cores import usable_cores
from malus.scenes.core.files import write_text

LARGEST_ERROR = 1e-8
"""Largest error of ρ with which a case passes, by default settings."""

MEASURES: tuple[Measure, ...] = ("eq8", "visible", "shadowed")
ETAS = (1.0, 1.0 + 1e-12, 1.0 - 1e-12, 1.0001, 0.6, 1.5, 4.0, 0.2 + 3.4j)
SIGMAS = (1e-6, 1e-3, 0.1, 1.0, 11.1, 1e3, 1e5, 1e8, 1e10)


class RhoCase(NamedTuple):
    """One point (θ, η, σ) of a measure at which ρ is computed."""

    name: str
    zenith: float
    eta: complex
    sigma: float
    measure: Measure


def findings(folder: Path) -> Findings:
    """Run the study and write its table into a folder."""
    table = stress_table()
    write_table(folder, table)
    failed = int((~table.passed).sum())
    line = f"{len(table)} cases, {failed} failed; written to {folder}"
    return Findings((line,), table=table, cells=stress_cells, passed=failed == 0)


def rho_cases() -> list[RhoCase]:
    """Cases of ρ: every zenith with every index, and every σ with every measure."""
    sigmas, measures = cycle((11.1, 1e5, 0.1, 1e3, 1e-6)), cycle(MEASURES)
    crossed = [
        RhoCase(name, zenith, eta, next(sigmas), next(measures))
        for eta in ETAS
        for name, zenith in _zeniths(eta)
    ]
    rough = [
        RhoCase("Brewster", math.atan(1.5), 1.5, sigma, measure)
        for sigma in SIGMAS
        for measure in MEASURES
    ]
    return crossed + rough


def _zeniths(eta: complex) -> list[tuple[str, float]]:
    brewster = math.atan(abs(eta))
    return [
        ("zenith 0", 0.0),
        ("zenith 1e-6", 1e-6),
        ("Brewster - 1e-6", brewster - 1e-6),
        ("Brewster + 1e-6", brewster + 1e-6),
        ("89.99°", math.radians(89.99)),
        ("90°", math.pi / 2),
    ]


def _row(group: str, case: str, seconds: float, **more: Any) -> dict[str, Any]:
    empty = {"value": math.nan, "error": math.nan, "why": ""}
    return {"group": group, "case": case, "seconds": seconds} | empty | more


def _rho_row(case: RhoCase, exact: float) -> dict[str, Any]:
    """Row of one case of ρ; a warning fails it, too."""
    started = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            value = float(specular_dolp(case.zenith, case.eta, case.sigma, case.measure))
        except Warning as warning:
            return _row("rho", _label(case), 0.0, passed=False, why=f"warns {warning}")
    seconds = time.perf_counter() - started
    error = abs(value - exact)
    why = "" if error <= LARGEST_ERROR else f"error above {LARGEST_ERROR:g}"
    return _row("rho", _label(case), seconds, value=value, error=error, passed=not why, why=why)


def _exact(case: RhoCase) -> float:
    """ρ of a case by the independent reference."""
    # Along the normal nothing is polarised, by symmetry; there are no rings around V = N.
    if case.zenith == 0.0:
        return 0.0
    return reference_dolp(case.zenith, case.eta, case.sigma, case.measure).value


def _label(case: RhoCase) -> str:
    eta = f"{case.eta:g}" if isinstance(case.eta, complex) else f"{case.eta:.13g}"
    return f"{case.measure}, {case.name}, η {eta}, σ {case.sigma:g}"


def _image_rows(case: ImageCase, methods: Sequence[str]) -> list[dict[str, Any]]:
    """Rows of one extreme image, one a precision; seconds are those of a method."""
    rows = []
    for dtype in DTYPES:
        started = time.perf_counter()
        faults = [fault for method in methods for fault in image_faults(case, dtype, method)]
        seconds = (time.perf_counter() - started) / max(len(methods), 1)
        label, why = f"{case.name}, {dtype}", "; ".join(faults)
        rows.append(_row("image", label, seconds, passed=not faults, why=why))
    return rows


def _shape_rows() -> list[dict[str, Any]]:
    """Rows of ρ of 0-d to 4-d arrays of both precisions, against the same point as a number."""
    rows = []
    for dtype in DTYPES:
        zenith = np.dtype(dtype).type(0.9)
        exact = float(specular_dolp(float(zenith), 1.5, 20.0))
        for shape in ((), (3,), (2, 3), (1, 2, 3), (2, 1, 2, 2), (0,)):
            started = time.perf_counter()
            rho = specular_dolp(np.full(shape, zenith), 1.5, 20.0)
            seconds = time.perf_counter() - started
            error = float(np.max(np.abs(rho - exact), initial=0.0))
            good = rho.shape == shape and rho.dtype == np.float64 and error <= LARGEST_ERROR
            why = "" if good else f"shape {rho.shape}, {rho.dtype}"
            label = f"ratio of shape {shape}, {dtype}"
            rows.append(
                _row("shape", label, seconds, value=exact, error=error, passed=good, why=why)
            )
    return rows


def _refusals() -> list[tuple[str, Callable[[], object], str]]:
    """Calls that must be refused, and a pattern of the message: argument, range and value."""
    points: list[tuple[str, tuple[Any, ...], str]] = [
        ("zenith below 0", (-0.1, 1.5, 1.0), r"zenith must be in \[0, pi/2\].*-0\.1"),
        ("zenith above 90°", (1.6, 1.5, 1.0), r"zenith must be in \[0, pi/2\].*1\.6"),
        ("zenith NaN", (np.nan, 1.5, 1.0), r"zenith must be .*nan"),
        ("η 0", (0.5, 0.0, 1.0), r"eta must be > 0.*0\.0"),
        ("η amplifies", (0.5, 1.5 - 1j, 1.0), r"eta must be > 0.*-1j"),
        ("σ 0", (0.5, 1.5, 0.0), r"sigma must be .*> 0.*0\.0"),
        ("σ infinite", (0.5, 1.5, np.inf), r"sigma must be .*> 0.*inf"),
    ]
    calls: list[tuple[str, Callable[[], object], str]] = [
        (name, partial(specular_dolp, *arguments), message) for name, arguments, message in points
    ]
    image = ordinary("float64")
    for method in ("eq8", "lights", "shadowed+body"):
        for alpha in (0.0, -0.3, math.nan, math.inf):
            call = partial(get_method(method).reconstruct, replace(image, alpha=alpha))
            calls.append((f"{method}, alpha {alpha:g}", call, rf"alpha must be > 0.*{alpha:g}"))
    for method in ("eq8", "smooth", "half_vector", "lights", "half_vector+body"):
        negative = replace(image, eta=np.array([1.5, -1.5, 1.5]))
        call = partial(get_method(method).reconstruct, negative)
        calls.append((f"{method}, η below 0", call, r"eta must be > 0.*-1\.5"))
    return calls


def _refusal_row(name: str, call: Callable[[], object], message: str) -> dict[str, Any]:
    """Row of a call that must raise a ValueError with a message of that pattern."""
    started = time.perf_counter()
    why = "not refused"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            call()
    except ValueError as error:
        why = "" if re.search(message, str(error)) else f"says {error}"
    except Exception as error:  # any other exception is a fault
        why = f"{type(error).__name__}: {error}"
    return _row("refusal", name, time.perf_counter() - started, passed=not why, why=why)


def stress_table(
    points: Iterable[RhoCase] | None = None, methods: Sequence[str] = METHODS
) -> pd.DataFrame:
    """Table of all cases: group, case, value, error, seconds, passed, why.

    Parameters
    ----------
    points : cases of ρ, all by default
    methods : names of the methods that reconstruct the extreme images, all by default
    """
    cases = rho_cases() if points is None else list(points)
    # Catching warnings is not safe between threads: only the reference, the slow part, uses them.
    with ThreadPoolExecutor(usable_cores()) as pool:
        exact = list(pool.map(_exact, cases))
    rows = [_rho_row(case, value) for case, value in zip(cases, exact, strict=True)]
    for case in image_cases() + surface_cases():
        rows += _image_rows(case, methods)
    rows += _shape_rows()
    rows += [_refusal_row(*refusal) for refusal in _refusals()]
    return pd.DataFrame.from_records(rows)


def write_table(out: Path, table: pd.DataFrame) -> None:
    """Write the table as stress.csv and stress.md to a folder."""
    write_text(out / "stress.csv", as_csv(table))
    write_text(out / "stress.md", markdown(table))


def markdown(table: pd.DataFrame) -> str:
    """The table as Markdown."""
    lines = ["| " + " | ".join(table.columns) + " |", "|---" * len(table.columns) + "|"]
    lines += ["| " + " | ".join(stress_cells(row)) + " |" for _, row in table.iterrows()]
    return "\n".join(lines) + "\n"
