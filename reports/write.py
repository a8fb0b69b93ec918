"""Write the report of a run or of a study: page, summary, figures and tables as files."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from malus.reports.capture_report import capture_summary, of_captures
from malus.reports.figures.beside import Draughtsman, Elsewhere
from malus.reports.figures.drawings import Drawing, drawings, ladders, picture
from malus.reports.page import PAGE, page
from malus.reports.sections import comparison as compared_section
from malus.reports.sections import of_run, of_study
from malus.reports.source import Source, read_study
from malus.reports.summary import summary
from malus.reports.tables.compared_runs import RunComparison
from malus.reports.tables.formats import as_csv
from malus.reports.tables.metric_definitions import definition_of
from malus.reports.tables.rows import ResultsLike, distinct
from malus.reports.tables.skills import by_light_and_body
from malus.scenes.core.files import write_whole

_BODY = "(_(polarised|none|mixed|unknown)_body)?"
_DRAWN = rf"(figure5{_BODY}(_by_light)?|(angles|figure9){_BODY}|ladder)\.(svg|csv|png)"
_NAMES = re.compile(rf"{_DRAWN}|{re.escape(PAGE)}|summary\.md|metrics\.json|(errors|table1)\.csv")


def is_report_file(name: str) -> bool:
    """Whether the report of some run has a file of that name.

    Examples
    --------
    >>> is_report_file("figure9_polarised_body.svg"), is_report_file("figure9_of_mine.svg")
    (True, False)
    """
    return _NAMES.fullmatch(name) is not None


def write_report(
    results: ResultsLike,
    out: Path,
    beside: Sequence[Path] = (),
    png: bool = False,
    elsewhere: Elsewhere | None = None,
) -> list[Path]:
    """Write the report of a run into its folder: page, summary, figures, the CSV behind each.

    Every file is written whole or not at all; those of an earlier report that this one lacks are
    removed. The images in its `examples/` are shown on the page.

    Parameters
    ----------
    results : pair of table and run
    out : path of a folder; made if missing
    beside : paths of folders of studies that the page shall show too
    png : bool
        Write every figure as PNG too.
    elsewhere : function, optional
        Draws figures in another process meanwhile: it is called with a function and its arguments,
        and yields what that yields there.

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
    (['errors.csv', 'metrics.json', 'figure5.svg'], ['summary.md', 'report.html'])
    """
    files = _Files(out)
    # No report shows single bands: without their rows, half of the table, all is found sooner.
    table, run = results.table[results.table["band_nm"].isna()], results.run
    budget = tuple(ladders(table))
    drawn = Draughtsman([*drawings(table), *budget], png, elsewhere).drawings
    figures = drawn[: len(drawn) - len(budget)]
    files.keep("errors.csv", as_csv(by_light_and_body(table)))
    source = Source(table, run, out, figures, drawn[len(figures) :], tuple(beside))
    if len(source.colours):
        files.keep("table1.csv", as_csv(source.colours))
    known = [asdict(definition_of(name)) for name in distinct(table["metric"])]
    files.keep("metrics.json", json.dumps(known, indent=1, ensure_ascii=False) + "\n")
    summarise, parts = (capture_summary, of_captures) if "captures" in run else (summary, of_run)
    text = summarise(table, run, [f"{drawing.name}.svg" for drawing in drawn], source.colours)
    sections = parts(source)  # what shows no figure first: meanwhile those are drawn
    for drawing in drawn:
        files.keep_drawing(drawing)
    files.keep("summary.md", text)
    suite = run["suite"]
    files.keep(PAGE, page(suite["name"], suite.get("description", ""), sections))
    files.remove_others(is_report_file)
    return files.written


def write_study(out: Path, png: bool = False) -> list[Path]:
    """Write the page of a study into its folder, and its figure if it has one.

    Parameters
    ----------
    out : path of a folder that `malus run precision` or `malus run stress` made
    png : bool
        Write the figure as PNG too.

    Raises
    ------
    InputError
        If there is no study in the folder.
    """
    files = _Files(out)
    study = read_study(out)
    for drawing in study.drawings:
        files.keep_drawing(drawing)
        if png:
            files.keep(f"{drawing.name}.png", picture(drawing.draw, with_png=True).png or b"")
    files.keep(PAGE, page(study.run["study"], study.run["description"], of_study(study)))
    files.remove_others({f"{drawing.name}.png" for drawing in study.drawings}.__contains__)
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
        self.keep(f"{drawing.name}.svg", drawing.picture.svg)
        if drawing.picture.png is not None:
            self.keep(f"{drawing.name}.png", drawing.picture.png)
        self.keep(f"{drawing.name}.csv", as_csv(drawing.numbers))

    def remove_others(self, could_write: Callable[[str], bool]) -> None:
        """Remove what an earlier report wrote under such a name and this one did not."""
        written = {path.name for path in self.written}
        for path in list(self.folder.iterdir()):
            if could_write(path.name) and path.name not in written and path.is_file():
                with contextlib.suppress(FileNotFoundError):  # of two reports one comes too late
                    path.unlink()
