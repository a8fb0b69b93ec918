"""`malus doctor`: what renders here, what is missing, and the command that mends it."""

from __future__ import annotations

import sys
from typing import Any

import click

from malus.bench.commands.options import command


@command("doctor")
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
def doctor_command(as_json: bool) -> None:
    """Say what this machine renders with, what is missing, and the command that mends it.

    \b
    Example:
      malus doctor
    """
    from malus.bench.commands.printing import print_json
    from malus.bench.public.doctor import doctor

    findings = doctor()
    if as_json:
        print_json(findings, indent=2)
    else:
        _tell(findings)
    sys.exit(0 if all(findings["packages"].values()) else 1)


def _tell(findings: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(show_header=False)
    table.add_row("Python", findings["python"])
    for name, version in findings["packages"].items():
        table.add_row(name, version or f"missing: pip install {name}")
    for library in findings["libraries"]:
        use = "aborts the process, never loaded" if library["aborts"] else "candidate"
        table.add_row(f"LLVM {library['version'] or '?'}", f"{library['path']}: {use}")
    table.add_row("variant", f"{findings['variant']} ({findings['reason']})")
    console = Console()
    console.print(table)
    if findings["advice"]:
        console.print(findings["advice"], highlight=False)
