"""`malus compare`: what changed between finished runs."""

from __future__ import annotations

from pathlib import Path

import click

from malus.bench.commands.options import FOLDER, command, json_option


@command("compare")
@click.argument("results", type=FOLDER, nargs=-1, required=True)
@click.option("--out", type=FOLDER, help="Write the comparison as a page and JSON here.")
@json_option
def compare_command(results: tuple[Path, ...], out: Path | None, as_json: bool) -> None:
    """Compare finished runs, RESULTS, with the first of them: what changed beyond chance.

    Runs may be of one suite, with other versions, seeds or methods, or of several suites. Scenes
    that both have are compared one by one, others by their means under the same light and body.
    Another seed or other samples move all scenes together: then gain, rotation and facing skill are
    compared, whose noise is known, and not NMSE and skill.

    \b
    Example:
      malus compare results/before results/after
    """
    from malus.bench.commands.console import plain_console
    from malus.bench.commands.printing import plain_table
    from malus.bench.public.tables import compare
    from malus.scenes.core.errors import printable

    comparison = compare(results, out)
    if as_json:
        from malus.scenes.core.json_text import json_text

        click.echo(json_text(comparison.numbers(), 1))
        return
    console = plain_console()
    for table in (comparison.differing, comparison.means, comparison.changed):
        if table:
            shown = plain_table(*table.heads)
            for line in table.lines:
                shown.add_row(*map(printable, line))
            console.print(shown)
    console.print(printable(comparison.headline))
    if out is not None:
        console.print(f"written to {out}")
