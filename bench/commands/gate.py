"""`malus gate`: options and what is printed; the judgement is in `gate`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from malus.bench.commands.options import PLACE

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command("gate")
@click.argument("results", type=PLACE)
@click.option("--baseline", required=True, type=_FILE, help="TOML file with rules and values.")
@click.option("--junit", type=_FILE, help="Write JUnit XML here.")
@click.option("--summary", type=_FILE, help="Write a Markdown summary here.")
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
        _update(results, baseline)
    elif not _judge(results, baseline, junit, summary):
        sys.exit(1)


def _judge(folder: Path, path: Path, junit: Path | None, summary: Path | None) -> bool:
    from rich.console import Console

    from malus.bench.gates import gate_report
    from malus.bench.gates.baseline import read_baseline
    from malus.bench.gates.gate import gate, passed
    from malus.bench.running.results import read_results

    verdicts = gate(read_results(folder), read_baseline(path))
    console = Console()
    for table in gate_report.tables(verdicts):
        console.print(table)
    console.print(gate_report.headline(verdicts), highlight=False)
    if junit:
        gate_report.write_text(junit, gate_report.junit(verdicts))
    if summary:
        gate_report.write_text(summary, gate_report.markdown(verdicts))
    return passed(verdicts)


def _update(folder: Path, path: Path) -> None:
    from rich.console import Console

    from malus.bench.gates import gate_report
    from malus.bench.gates.baseline import DEFAULT_RULES, RunIdentity, read_baseline, write_baseline
    from malus.bench.gates.gate import gate, updated
    from malus.bench.running.results import read_results

    results = read_results(folder)
    old = read_baseline(path) if path.exists() else None
    new = updated(results, old, DEFAULT_RULES)
    console = Console()
    if old and old.origin.scenes == RunIdentity.of(results).scenes:
        for table in gate_report.tables(gate(results, old)):
            console.print(table)
    elif old:
        console.print("other scenes than before: all values are new", highlight=False)
    write_baseline(path, new)
    console.print(f"{len(new.values)} values written to {path}; review them", highlight=False)
