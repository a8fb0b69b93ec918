"""Compare the accuracy of a run with a baseline, and make a run the baseline."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from malus.bench.gates import gate as comparison
from malus.bench.gates import gate_report
from malus.bench.gates.baseline import (
    Baseline,
    RunIdentity,
    default_rules,
    read_baseline,
    write_baseline,
)
from malus.bench.gates.gate import Comparison, passed, updated
from malus.bench.running.results import Results, read_results
from malus.scenes.core.remote import as_path


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
        Files to write the comparisons to, as JUnit's XML and as Markdown.

    Returns
    -------
    GateResult
        `passed` is false where accuracy got worse by more than noise and tolerance.

    Raises
    ------
    InputError
        Results or a baseline that cannot be read, a run of other scenes than the baseline's, a
        file that cannot be written.

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
    held = baseline if isinstance(baseline, Baseline) else read_baseline(Path(baseline))
    compared = GateResult(tuple(comparison.gate(_results(results), held)))
    if junit is not None:
        gate_report.write_text(Path(junit), compared.junit())
    if summary is not None:
        gate_report.write_text(Path(summary), compared.markdown())
    return compared


@dataclass(frozen=True)
class BaselineUpdate:
    """A baseline that was written, beside the one that it replaces.

    Attributes
    ----------
    baseline : Baseline
    previous : Baseline or None
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
    if old is not None and old.origin.scenes == RunIdentity.of(measured).scenes:
        compared = GateResult(tuple(comparison.gate(measured, old)))
    write_baseline(path, new)
    return BaselineUpdate(new, old, compared)


def _results(results: Results | Path | str) -> Results:
    return results if isinstance(results, Results) else read_results(as_path(results))
