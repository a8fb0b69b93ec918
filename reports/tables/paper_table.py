"""A table of methods × metrics to paste into a paper, as LaTeX, Markdown or CSV."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from fnmatch import fnmatchcase

import numpy as np
import pandas as pd

from malus.reports.tables.formats import NO_NUMBER, as_csv, markdown
from malus.reports.tables.metric_definitions import (
    DEFINITIONS,
    MetricDefinition,
    definition_of,
)
from malus.reports.tables.rows import TRIVIAL, distinct, not_finite, overall_rows
from malus.scenes.core.arrays import Float64Array
from malus.scenes.core.errors import InputError, printable
from malus.scenes.core.registry import lookup

_BY_DEFAULT = ("nmse", "skill")
_IN_DETAIL = ("*_i_max", "*_i_min", "*_s1", "*_s2", "*_s3", "*_std", "*_pixels")
RESAMPLES = 1000
ROUNDING = 1e-12
"""Relative error of a mean that is rounding alone."""

LEAST_PLAIN = 0.01
MOST_DECIMALS = 5
"""Smaller values have an exponent; larger ones at most so many decimals."""

_MEDIANS = ("skill", "skill_*", "scaled_skill", "facing_skill")
"""Metrics that are summed up by their median: one scene of −60 would rule a mean."""


@dataclass(frozen=True)
class Cell:
    """A metric of a method over scenes: mean (median of a skill), standard error, scenes."""

    value: float
    error: float
    images: int

    def __str__(self) -> str:
        """Digits up to the second of the error.

        Examples
        --------
        >>> str(Cell(23.4567, 0.0321, 9)), str(Cell(2e-5, 1e-6, 4))
        ('23.457 ± 0.032', '2.00e-5 ± 1.0e-6')
        >>> str(Cell(math.inf, math.nan, 9))
        '∞'
        >>> str(Cell(math.nan, math.nan, 9))
        'not finite'
        """
        if math.isnan(self.value):
            return "not finite"
        return number_with_error(self.value, self.error)


def number_with_error(value: float, error: float) -> str:
    """A number ± its error, with digits up to the second of the error.

    Examples
    --------
    >>> number_with_error(0.8123, 0.3), number_with_error(0.25, math.nan)
    ('0.81 ± 0.30', '0.2500')
    >>> number_with_error(-9.996e-5, 1e-6)
    '−1.000e-4 ± 1.0e-6'
    """
    if not math.isfinite(value):
        return NO_NUMBER if math.isnan(value) else "∞" if value > 0 else "−∞"
    if math.isfinite(error) and error > ROUNDING * abs(value):
        last = math.floor(math.log10(error)) - 1
        return f"{_number(value, last)} ± {_number(error, last)}"
    return _number(value, math.floor(math.log10(abs(value))) - 3) if value else "0"


def _number(value: float, last: int) -> str:
    """A number with digits down to 10^last, but no more than a table can hold."""
    if abs(value) >= LEAST_PLAIN or last >= -MOST_DECIMALS:
        text = f"{value:.{min(max(-last, 0), MOST_DECIMALS)}f}"
    else:
        exponent = math.floor(math.log10(abs(value))) if value else last
        # A decimal number keeps its last digit where it is rounded up to a power of ten.
        text = f"{Decimal(value).quantize(Decimal((0, (1,), min(last, exponent)))):e}"
    return text.replace("-", "−", 1) if text.startswith("-") else text


@dataclass(frozen=True)
class PaperTable:
    """Methods × metrics; `cells` has None where a method has no value.

    Examples
    --------
    >>> from malus.reports.tables import sample
    >>> print(paper_table(sample.table(), ["nmse"]).text("markdown").splitlines()[0])
    | method | NMSE ↓ | images |
    """

    methods: tuple[str, ...]
    metrics: tuple[MetricDefinition, ...]
    cells: dict[tuple[str, str], Cell]

    @property
    def has_guess(self) -> bool:
        """Whether the trivial guess is among the methods."""
        return TRIVIAL in self.methods

    def best(self, metric: MetricDefinition) -> float:
        """The best value among methods that have one on every scene; NaN where none is better.

        A method that left scenes out is not compared: those may have been the hard ones.
        """
        cells = [cell for (_, name), cell in self.cells.items() if name == metric.name]
        most = max((cell.images for cell in cells), default=0)
        values = [c.value for c in cells if c.images == most and not math.isnan(c.value)]
        return metric.best(values) if metric.better and values else math.nan

    def is_best(self, method: str, metric: MetricDefinition) -> bool:
        """Whether a method has the best value of a metric."""
        cell = self.cells.get((method, metric.name))
        most = max(c.images for (_, name), c in self.cells.items() if name == metric.name)
        return cell is not None and cell.images == most and cell.value == self.best(metric)

    def images(self, method: str) -> str:
        """Number of scenes behind a method's cells: one number, or a range."""
        counts = {cell.images for (name, _), cell in self.cells.items() if name == method}
        ends = sorted({min(counts, default=0), max(counts, default=0)})
        return "–".join(map(str, ends))

    def text(self, form: str) -> str:
        """The table as text, with a line break at its end: latex, markdown or csv.

        Raises
        ------
        InputError
            Another format than latex, markdown or csv.
        """
        return lookup(form, _FORMS, "table", "the name of a format")(self)


def paper_table(table: pd.DataFrame, metrics: Sequence[str] = ()) -> PaperTable:
    """Mean of every metric over the scenes of a results table, method by method.

    Parameters
    ----------
    table : DataFrame
        Of results.
    metrics : names of metrics as the table has them; by default NMSE, skill and all that the suite
        asked for, without single components, bins and standard deviations

    Raises
    ------
    InputError
        A metric that the table does not have.

    Returns
    -------
    PaperTable
        The trivial guess first, where it was scored.
    """
    there = dict.fromkeys(distinct(table["metric"]))
    for name in metrics:
        lookup(name, there, "metric", "the name of a metric of these results")
    names = list(metrics) or default_metrics(table)
    cells: dict[tuple[str, str], Cell] = {}
    for name in names:
        for method, rows in overall_rows(table, name).groupby("method", sort=False, observed=True):
            if not_finite(table, rows).any():
                cells[str(method), name] = Cell(math.nan, math.nan, int(rows["value"].count()))
                continue
            cell = _cell(name, rows["value"].dropna().to_numpy(np.float64))
            if cell is not None:
                cells[str(method), name] = cell
    if not cells:
        raise InputError("table", "metrics over all bands and angles", "none", "score methods")
    filled = {name for _, name in cells}
    scored = {method for method, _ in cells}
    methods = [method for method in distinct(table["method"]) if method in scored]
    return PaperTable(
        tuple(sorted(methods, key=lambda method: method != TRIVIAL)),
        tuple(replace(definition_of(name), name=name) for name in names if name in filled),
        cells,
    )


def default_metrics(table: pd.DataFrame) -> list[str]:
    """NMSE, skill and what the suite asked for, without single components, bins and deviations."""
    return [name for name in distinct(table["metric"]) if _shown_by_default(name)]


def _shown_by_default(name: str) -> bool:
    definition = definition_of(name)
    asked_for = bool(definition.asked_for) or definition.name not in _DEFINED
    detail = any(fnmatchcase(name, pattern) for pattern in _IN_DETAIL)
    return name in _BY_DEFAULT or (asked_for and not detail)


def _is_median(name: str) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in _MEDIANS)


def _cell(name: str, values: Float64Array) -> Cell | None:
    """Mean and its standard error over scenes; None without a value."""
    count = len(values)
    if count == 0:
        return None
    finite = bool(np.isfinite(values).all())
    if _is_median(name):
        return Cell(float(np.median(values)), _error_of_median(values), count)
    error = float(values.std(ddof=1)) / math.sqrt(count) if finite and count > 1 else math.nan
    return Cell(float(values.mean()), error, count)


def _error_of_median(values: Float64Array) -> float:
    """Standard error by resampling the scenes; the same in every run."""
    if len(values) < 2:
        return math.nan
    drawn = np.random.default_rng(0).choice(values, (RESAMPLES, len(values)))
    return float(np.median(drawn, axis=1).std(ddof=1))


def _markdown(table: PaperTable) -> str:
    heads = ["method", *(_head(metric, markdown) for metric in table.metrics), "images"]
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)]]
    for method in table.methods:
        cells = [f"**{text}**" if best else text for text, best in _texts(table, method)]
        lines.append([markdown(method), *cells, table.images(method)])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _latex(table: PaperTable) -> str:
    heads = ["method", *(_head(metric) for metric in table.metrics), "images"]
    lines = []
    for method in table.methods:
        cells = [
            f"\\textbf{{{_escaped(text)}}}" if best else _escaped(text)
            for text, best in _texts(table, method)
        ]
        lines.append(" & ".join([_escaped(method), *cells, _escaped(table.images(method))]))
    rules = [
        f"\\begin{{tabular}}{{l{'r' * (len(heads) - 1)}}}", "\\toprule",
        " & ".join(map(_escaped, heads)) + r" \\", "\\midrule",
        *(line + r" \\" for line in lines), "\\bottomrule", "\\end{tabular}",
    ]  # fmt: skip
    return "\n".join(rules) + "\n"


def _csv(table: PaperTable) -> str:
    lines = [
        {
            "method": method, "metric": metric.name, "better": metric.better, "unit": metric.unit,
            "value": cell.value, "standard_error": cell.error, "images": cell.images,
        }
        for method in table.methods
        for metric in table.metrics
        if (cell := table.cells.get((method, metric.name)))
    ]  # fmt: skip
    return as_csv(pd.DataFrame(lines))


def _texts(table: PaperTable, method: str) -> list[tuple[str, bool]]:
    """Cells of a method as text, and whether each is the best of its column."""
    texts = []
    for metric in table.metrics:
        cell = table.cells.get((method, metric.name))
        text = NO_NUMBER if cell is None else str(cell)
        texts.append((text, table.is_best(method, metric)))
    return texts


def _head(metric: MetricDefinition, escaped: Callable[[str], str] = str) -> str:
    """Label, unit and direction of a column; its own name where a label stands for several."""
    general = next((one for one in DEFINITIONS if one.matches(metric.name)), metric)
    one_of_several = "*" in general.name and metric.name != general.name.removesuffix("*")
    label = metric.name if one_of_several else metric.label
    median = " (median)" if _is_median(metric.name) else ""
    unit = f" [{escaped(metric.unit)}]" if metric.unit else ""
    return f"{escaped(_project(metric) + label)}{median}{unit} {metric.arrow}".rstrip()


def _project(metric: MetricDefinition) -> str:
    """Name of the profile that a metric is of: several have a PSNR."""
    profile = metric.asked_for.removeprefix("profile:")
    return f"{profile} " if profile != metric.asked_for else ""


_LATEX = {
    "\\": r"\textbackslash{}", "_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#", "$": r"\$",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "↑": r"$\uparrow$", "↓": r"$\downarrow$", "→": r"$\to$", "±": r"$\pm$", "∞": r"$\infty$",
    "−": r"$-$", "–": "--", "°": r"\textdegree{}", "Δ": r"$\Delta$", "ϑ": r"$\vartheta$",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}",
}  # fmt: skip


def _escaped(text: str) -> str:
    """A text for LaTeX: nothing in it becomes a command, and no letter needs another font."""
    return "".join(_LATEX.get(letter, letter) for letter in printable(text))


_FORMS: dict[str, Callable[[PaperTable], str]] = {
    "latex": _latex,
    "markdown": _markdown,
    "csv": _csv,
}
_DEFINED = frozenset(definition.name for definition in DEFINITIONS)
