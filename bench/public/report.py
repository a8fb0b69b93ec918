"""Write the report of a run or study again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from malus.bench.running.results import read_results
from malus.bench.running.worker_process import WorkerProcess
from malus.reports.source import is_study, read_study
from malus.reports.write import write_report, write_study
from malus.scenes.core.errors import InputError
from malus.scenes.core.registry import several
from malus.scenes.core.remote import as_path
from malus.scenes.core.result_files import RUN


def report(
    results: Path | str,
    beside: Sequence[Path | str] | Path = (),
    png: bool = False,
    worker: WorkerProcess | None = None,
) -> list[Path]:
    """Write the figures, summary and page of a finished run or study again.

    Parameters
    ----------
    results : path or URL of the folder that `run` or `run_study` wrote
    beside : paths of folders of studies, or of one, that a run's page shall show too
    png : bool
        Write every figure as PNG too.
    worker : WorkerProcess, optional
        A process that draws some of the figures.

    Returns
    -------
    list of Path
        The files, in the order in which they were written.

    Raises
    ------
    InputError
        If the folder holds neither, or its files cannot be read; scores of a published test set,
        which have a `table` alone.

    Examples
    --------
    >>> import tempfile
    >>> import malus
    >>> folder = tempfile.mkdtemp()
    >>> _ = malus.run("quick", folder, resolution=8, samples=2, methods=["eq8"], report=False)
    >>> [path.name for path in report(folder)][-1]
    'report.html'
    """
    where = as_path(results)
    if is_study(where):
        return write_study(where, png)
    studies = tuple(as_path(study) for study in several(beside))
    for study in studies:
        read_study(study)  # what is none is told before a figure is drawn
    elsewhere = None if worker is None else worker.stream
    finished = read_results(where)
    if "published" in finished.run:
        expected, found = "results of a run, of captures or of a dataset", "scores of a test set"
        raise InputError(f"results folder {where}", expected, found, "only a `table` shows them")
    _check_record(finished.run, where)
    return write_report(finished, where, studies, png, elsewhere)


_TOLD = ("finished", "versions", "machine", "seconds")
_OF_RUNS = (
    *_TOLD, "suite.renderer", "suite.wavelengths_nm", "suite.camera.resolution",
    "suite.sampling.samples", "suite.sampling.seed", "variant.name", "variant.reason",
    "interpolation_rms",
)  # fmt: skip
_OF_CAPTURES = (*_TOLD, "captures", "captures_failed", "failures")
"""Keys of a record that its page shows."""


def _check_record(run: dict[str, Any], folder: Path) -> None:
    """Refuse a record that lacks what its page shows."""
    for key in _OF_CAPTURES if "captures" in run else _OF_RUNS:
        value: Any = run
        for name in key.split("."):
            value = value.get(name) if isinstance(value, dict) else None
        if value is None:
            hint = "run the suite again: a page says how it came about"
            expected = f"the key {key} of a finished run"
            raise InputError(str(folder / RUN), expected, "none", hint)
