"""The command that tells how far a run or a dataset is."""

from __future__ import annotations

from pathlib import Path

import click

from malus.bench.commands.options import PLACE


@click.command("status")
@click.argument("folder", type=PLACE)
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON, every failure included.")
def status_command(folder: Path, as_json: bool) -> None:
    """Say what of a run or dataset in FOLDER is done, what failed and why, and what is left.

    \b
    Example:
      malus status results/quick
    """
    from malus.bench.running.status import status_for_command_line

    status_for_command_line(folder, as_json)
