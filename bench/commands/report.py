"""`malus report`: the report of a finished run or study, again."""

from __future__ import annotations

import os
from pathlib import Path

import click

from malus.bench.commands.options import FOLDER, command


@command("report")
@click.argument("results", type=FOLDER)
@click.option(
    "--with",
    "beside",
    multiple=True,
    type=FOLDER,
    metavar="DIR",
    help="Show the study in DIR (of `malus run precision` or `stress`) too; may be given twice.",
)
@click.option("--png", is_flag=True, help="Write every figure as PNG too.")
def report_command(results: Path, beside: tuple[Path, ...], png: bool) -> None:
    """Make the figures, summary and page of a finished run again, from its folder RESULTS.

    \b
    Example:
      malus report results/fig5
    """
    from malus.bench.running.worker_process import WorkerProcess, import_all

    with WorkerProcess() as worker:
        several_cores = (os.cpu_count() or 1) > 1
        if several_cores:  # it imports what draws figures while this process reads
            worker.begin(import_all, "malus.reports.figures.figure5")
        from malus.bench.public.report import report

        written = report(results, beside, png, worker if several_cores else None)

    from rich.console import Console

    Console().print(f"{len(written)} files written to {results}", highlight=False)
