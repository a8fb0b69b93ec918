"""Everything that is made from a run, as files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from malus.bench.results import write_whole
from malus.reports.colour_errors import table1
from malus.reports.drawings import drawings
from malus.reports.page import PAGE, page
from malus.reports.skills import by_light_and_body
from malus.reports.source import Source
from malus.reports.summary import summary
from malus.reports.tables import ResultsLike


def write_report(results: ResultsLike, out: Path) -> list[Path]:
    """Write the report of a run into its folder: page, summary, figures, the CSV behind each.

    Every file is written whole or not at all. What else lies in the folder (`examples/`) is shown
    on the page.

    Parameters
    ----------
    results : pair of table and run
    out : path of a folder; made if missing

    Returns
    -------
    list of Path
        The files, in the order in which they were written.

    Examples
    --------
    >>> import tempfile
    >>> from types import SimpleNamespace
    >>> from malus.reports import sample
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     results = SimpleNamespace(table=sample.table(), run=sample.run())
    ...     names = [path.name for path in write_report(results, Path(folder))]
    >>> names[:3], names[-2:]
    (['figure5.svg', 'figure5.png', 'figure5.csv'], ['summary.md', 'report.html'])
    """
    written: list[Path] = []

    def keep(name: str, write: Callable[[Path], object]) -> None:
        write_whole(out / name, write)
        written.append(out / name)

    figures = tuple(drawings(results.table))
    for drawing in figures:
        keep(f"{drawing.name}.svg", _text(drawing.svg))
        keep(f"{drawing.name}.png", _bytes(drawing.png))
        keep(f"{drawing.name}.csv", _text(drawing.numbers.to_csv(index=False)))
    keep("errors.csv", _text(by_light_and_body(results.table).to_csv(index=False)))
    colours = table1(results.table)
    if len(colours):
        keep("table1.csv", _text(colours.to_csv(index=False)))
    names = [f"{drawing.name}.png" for drawing in figures]
    keep("summary.md", _text(summary(results.table, results.run, names)))
    keep(PAGE, _text(page(Source(results.table, results.run, out, figures))))
    return written


def _text(text: str) -> Callable[[Path], object]:
    # Line ends as they are, so that the bytes are the same on every system.
    return lambda path: path.write_text(text, encoding="utf-8", newline="\n")


def _bytes(data: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(data)
