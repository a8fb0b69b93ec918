"""Fit real captures, score methods on their unpolarised images, and write the report."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from malus.bench.running import captures as running
from malus.bench.running.capture_suite import CaptureSuite, load_captures
from malus.bench.running.progress import Progress, silent
from malus.bench.running.results import Results
from malus.reports.write import write_report
from malus.scenes.core.registry import several
from malus.scenes.core.remote import as_path


def run_captures(
    captures: CaptureSuite | Path | str | Sequence[Path | str],
    out: Path | str | None = None,
    *,
    methods: Sequence[str] = (),
    report: bool = True,
    progress: Progress = silent,
) -> Results:
    """Fit real pictures taken through a polariser, and score methods that see only their mean.

    Every capture gives the sinusoid of Equation 1 by least squares: I_max, I_min and ψ, the truth.
    Methods are given its unpolarised image and the mask of each object, nothing else. What fails is
    named in `Results.run["failures"]` and left out.

    Parameters
    ----------
    captures : CaptureSuite, or the path of its TOML file, or folders of pictures, or one
        Folders are read as `read_capture` does by default, and their whole picture is the object.
    out : path of a folder, by default results/NAME
    methods : sequence of str
        Names of methods, or `package.module:object`, in place of the suite's.
    report : bool
        Write Table I, Figure 9, error maps, the summary and the page too.
    progress : function of (captures done, captures in all, name of the next)

    Returns
    -------
    Results
        A table like that of a run, one row a capture, method and metric: `light` is the group,
        `surface` the capture's name.

    Raises
    ------
    InputError
        A file or folder that cannot be read or written, an unknown method, a value that is not
        valid, or not a single capture that can be scored.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import PIL.Image
    >>> folder = Path(tempfile.mkdtemp())
    >>> (folder / "card").mkdir()
    >>> for angle, code in ((0, 120), (45, 90), (90, 60), (135, 90)):
    ...     grey = np.full((8, 8), code, np.uint8)
    ...     PIL.Image.fromarray(grey).save(folder / "card" / f"pol_{angle:03d}.png")
    >>> results = run_captures([folder / "card"], folder / "out", methods=["unpolarised"],
    ...                        report=False)
    >>> results.table.query("metric == 'skill' and angle_deg.isna()").value.tolist()
    [0.0]
    """
    suite = _suite(captures)
    if methods:
        suite = suite.model_copy(update={"methods": several(methods)})
    folder = as_path(out) if out is not None else Path("results") / suite.name
    results = running.run_suite(suite, folder, progress)
    if report:
        write_report(results, folder)
    return results


def _suite(captures: CaptureSuite | Path | str | Sequence[Path | str]) -> CaptureSuite:
    if isinstance(captures, CaptureSuite):
        return captures
    if isinstance(captures, Path | str) and not Path(captures).is_dir():
        return load_captures(captures)
    return CaptureSuite.of_folders(several(captures))
