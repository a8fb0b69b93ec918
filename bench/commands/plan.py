"""`malus plan`: what a run will do, what it leaves out and why, and what that will cost."""

from __future__ import annotations

import click

from malus.bench.commands.options import backend_option, command
from malus.bench.studies.registry import STUDIES


@command("plan")
@click.argument("suite")
@backend_option
def plan_command(suite: str, backend: str) -> None:
    """Say what a run of SUITE will do, what it leaves out and why, and what it will cost.

    A study (`stress`, `precision`) has no scenes to plan: what it does is told instead.

    \b
    Example:
      malus plan fig5
    """
    if suite in STUDIES:
        click.echo(STUDIES[suite].plan)
        return
    from rich.console import Console

    from malus.bench.commands.printing import plain_table
    from malus.bench.datasets.maps_and_frames import Additions
    from malus.bench.public.suites import plan

    planned = plan(suite, backend)
    console = Console()
    console.print(
        f"{planned.suite.name}: {planned.scenes} scenes in {len(planned.families)} families, "
        f"{len(planned.suite.wavelengths_nm)} bands, variant {planned.variant.name}",
        highlight=False,
    )
    table = plain_table("what")
    table.add_column("done", justify="right")
    table.add_column("instead of", justify="right")
    table.add_column("why nothing is lost")
    for saving in planned.savings:
        table.add_row(saving.what, str(saving.done), str(saving.instead_of), saving.why)
    console.print(table)
    console.print(
        f"{planned.renders} renders instead of {planned.renders_without_plan}; about "
        f"{planned.seconds:.0f} s here instead of {planned.seconds_without_plan:.0f} s. A stored "
        f"dataset: about {planned.bytes / 1e9:.2f} GB before compression, with "
        f"{Additions.of(planned.suite).label}",
        highlight=False,
    )
