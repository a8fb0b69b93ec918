"""Tables of finished runs: methods × metrics to paste, and what changed from run to run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from malus.bench.running.output_folder import prepare_folder
from malus.bench.running.results import Results, read_results
from malus.reports.tables.compared_runs import RunComparison
from malus.reports.tables.paper_table import PaperTable, paper_table
from malus.reports.write import write_comparison
from malus.scenes.core.errors import InputError
from malus.scenes.core.registry import several
from malus.scenes.core.remote import as_path


def table(results: Results | Path | str, metrics: Sequence[str] = ()) -> PaperTable:
    """A table of methods × metrics over all scenes, to paste into a paper.

    Parameters
    ----------
    results : Results, or the path or URL of the folder of a finished run
    metrics : sequence of str
        Names of metrics, as the results have them; by default NMSE, skill and what the suite asked
        for. `list_metrics` tells what they mean.

    Returns
    -------
    PaperTable
        The trivial guess first. `text("latex")`, `text("markdown")` and `text("csv")` write it.

    Raises
    ------
    InputError
        A folder without results, or a metric that they do not have.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> options = {"resolution": 12, "samples": 2, "metrics": ["profile:polarscale"]}
    >>> results = malus.run("quick", folder, methods=["eq8"], report=False, **options)
    >>> malus.table(results, ["polarscale_psnr"]).methods
    ('unpolarised', 'eq8')
    """
    loaded = results if isinstance(results, Results) else read_results(results)
    return paper_table(loaded.table, several(metrics))


def compare(results: Sequence[Path | str], out: Path | str | None = None) -> RunComparison:
    """Compare finished runs with the first of them: what changed beyond chance.

    Parameters
    ----------
    results : paths or URLs of the folders of two or more runs
        Of one suite, with other versions, seeds or methods, or of several suites.
    out : path or URL of a folder, optional
        Where a page and all numbers as JSON are written.

    Returns
    -------
    RunComparison
        What changed beyond chance, and the facts that differ.

    Raises
    ------
    InputError
        Fewer than two folders, one without results, nothing that two runs have in common.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folders = [tempfile.mkdtemp(), tempfile.mkdtemp()]
    >>> options = {"resolution": 8, "samples": 2, "methods": ["eq8"], "report": False}
    >>> for seed, folder in enumerate(folders):
    ...     _ = malus.run("quick", folder, seed=seed, **options)
    >>> malus.compare(folders).names == tuple(folders)
    True
    """
    if isinstance(results, str | Path):
        raise InputError("results", "a list of folders of runs", f"{results}", "name two or more")
    if len(results) < 2:
        raise InputError("results", "two or more folders of runs", str(len(results)), "name more")
    names = [str(folder) for folder in results]
    comparison = RunComparison.of(names, [read_results(folder) for folder in results])
    if not comparison.changes:
        expected = "methods, bodies and lights of both with three scenes each"
        raise InputError("results", expected, "nothing to compare", "compare other runs")
    if out is not None:
        write_comparison(comparison, prepare_folder(as_path(out), "a comparison"))
    return comparison
