"""What a gate found, for people, for pull requests and for machines that read JUnit."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from xml.etree import ElementTree

from rich.markup import escape
from rich.table import Table

from malus.bench.gates.gate import FALSE_ALARM, Verdict, passed
from malus.scenes.core.errors import printable
from malus.scenes.core.files import write_whole

_MOST_LINES = 30
"""Differences shown before the rest is only counted; the JUnit file has them all."""

Row = tuple[str, ...]


def headline(verdicts: Sequence[Verdict]) -> str:
    """One line: passed or failed, and how many of what.

    Examples
    --------
    >>> headline([Verdict(("gain", "eq8", "everything", "polarised", "uniform", "rust"), "same")])
    'gate passed: 1 same (0 paired)'
    """
    counts = Counter(verdict.outcome for verdict in verdicts)
    word = "passed" if passed(verdicts) else "FAILED"
    what = ", ".join(f"{count} {outcome}" for outcome, count in counts.most_common())
    paired = sum(verdict.paired for verdict in verdicts)
    return f"gate {word}: {what or 'nothing compared'} ({paired} paired)"


def sensitivity(verdicts: Sequence[Verdict]) -> Iterator[Row]:
    """Method, metric, comparisons, failures, and the smallest change that could be seen, where."""
    compared = [v for v in verdicts if v.outcome != "new"]
    for (method, metric), group in groupby(sorted(compared, key=_method), key=_method):
        part = list(group)
        keenest = min(part, key=lambda v: v.visible if v.visible == v.visible else float("inf"))
        failures = str(sum(v.failed for v in part))
        where = ", ".join(keenest.key[3:])
        yield method, metric, str(len(part)), failures, f"{keenest.visible:.2g}", where


def differences(verdicts: Sequence[Verdict]) -> Iterator[Row]:
    """Outcome, metric, method, where, before, after, change and limit of all that changed."""
    for v in sorted(verdicts, key=lambda v: not v.failed):
        if v.outcome in ("same", "new"):
            continue
        known = () if v.key[2] == "everything" else (v.key[2],)
        where = ", ".join((*known, *v.key[3:]))
        change = f"{v.change:+.4f} ± {v.error:.4f}"
        numbers = (f"{v.before:.4f}", f"{v.after:.4f}", change, f"{v.limit:.4f}")
        yield v.outcome, v.key[0], v.key[1], where, *numbers


_SENSITIVITY = ("method", "metric", "compared", "failed", "smallest visible change", "seen in")
_DIFFERENCES = ("", "metric", "method", "where", "baseline", "now", "change", "limit")


def tables(verdicts: Sequence[Verdict]) -> Iterator[Table]:
    """For the terminal: what changed, then what could have been seen."""
    changed = list(differences(verdicts))
    if changed:
        yield _table("changes beyond noise and tolerance", _DIFFERENCES, changed[:_MOST_LINES])
    yield _table("smallest change that is seen", _SENSITIVITY, list(sensitivity(verdicts)))


def _table(title: str, columns: Row, rows: Sequence[Row]) -> Table:
    table = Table(title=title)
    for name in columns:
        table.add_column(name)
    for row in rows:
        # A light may be named after a user's file: brackets are no markup.
        table.add_row(*(escape(printable(cell)) for cell in row))
    return table


def markdown(verdicts: Sequence[Verdict]) -> str:
    """A summary for a pull request."""
    changed = list(differences(verdicts))
    lines = [f"### {headline(verdicts)}", ""]
    if changed:
        lines += [*_markdown_table(_DIFFERENCES, changed[:_MOST_LINES]), ""]
    if len(changed) > _MOST_LINES:
        lines += [f"… and {len(changed) - _MOST_LINES} more.", ""]
    lines += ["<details><summary>Smallest change that is seen</summary>", ""]
    lines += _markdown_table(_SENSITIVITY, list(sensitivity(verdicts)))
    lines += ["", f"Noise alone fails one run in {1 / FALSE_ALARM:.0f}.", "</details>", ""]
    return "\n".join(lines)


def _markdown_table(columns: Row, rows: Sequence[Row]) -> Iterator[str]:
    for row in (columns, ("---",) * len(columns), *rows):
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"


def junit(verdicts: Sequence[Verdict]) -> str:
    """JUnit XML, one test case a comparison."""
    compared = [v for v in verdicts if v.outcome != "new"]
    failures = str(sum(v.failed for v in compared))
    suite = ElementTree.Element(
        "testsuite", name="malus gate", tests=str(len(compared)), failures=failures
    )
    for verdict in compared:
        metric, method, *where = (printable(part) for part in verdict.key)
        name = f"{metric} [{', '.join(where)}]"
        case = ElementTree.SubElement(suite, "testcase", classname=f"malus.{method}", name=name)
        if verdict.failed:
            found = ElementTree.SubElement(case, "failure", message=_sentence(verdict))
            found.text = f"tolerance: {verdict.reason}"
    root = ElementTree.Element("testsuites")
    root.append(suite)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _sentence(v: Verdict) -> str:
    return (
        f"{v.outcome}: {v.before:.5f} in the baseline, {v.after:.5f} now, "
        f"change {v.change:+.5f} ± {v.error:.5f}, limit {v.limit:.5f}"
    )


def write_text(path: Path, text: str) -> None:
    """Write a report whole or not at all."""
    write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def _method(verdict: Verdict) -> tuple[str, str]:
    return verdict.key[1], verdict.key[0]
