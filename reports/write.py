"""Write the report of a run or of a study: page, summary, figures and tables as files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from malus.reports.capture_report import capture_summary, of_captures
from malus.reports.figures.drawings import Drawing, drawings, ladders
from malus.reports.page import PAGE, page
from malus.reports.sections import comparison as compared_section
from malus.reports.sections import of_run, of_study
from malus.reports.source import Source, read_study
from malus.reports.summary import summary
from malus.reports.tables.colour_errors import table1
from malus.reports.tables.compared_runs import RunComparison
from malus.reports.tables.metric_definitions import definition_of
from malus.reports.tables.rows import ResultsLike, distinct
from malus.reports.tables.skills import by_light_and_body
from malus.scenes.core.files import write_whole


def write_report(results: ResultsLike, out: Path, beside: Sequence[Path] = ()) -> list[Path]:
    """Write the report of a run into its folder: page, summary, figures, the CSV behind each.

    Every file is written whole or not at all. The images in its `examples/` are shown on
    the page.

    Parameters
    ----------
    results : pair of table and run
    out : path of a folder; made if missing
    beside : paths of folders of studies that the page shall show too

    Returns
    -------
    list of Path
        The files, in the order in which they were written.

    Examples
    --------
    >>> import tempfile
    >>> from types import SimpleNamespace
    >>> from malus.reports.tables import sample
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     results = SimpleNamespace(table=sample.table(), run=sample.run())
    ...     names = [path.name for path in write_report(results, Path(folder))]
    >>> names[:3], names[-2:]
    (['figure5.svg', 'figure5.png', 'figure5.csv'], ['summary.md', 'report.html'])
    """
    files = _Files(out)
    figures = tuple(drawings(results.table))
    budget = tuple(ladders(results.table))
    for drawing in (*figures, *budget):
        files.keep_drawing(drawing)
    files.keep("errors.csv", by_light_and_body(results.table).to_csv(index=False))
    known = [asdict(definition_of(name)) for name in distinct(results.table["metric"])]
    files.keep("metrics.json", json.dumps(known, indent=1, ensure_ascii=False) + "\n")
    colours = table1(results.table)
    if len(colours):
        files.keep("table1.csv", colours.to_csv(index=False))
    names = [f"{drawing.name}.png" for drawing in (*figures, *budget)]
    is_captures = "captures" in results.run
    summarise = capture_summary if is_captures else summary
    files.keep("summary.md", summarise(results.table, results.run, names))
    suite = results.run["suite"]
    source = Source(results.table, results.run, out, figures, budget, tuple(beside))
    sections = of_captures(source) if is_captures else of_run(source)
    files.keep(PAGE, page(suite["name"], suite.get("description", ""), sections))
    return files.written


def write_study(out: Path) -> list[Path]:
    """Write the page of a study into its folder, and its figure if it has one.

    Parameters
    ----------
    out : path of a folder that `malus run precision` or `malus run stress` made

    Raises
    ------
    InputError
        If there is no study in the folder.
    """
    files = _Files(out)
    study = read_study(out)
    for drawing in study.drawings:
        files.keep_drawing(drawing)
    files.keep(PAGE, page(study.run["study"], study.run["description"], of_study(study)))
    return files.written


def write_comparison(comparison: RunComparison, out: Path) -> list[Path]:
    """Write a comparison of runs into a folder: its page, and all numbers as JSON."""
    files = _Files(out)
    files.keep("comparison.json", json.dumps(comparison.numbers(), indent=1) + "\n")
    title = "Comparison of runs"
    files.keep(PAGE, page(title, ", ".join(comparison.names), [compared_section(comparison)]))
    return files.written


@dataclass
class _Files:
    """Files of a folder, each written whole or not at all."""

    folder: Path
    written: list[Path] = field(default_factory=list)

    def keep(self, name: str, content: str | bytes) -> None:
        # Line ends as they are, so that the bytes are the same on every system.
        data = content.encode("utf-8") if isinstance(content, str) else content
        write_whole(self.folder / name, lambda path: path.write_bytes(data))
        self.written.append(self.folder / name)

    def keep_drawing(self, drawing: Drawing) -> None:
        self.keep(f"{drawing.name}.svg", drawing.svg)
        self.keep(f"{drawing.name}.png", drawing.png)
        self.keep(f"{drawing.name}.csv", drawing.numbers.to_csv(index=False))
