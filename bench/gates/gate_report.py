"""Report of a gate: for the terminal, for pull requests, and as JUnit XML."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from xml.etree import ElementTree

from rich.box import SIMPLE_HEAD
from rich.table import Table

from malus.bench.gates.gate import FALSE_ALARM, Comparison, passed
from malus.scenes.core.errors import printable

_MOST_LINES = 30
"""Largest number of changes that are listed; the JUnit file has them all."""

Row = tuple[str, ...]


def headline(comparisons: Sequence[Comparison]) -> str:
    """One line: passed or failed, and how often each outcome occurred.

    Examples
    --------
    >>> key = ("gain", "eq8", "everything", "polarised", "uniform", "rust")
    >>> headline([Comparison(key, "same")])
    'gate passed: 1 same (0 paired)'
    """
    counts = Counter(comparison.outcome for comparison in comparisons)
    word = "passed" if passed(comparisons) else "FAILED"
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in counts.most_common())
    paired = sum(comparison.paired for comparison in comparisons)
    return f"gate {word}: {outcomes or 'nothing compared'} ({paired} paired)"


def sensitivity(comparisons: Sequence[Comparison]) -> Iterator[Row]:
    """Method, metric, comparisons, failures, smallest detectable change and where that is."""
    compared = [c for c in comparisons if c.outcome != "new"]
    compared.sort(key=_method_and_metric)
    for (method, metric), group in groupby(compared, key=_method_and_metric):
        of_metric = list(group)
        # NaN, of a value that is missing, is no smallest change.
        best = min(of_metric, key=lambda c: c.visible if c.visible == c.visible else float("inf"))
        failures = str(sum(c.failed for c in of_metric))
        where = ", ".join(best.key[3:])
        smallest = _NONE if math.isnan(best.visible) else f"{best.visible:.2g}"
        yield method, metric, str(len(of_metric)), failures, smallest, where


def differences(comparisons: Sequence[Comparison]) -> Iterator[Row]:
    """Outcome, metric, method, where, before, after, change and limit of all that changed."""
    for c in sorted(comparisons, key=lambda c: not c.failed):
        if c.outcome in ("same", "new"):
            continue
        metric, method, knowledge, *scenes = c.key
        where = ", ".join(scenes if knowledge == "everything" else (knowledge, *scenes))
        if math.isnan(c.limit):
            where = f"{where}: {c.reason}"
        change = _NONE if math.isnan(c.error) else f"{c.change:+.4f} ± {c.error:.4f}"
        before, after, limit = map(_number, (c.before, c.after, c.limit))
        numbers = (before, after, change, limit)
        yield c.outcome, metric, method, where, *numbers


_NONE = "–"


def _number(value: float) -> str:
    return _NONE if math.isnan(value) else f"{value:.4f}"


_SENSITIVITY = ("method", "metric", "compared", "failed", "smallest visible change", "seen in")
_BROKEN = ("method", "where", "change", "smallest visible change", "seen in")
"""Columns whose cells may take several lines."""

_DIFFERENCES = ("", "metric", "method", "where", "baseline", "now", "change", "limit")


def tables(comparisons: Sequence[Comparison]) -> Iterator[Table]:
    """Tables for the terminal: what changed, and the smallest changes that are detected."""
    changed = list(differences(comparisons))
    if changed:
        title = "changes beyond noise and tolerance, and what was not compared"
        yield _table(title, _DIFFERENCES, changed[:_MOST_LINES])
    yield _table("smallest change that is seen", _SENSITIVITY, list(sensitivity(comparisons)))


def _table(title: str, columns: Row, rows: Sequence[Row]) -> Table:
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name in columns:
        # On a narrow terminal names are broken, so that no word and no number is cut.
        table.add_column(name, no_wrap=name not in _BROKEN, overflow="fold")
    for row in rows:
        table.add_row(*(printable(cell) for cell in row))
    return table


def markdown(comparisons: Sequence[Comparison]) -> str:
    """Summary for a pull request, as Markdown."""
    changed = list(differences(comparisons))
    lines = [f"### {headline(comparisons)}", ""]
    if changed:
        lines += [*_markdown_table(_DIFFERENCES, changed[:_MOST_LINES]), ""]
    if len(changed) > _MOST_LINES:
        lines += [f"… and {len(changed) - _MOST_LINES} more.", ""]
    lines += ["<details><summary>Smallest change that is seen</summary>", ""]
    lines += _markdown_table(_SENSITIVITY, list(sensitivity(comparisons)))
    lines += ["", f"Noise alone fails one run in {1 / FALSE_ALARM:.0f}.", "</details>", ""]
    return "\n".join(lines)


def _markdown_table(columns: Row, rows: Sequence[Row]) -> Iterator[str]:
    for row in (columns, ("---",) * len(columns), *rows):
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"


def junit(comparisons: Sequence[Comparison]) -> str:
    """JUnit XML with one test case for each comparison."""
    compared = [c for c in comparisons if c.outcome != "new"]
    failures = str(sum(c.failed for c in compared))
    skipped = str(sum(c.outcome == "not told" for c in compared))
    suite = ElementTree.Element(
        "testsuite", name="malus gate", tests=str(len(compared)), failures=failures, skipped=skipped
    )
    for comparison in compared:
        metric, method, *where = (printable(part) for part in comparison.key)
        name = f"{metric} [{', '.join(where)}]"
        case = ElementTree.SubElement(suite, "testcase", classname=f"malus.{method}", name=name)
        if comparison.failed:
            failure = ElementTree.SubElement(case, "failure", message=_sentence(comparison))
            if not math.isnan(comparison.limit):
                failure.text = f"tolerance: {comparison.reason}"
        elif comparison.outcome == "not told":
            ElementTree.SubElement(case, "skipped", message=_sentence(comparison))
    root = ElementTree.Element("testsuites")
    root.append(suite)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _sentence(c: Comparison) -> str:
    if math.isnan(c.limit):
        before, after = map(_number, (c.before, c.after))
        return f"{c.outcome}: {before} in the baseline, {after} now: {c.reason}"
    return (
        f"{c.outcome}: {c.before:.5f} in the baseline, {c.after:.5f} now, "
        f"change {c.change:+.5f} ± {c.error:.5f}, limit {c.limit:.5f}"
    )


def _method_and_metric(comparison: Comparison) -> tuple[str, str]:
    return comparison.key[1], comparison.key[0]
