"""`malus status`: how far a run or a dataset is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from malus.bench.commands.options import FOLDER, command

if TYPE_CHECKING:
    from malus.bench.running.parts import Failure

SHOWN = 20
"""Lines of failures printed; `--json` has all."""


@command("status")
@click.argument("folder", type=FOLDER)
@click.option("--json", "as_json", is_flag=True, help="Print it as JSON, every failure included.")
def status_command(folder: Path, as_json: bool) -> None:
    """Say what of a run or dataset in FOLDER is done, what failed and why, and what is left.

    \b
    Example:
      malus status results/quick
    """
    from malus.bench.commands.console import plain_console
    from malus.bench.commands.printing import print_json
    from malus.bench.running.status import status

    progress = status(folder)
    if as_json:
        print_json(progress.as_json())
        return
    console = plain_console(soft_wrap=True)
    console.print(
        f"{progress.what}, {progress.total} {progress.unit}: {progress.done} done, "
        f"{progress.failed_families} failed, {progress.left} left"
    )
    for part in progress.parts:
        failed = f", {part.failed} failed" if part.failed else ""
        console.print(f"  part {part.part}: {part.done} of {part.total} done{failed}")
    for label, failure in progress.failed[:SHOWN]:
        parts = (failure.method, failure.scene and f"scene {failure.scene}")
        whose = ", ".join(part for part in parts if part)
        console.print(f"  failed: {label}{f' ({whose})' if whose else ''}: {failure.reason}")
    if len(progress.failed) > SHOWN:
        console.print(f"  and {len(progress.failed) - SHOWN} more failures; --json tells all")
    if not progress.finished and (progress.left or progress.done):
        if progress.parts and not progress.left:
            console.print("The same command without --part takes over what parts have here.")
            return
        hint = ", and --part those that have not begun" if progress.parts else ""
        console.print(f"The command that made the folder, given again, goes on where it was{hint}.")
    elif progress.failed:
        console.print(_tried_again([failure for _, failure in progress.failed]))


def _tried_again(failures: Sequence[Failure]) -> str:
    """How failures are tried again: wrong inputs by every run."""
    if not any(failure.mendable for failure in failures):
        return "The same command with --retry-failed tries the failed ones again."
    others = "" if all(failure.mendable for failure in failures) else ", --retry-failed the others"
    return f"The same command tries again what failed for a wrong input{others}."
