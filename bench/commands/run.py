"""`malus run`: the suite with the user's overrides, progress, the report and the final table."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from malus.bench.commands.results_table import final_table
from malus.bench.running.cluster import engine
from malus.bench.running.overrides import overridden
from malus.bench.running.progress import with_progress
from malus.bench.running.results import Results, headline, read_results
from malus.bench.running.runner import run
from malus.bench.running.worker_process import TIMEOUT_SECONDS
from malus.renderers.variant import choose
from malus.scenes.suite import load_suite


@dataclass(frozen=True)
class How:
    """How a run shall be done: where the work goes, whether earlier failures are tried, seconds
    that a family may take.
    """

    workers: int | None = None
    scheduler: str | None = None
    retry_failed: bool = False
    timeout: float = TIMEOUT_SECONDS


def run_command(
    name: str,
    out: Path | None,
    overrides: dict[str, Any],
    backend: str,
    as_json: bool,
    how: How = How(),
) -> int:
    """Run a suite for the command line; the number of families of which something failed."""
    suite = load_suite(name)
    variant = choose(backend)
    suite = overridden(suite, overrides, variant)
    folder = out if out is not None else Path("results") / suite.name
    console = Console(stderr=True)
    console.print(f"{suite.name}: {suite.description}", highlight=False)
    console.print(
        f"variant {variant.name} ({variant.reason}), {suite.camera.resolution}² pixels, "
        f"{suite.sampling.samples} samples a pixel",
        highlight=False,
    )
    with engine(variant, how.workers, how.scheduler, how.timeout) as chosen:
        results = with_progress(
            console,
            "families",
            lambda show: run(suite, folder, variant, show, chosen, how.retry_failed),
        )
    from malus.reports.write import write_report

    write_report(results, folder)
    failed = int(results.run["families_failed"])
    if as_json:
        numbers = {"out": str(folder), "methods": headline(results), "families_failed": failed}
        sys.stdout.write(json.dumps(numbers) + "\n")
    else:
        Console().print(final_table(results))
        console.print(f"written to {folder}", highlight=False)
    if failed:
        _tell_failed(failed, results, folder, console)
    return failed


def _tell_failed(failed: int, results: Results, folder: Path, console: Console) -> None:
    console.print(
        f"{failed} of {results.run['families']} families failed, wholly or for a method; the first:"
        f" {results.run['failures'][0]}. `malus status {folder}` tells all; a next run leaves them"
        " out, with --retry-failed it tries them again",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )


def report_again(folder: Path, beside: Sequence[Path] = ()) -> None:
    """Write the report of finished results or of a study again, with the studies in `beside`."""
    from malus.reports.source import is_study
    from malus.reports.write import write_report, write_study

    if is_study(folder):
        written = write_study(folder)
    else:
        written = write_report(read_results(folder), folder, beside)
    Console().print(f"{len(written)} files written to {folder}", highlight=False)
