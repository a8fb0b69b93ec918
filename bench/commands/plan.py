"""`malus plan`: what a run will do, what it leaves out and why, and what that will cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from malus.bench.commands.options import backend_option, command, names_in
from malus.bench.studies.registry import STUDIES

if TYPE_CHECKING:
    from rich.console import Console

    from malus.bench.public.suites import Plan


@command("plan")
@click.argument("suite")
@backend_option
@click.pass_context
def plan_command(ctx: click.Context, /, suite: str, backend: str) -> None:
    """Say what a run of SUITE will do, what it leaves out and why, and what it will cost.

    A study (`stress`, `precision`) has no scenes to plan: what it does is told instead.

    \b
    Example:
      malus plan fig5
    """
    if suite in STUDIES:
        if ctx.get_parameter_source("backend") is not ParameterSource.DEFAULT:
            raise click.UsageError(f"--backend is of a suite, and {suite} is a study")
        click.echo(STUDIES[suite].plan)
        return
    from malus.bench.commands.console import plain_console
    from malus.bench.commands.printing import plain_table
    from malus.bench.datasets.maps_and_frames import Additions
    from malus.bench.public.suites import plan

    with names_in(suite, {}):
        planned = plan(suite, backend)
    console = plain_console()
    console.print(
        f"{planned.suite.name}: {planned.scenes} scenes in {len(planned.families)} families, "
        f"{len(planned.suite.wavelengths_nm)} bands, variant {planned.variant.name}",
    )
    table = plain_table("what")
    table.add_column("done", justify="right")
    table.add_column("instead of", justify="right")
    table.add_column("why nothing is lost")
    for saving in planned.savings:
        table.add_row(saving.what, str(saving.done), str(saving.instead_of), saving.why)
    console.print(table)
    if planned.suite.random is not None:
        _tell_distributions(planned, console)
    console.print(
        f"{planned.renders} renders instead of {planned.renders_without_plan}; about "
        f"{planned.seconds:.0f} s here instead of {planned.seconds_without_plan:.0f} s. A stored "
        f"dataset: about {planned.bytes / 1e9:.2f} GB before compression, with "
        f"{Additions.of(planned.suite).label}",
    )
    _tell_thin_highlights(planned, console)
    _tell_mesh_defects(planned, console)


def _tell_mesh_defects(planned: Plan, console: Console) -> None:
    """Print what is wrong with mesh files."""
    from malus.bench.running.mesh_defects import mesh_defects
    from malus.scenes.core.errors import printable

    scenes = (scene for family in planned.families for scene in family.scenes)
    for file, defects in mesh_defects(scenes).items():
        if any(defect.startswith(("open", "inconsistent")) for defect in defects):
            defects = [*defects, "backs of faces that are seen are dark"]
        told = printable(f"mesh {file}: {'; '.join(defects)}")
        console.print(told, style="yellow", soft_wrap=True)


def _tell_thin_highlights(planned: Plan, console: Console) -> None:
    """Print how many scenes have highlights that samples may miss."""
    from malus.bench.running.thin_highlights import ENOUGH, thin_highlights

    scenes = (scene for family in planned.families for scene in family.scenes)
    if count := thin_highlights(scenes, planned.suite.sampling.samples):
        console.print(
            f"{count} scenes have highlights that fewer than {ENOUGH:g} samples see: renders may "
            "miss them, and no standard error tells; take more samples or pixels, or a larger "
            "alpha",
            style="yellow",
        )


def _tell_distributions(planned: Plan, console: Console) -> None:
    """Print how the values of random scenes are distributed, and how many a split has."""
    from collections import Counter

    from malus.bench.commands.printing import plain_table
    from malus.bench.running.distributions import value_distributions

    table = plain_table("drawn")
    table.add_column("values", justify="right")
    table.add_column("from", justify="right")
    table.add_column("to", justify="right")
    table.add_column("how often")
    suite = planned.suite
    scenes = (scene for family in planned.families for scene in family.scenes)
    for row in value_distributions(scenes):
        ends = ["" if end is None else f"{end:.4g}" for end in (row.low, row.high)]
        table.add_row(row.key, str(row.count), *ends, row.shown)
    console.print(table)
    if suite.random is not None and suite.draws is not None and suite.splits is not None:
        counts = Counter(map(suite.draws.split, range(suite.random.count)))
        told = ", ".join(f"{name} {counts[name]}" for name in suite.splits.shares)
        apart = f"; apart: {', '.join(suite.splits.disjoint)}" if suite.splits.disjoint else ""
        console.print(f"splits: {told}{apart}")
