"""`malus doctor`: what renders here, what is missing, and the command that mends it."""

from __future__ import annotations

import importlib
import sys
from typing import Any

import click
from click.core import ParameterSource

from malus.bench.commands.options import backend_option, command


@command("doctor")
@click.option("--check", is_flag=True, help="Render small scenes of every kind, and judge them.")
@backend_option
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
@click.pass_context
def doctor_command(ctx: click.Context, /, check: bool, backend: str, as_json: bool) -> None:
    """Say what this machine renders with, what is missing, and the command that mends it.

    With --check it renders small scenes of every kind, compares them with stored values and with
    laws of physics, and ends with exit code 1 where one deviates. --backend says which variant.

    \b
    Example:
      malus doctor
      malus doctor --check
    """
    if not check and ctx.get_parameter_source("backend") is not ParameterSource.DEFAULT:
        raise click.UsageError("--backend is of --check")
    _require_packages()
    from malus.bench.commands.printing import print_json
    from malus.bench.public.doctor import doctor

    if check:
        _check(backend, as_json)
        return
    findings = doctor()
    if as_json:
        print_json(findings, indent=2)
    else:
        _tell(findings)
    sys.exit(1 if findings["unmet"] else 0)


def _require_packages() -> None:
    """Name the packages without which nothing can be found out; exit code 1 then."""
    from malus.bench.public.requirements import installed_packages, unmet_requirements

    try:
        importlib.import_module("malus.bench.public.doctor")
        importlib.import_module("malus.bench.commands.printing")
    except ImportError:
        unmet = unmet_requirements()
        if not unmet:
            raise
        installed = installed_packages()
        for name, requirement in unmet.items():
            click.echo(f"{name} {_mended(installed[name], requirement)}")
        sys.exit(1)


def _mended(version: str | None, requirement: str) -> str:
    state = "missing" if version is None else f"{version} does not fit"
    return f"{state}: pip install '{requirement}'"


def _check(backend: str, as_json: bool) -> None:
    """Print what the self-check found; exit code 1 where anything deviates."""
    from dataclasses import asdict

    from malus.bench.commands.console import plain_console
    from malus.bench.commands.printing import plain_table, print_json
    from malus.bench.public.doctor import self_check
    from malus.scenes.core.errors import counted

    checks = self_check(backend)
    failed = sum(not check.passed for check in checks)
    if as_json:
        print_json([asdict(check) for check in checks], indent=2)  # NaN: no deviation was found
    else:
        table = plain_table("check", "result")
        for name in ("deviation", "limit", "seconds"):
            table.add_column(name, justify="right")
        table.add_column("of what")
        for check in checks:
            numbers = (f"{check.deviation:.2g}", f"{check.limit:g}", f"{check.seconds:.2f}")
            verdict = "passed" if check.passed else "FAILED"
            table.add_row(check.name, verdict, *numbers, check.why or check.what)
        console = plain_console()
        console.print(table)
        console.print(f"{counted(len(checks), 'check')}, {failed} failed")
    sys.exit(1 if failed else 0)


def _tell(findings: dict[str, Any]) -> None:
    from rich.table import Table

    from malus.bench.commands.console import plain_console

    table = Table(show_header=False)
    table.add_row("Python", findings["python"])
    for name, version in findings["packages"].items():
        unmet = findings["unmet"].get(name)
        table.add_row(name, _mended(version, unmet) if unmet else version)
    for library in findings["libraries"]:
        use = "aborts the process, never loaded" if library["aborts"] else "candidate"
        table.add_row(f"LLVM {library['version'] or '?'}", f"{library['path']}: {use}")
    table.add_row("variant", f"{findings['variant']} ({findings['reason']})")
    console = plain_console()
    console.print(table)
    if findings["missing_library"]:
        console.print(
            f"DRJIT_LIBLLVM_PATH names {findings['missing_library']}, where no file is: correct it,"
            " or unset it to let malus look in the usual places",
        )
    if findings["advice"]:
        console.print(findings["advice"])
