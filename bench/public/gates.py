"""Compare the accuracy of a run with a baseline, and make a run the baseline."""

from __future__ import annotations

import codecs
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from malus.bench.gates import gate as comparison
from malus.bench.gates import gate_report
from malus.bench.gates.baseline import (
    Baseline,
    default_rules,
    read_baseline,
    write_baseline,
)
from malus.bench.gates.gate import Comparison, passed, updated
from malus.bench.running.output_folder import CAPTURES
from malus.bench.running.parts import PLAN
from malus.bench.running.results import Results, read_results
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import write_text
from malus.scenes.core.remote import as_path, is_here
from malus.scenes.core.result_files import EXAMPLES, HEADLINES, PARTS, RUN, TABLE

_OF_A_RUN = frozenset({RUN, TABLE, HEADLINES, PLAN, PARTS, EXAMPLES, CAPTURES})

_BEGINNINGS = {
    "junit": re.compile(rb"(<\?xml[^>]*\?>\s*)?<testsuites?\b"),
    "summary": re.compile(rb"[#|<>*!:-]"),
}
"""How a file begins that a gate may replace: JUnit's XML, or Markdown of any kind."""

_MARKDOWN = ("", ".md", ".markdown")
"""Suffixes of Markdown: the file behind $GITHUB_STEP_SUMMARY has none."""


@dataclass(frozen=True)
class GateResult:
    """Every comparison of a run with a baseline.

    Attributes
    ----------
    comparisons : tuple of Comparison
        One a metric, method, knowledge, body, light and surface of the baseline, in its order,
        then those that the baseline lacks.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> options = {"resolution": 8, "samples": 2, "methods": ["eq8"], "report": False}
    >>> results = malus.run("quick", folder, **options)
    >>> update = malus.update_baseline(results, f"{folder}/baseline.toml")
    >>> print(malus.gate(results, update.baseline).headline)
    gate passed: ... same (... paired)
    """

    comparisons: tuple[Comparison, ...]

    @property
    def passed(self) -> bool:
        """Whether accuracy got worse nowhere by more than noise and tolerance."""
        return passed(self.comparisons)

    @property
    def headline(self) -> str:
        """The outcome in one sentence."""
        return gate_report.headline(self.comparisons)

    def markdown(self) -> str:
        """A summary with tables, as Markdown."""
        return gate_report.markdown(self.comparisons)

    def junit(self) -> str:
        """The comparisons as test cases, in JUnit's XML."""
        return gate_report.junit(self.comparisons)


def gate(
    results: Results | Path | str,
    baseline: Baseline | Path | str,
    *,
    junit: Path | str | None = None,
    summary: Path | str | None = None,
) -> GateResult:
    """Compare the accuracy of a finished run with a reviewed baseline.

    Runs with other seeds are compared too; with the baseline's seed the comparison is paired and
    sees far smaller changes.

    Parameters
    ----------
    results : Results, or the path or URL of a run's folder
    baseline : Baseline, or the path of its TOML file
    junit, summary : path, optional
        Files to write the comparisons to, as JUnit's XML and as Markdown: new ones, empty ones, or
        such files of an earlier gate.

    Returns
    -------
    GateResult
        `passed` is false where accuracy got worse by more than noise and tolerance.

    Raises
    ------
    InputError
        Results or a baseline that cannot be read, a run of other scenes than the baseline's, a
        file that cannot be written, or in whose place something else lies.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> options = {"resolution": 12, "samples": 4, "methods": ["eq8"], "report": False}
    >>> results = malus.run("quick", folder, **options)
    >>> update = update_baseline(results, f"{folder}/baseline.toml")
    >>> gate(folder, f"{folder}/baseline.toml").passed
    True
    """
    _check_targets({"junit": junit, "summary": summary}, results, baseline)
    held = baseline if isinstance(baseline, Baseline) else read_baseline(Path(baseline))
    compared = GateResult(tuple(comparison.gate(_results(results), held)))
    if junit is not None:
        write_text(Path(junit), compared.junit())
    if summary is not None:
        write_text(Path(summary), compared.markdown())
    return compared


@dataclass(frozen=True)
class BaselineUpdate:
    """A baseline that was written, beside the one that it replaces.

    Attributes
    ----------
    baseline : Baseline
        What was written: rules and values.
    previous : Baseline or None
        What the file held before; None where there was none.
    compared : GateResult or None
        The run against the previous baseline; None without one, or where its scenes are others.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> options = {"resolution": 8, "samples": 2, "methods": ["eq8"], "report": False}
    >>> results = malus.run("quick", folder, **options)
    >>> update = malus.update_baseline(results, f"{folder}/baseline.toml")
    >>> update.previous is None, update.compared is None
    (True, True)
    """

    baseline: Baseline
    previous: Baseline | None
    compared: GateResult | None


def update_baseline(results: Results | Path | str, baseline: Path | str) -> BaselineUpdate:
    """Make a finished run the baseline: write its values to a file, and keep the file's rules.

    Parameters
    ----------
    results : Results, or the path or URL of a run's folder
    baseline : path of a TOML file
        A new file gets rules for every metric.

    Returns
    -------
    BaselineUpdate
        The new baseline, and the one that it replaces.

    Raises
    ------
    InputError
        Results or a baseline that cannot be read, values that are not finite, a file that cannot
        be written.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> options = {"resolution": 8, "samples": 2, "methods": ["eq8"], "report": False}
    >>> update = update_baseline(malus.run("quick", folder, **options), f"{folder}/new.toml")
    >>> update.previous is None, sorted({value.method for value in update.baseline.values})
    (True, ['eq8'])
    """
    path = Path(baseline)
    measured = _results(results)
    old = read_baseline(path) if path.exists() else None
    new = updated(measured, old, default_rules(measured))
    compared = None
    if old is not None and old.origin.is_of(measured):
        compared = GateResult(tuple(comparison.gate(measured, old)))
    write_baseline(path, new)
    return BaselineUpdate(new, old, compared)


def _results(results: Results | Path | str) -> Results:
    return results if isinstance(results, Results) else read_results(as_path(results))


def _check_targets(
    named: Mapping[str, Path | str | None], results: Results | Path | str, baseline: Any
) -> None:
    """Refuse to write a report over the baseline, the run, or a file that is none of a gate."""
    targets = {name: Path(path) for name, path in named.items() if path is not None}
    taken = {} if isinstance(baseline, Baseline) else {"the baseline": Path(baseline)}
    folder = None if isinstance(results, Results) else as_path(results)
    for name, path in targets.items():
        for what, other in taken.items():
            if _is_same(path, other):
                _refuse(name, "a file of its own", f"{path}, {what}")
        if folder is not None and is_here(folder) and _is_of_run(path, folder):
            _refuse(name, "a file that no run writes", f"{path}, of the run itself")
        if path.exists() and not _is_replaceable(name, path):
            kind = "JUnit's XML" if name == "junit" else "Markdown, such as gate.md"
            _refuse(name, f"a new file, or {kind}", f"{path}, which is none")
        taken[f"the same as `{name}`"] = path


def _refuse(name: str, expected: str, found: str) -> None:
    raise InputError(name, expected, found, "choose another name; nothing was written")


def _is_same(one: Path, other: Path) -> bool:
    if one.exists() and other.exists():
        return one.samefile(other)
    return one.resolve() == other.resolve()


def _is_of_run(path: Path, folder: Path) -> bool:
    """Whether a path is that of a file of a run or of its report, there already or not."""
    try:
        first, *others = path.resolve().relative_to(folder.resolve()).parts
    except ValueError:  # elsewhere, or the folder itself
        return False
    # Imported here: only who writes into the run's own folder waits for it.
    from malus.reports.write import is_report_file

    return first in _OF_A_RUN or (not others and is_report_file(first))


def _is_replaceable(name: str, path: Path) -> bool:
    """Whether a file is empty, or begins as one that a gate writes there."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        beginning = file.read(1000).removeprefix(codecs.BOM_UTF8).lstrip()
    is_kind = name == "junit" or path.suffix.lower() in _MARKDOWN
    return not beginning or (is_kind and _BEGINNINGS[name].match(beginning) is not None)
