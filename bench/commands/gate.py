"""`malus gate`: the accuracy of a run against a reviewed baseline."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from malus.bench.commands.options import FOLDER, LOCAL_FILE, command


@command("gate")
@click.argument("results", type=FOLDER)
@click.option("--baseline", required=True, type=LOCAL_FILE, help="TOML file with rules and values.")
@click.option("--junit", type=LOCAL_FILE, help="Write JUnit XML here.")
@click.option("--summary", type=LOCAL_FILE, help="Write a Markdown summary here.")
@click.option("--update", is_flag=True, help="Make these results the baseline; keep its rules.")
def gate_command(
    results: Path, baseline: Path, junit: Path | None, summary: Path | None, update: bool
) -> None:
    """Exit 1 where accuracy in the folder RESULTS got worse by more than noise and tolerance.

    Runs with other seeds are compared too; with the baseline's seed the comparison is paired and
    sees far smaller changes.

    \b
    Example:
      malus gate results/quick --baseline baseline.toml --summary gate.md
    """
    if update:
        if junit or summary:
            raise click.UsageError("--junit and --summary are of a comparison: leave out --update")
        _update(results, baseline)
    elif not _compare(results, baseline, junit, summary):
        sys.exit(1)


def _compare(results: Path, baseline: Path, junit: Path | None, summary: Path | None) -> bool:
    from malus.bench.commands.console import plain_console
    from malus.bench.gates.gate_report import tables
    from malus.bench.public.gates import gate

    compared = gate(results, baseline, junit=junit, summary=summary)
    console = plain_console()
    for table in tables(compared.comparisons):
        console.print(table)
    console.print(compared.headline)
    return compared.passed


def _update(results: Path, path: Path) -> None:
    from malus.bench.commands.console import plain_console
    from malus.bench.gates.gate_report import tables
    from malus.bench.public.gates import update_baseline

    update = update_baseline(results, path)
    console = plain_console()
    if update.compared is not None:
        for table in tables(update.compared.comparisons):
            console.print(table)
    elif update.previous is not None:
        console.print("other scenes than before: all values are new")
    count = len(update.baseline.values)
    console.print(f"{count} values written to {path}; review them")
