"""The command that tells how far a run or a dataset is."""

from __future__ import annotations

from pathlib import Path

import click

from malus.bench.commands.options import PLACE

SHOWN = 20
"""Lines of failures printed; `--json` has all."""


@click.command("status")
@click.argument("folder", type=PLACE)
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON, every failure included.")
def status_command(folder: Path, as_json: bool) -> None:
    """Say what of a run or dataset in FOLDER is done, what failed and why, and what is left.

    \b
    Example:
      malus status results/quick
    """
    status_for_command_line(folder, as_json)


def status_for_command_line(folder: Path, as_json: bool) -> None:
    """Print the status of a folder."""
    import json
    import sys

    from rich.console import Console

    from malus.bench.running.status import status

    found = status(folder)
    if as_json:
        sys.stdout.write(json.dumps(found.as_json()) + "\n")
        return
    console = Console(soft_wrap=True, highlight=False, markup=False)
    console.print(
        f"{found.what}, {found.total} {found.unit}: {found.done} done, "
        f"{found.failed_families} failed, {found.left} left"
    )
    for label, why in found.failed[:SHOWN]:
        whose = ", ".join(part for part in (why.method, why.scene and f"scene {why.scene}") if part)
        console.print(f"  failed: {label}{f' ({whose})' if whose else ''}: {why.reason}")
    if len(found.failed) > SHOWN:
        console.print(f"  and {len(found.failed) - SHOWN} more failures; --json tells all")
    if not found.finished:
        console.print("The command that made the folder, given again, goes on where it was.")
    elif found.failed:
        console.print("`malus run … --retry-failed` tries the failed ones again.")
