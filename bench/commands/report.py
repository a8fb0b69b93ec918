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
@click.option(
    "--table",
    "form",
    type=click.Choice(("latex", "markdown", "csv")),
    help="Print a table of methods × metrics to paste instead, and write nothing.",
)
@click.option(
    "--metric",
    "metrics",
    multiple=True,
    help="With --table: a metric to show; may be repeated [default: NMSE, skill and what the suite"
    " asked for].",
)
@click.option("--png", is_flag=True, help="Write every figure as PNG too.")
def report_command(
    results: Path, beside: tuple[Path, ...], form: str | None, metrics: tuple[str, ...], png: bool
) -> None:
    """Make the figures, summary and page of a finished run again, from its folder RESULTS.

    With --table it prints one table instead: the trivial guess first, mean ± standard error over
    scenes (of a skill the median), the best in bold among methods that work on every scene.

    \b
    Example:
      malus report results/fig5
      malus report results/fig5 --table latex
    """
    from malus.scenes.core.errors import InputError

    if form is not None:
        if png or beside:
            option = "--png" if png else "--with"
            raise InputError(option, "no --table beside it", "--table", "a table has no figures")
        _print_table(results, form, metrics)
        return
    if metrics:
        raise InputError("--metric", "--table beside it", "no --table", "give both or neither")
    from malus.bench.running.inside_worker import DRAWING, import_all
    from malus.bench.running.worker_process import WorkerProcess

    with WorkerProcess() as worker:
        several_cores = (os.cpu_count() or 1) > 1
        if several_cores:  # it imports what draws figures while this process reads
            worker.begin(import_all, *DRAWING)
        import_all(DRAWING[0])  # this process draws, too
        from malus.bench.public.report import report

        written = report(results, beside, png, worker if several_cores else None)

    from malus.bench.commands.console import plain_console

    plain_console().print(f"{len(written)} files written to {results}")


def _print_table(folder: Path, form: str, metrics: tuple[str, ...]) -> None:
    from malus.bench.public.tables import table

    methods = table(folder, metrics)
    click.echo(methods.text(form), nl=False)
    if not methods.has_guess:
        click.echo("the trivial guess was not scored: add the method `unpolarised`", err=True)
