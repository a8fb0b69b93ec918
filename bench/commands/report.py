"""`malus report`: the report of a finished run or study, again."""

from __future__ import annotations

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
    help="With --table: a metric to show [default: NMSE, skill and what the suite asked for].",
)
def report_command(
    results: Path, beside: tuple[Path, ...], form: str | None, metrics: tuple[str, ...]
) -> None:
    """Make the figures, summary and page of a finished run again, from its folder RESULTS.

    With --table it prints one table instead: the trivial guess first, mean ± standard error over
    scenes (of a skill the median), the best in bold among methods that work on every scene.

    \b
    Example:
      malus report results/fig5
      malus report results/fig5 --table latex
    """
    if form is not None:
        _print_table(results, form, metrics)
        return
    if metrics:
        from malus.scenes.core.errors import InputError

        raise InputError("--metric", "--table beside it", "no --table", "give both or neither")
    from rich.console import Console

    from malus.bench.public.suites import report

    written = report(results, beside)
    Console().print(f"{len(written)} files written to {results}", highlight=False)


def _print_table(folder: Path, form: str, metrics: tuple[str, ...]) -> None:
    from malus.bench.public.tables import table

    methods = table(folder, metrics)
    click.echo(methods.text(form), nl=False)
    if not methods.has_guess:
        click.echo("the trivial guess was not scored: add the method `unpolarised`", err=True)
