"""The command line. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import click

from malus.bench.commands.bench import bench_command
from malus.bench.commands.capture import capture_command
from malus.bench.commands.dataset import export_command, render_command, score_command
from malus.bench.commands.filter import filter_command
from malus.bench.commands.gate import gate_command
from malus.bench.commands.options import PLACE
from malus.bench.commands.status import status_command

STUDIES = ("stress", "precision")
"""What `malus run` knows besides suites of scenes: see `malus.bench.studies.registry`."""

DONE, FAILED, BAD_INPUT, INTERRUPTED, TERMINATED = 0, 1, 2, 130, 143
STOPPED = "stopped; the same command goes on where it was"


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="malus")
def cli() -> None:
    """Synthetic ground truth for methods that tell polarisation from one unpolarised image.

    \b
    Example:
      malus run fig5 --out results/fig5
    """


@cli.command()
@click.argument("suite", default="fig5")
@click.option("--out", type=PLACE, help="Folder or URL [default: results/SUITE].")
@click.option("--samples", type=int, help="Samples a pixel, instead of the suite's.")
@click.option("--resolution", type=int, help="Pixels a side, instead of the suite's.")
@click.option("--seed", type=int, help="Seed, instead of the suite's.")
@click.option("--method", "methods", multiple=True, help="Methods, instead of the suite's.")
@click.option("--backend", default="auto", help="auto, cuda, llvm or scalar.")
@click.option("--workers", type=int, help="Processes to spread over, instead of this one.")
@click.option("--scheduler", help="Address of a Dask cluster to spread over.")
@click.option("--timeout", type=float, default=3600, help="Seconds a family may take [3600].")
@click.option("--retry-failed", is_flag=True, help="Try again what failed in an earlier run.")
@click.option("--json", "as_json", is_flag=True, help="Print the numbers as JSON.")
def run(
    suite: str,
    out: Path | None,
    samples: int | None,
    resolution: int | None,
    seed: int | None,
    methods: tuple[str, ...],
    backend: str,
    workers: int | None,
    scheduler: str | None,
    timeout: float,
    retry_failed: bool,
    as_json: bool,
) -> None:
    """Render, reconstruct, score and report SUITE: one that malus brings, or a TOML file.

    `stress` and `precision` are studies that make tables of their own.

    Stopped half-way, the same command goes on where it was. What fails is recorded and left out,
    and the exit code is 1 then; `malus status` tells why.

    \b
    Example:
      malus run quick --out results/quick
    """
    overrides = {"samples": samples, "resolution": resolution, "seed": seed, "methods": methods}
    if suite in STUDIES:
        from malus.bench.studies.registry import run_study

        others: dict[str, object] = {
            **overrides,
            "workers": workers,
            "scheduler": scheduler,
            "json": as_json,
            "retry-failed": retry_failed,
        }
        if not run_study(suite, out, backend, others):
            sys.exit(FAILED)
        return
    from malus.bench.commands.run import How, run_command

    how = How(workers, scheduler, retry_failed, timeout)
    if run_command(suite, out, overrides, backend, as_json, how):
        sys.exit(FAILED)


@cli.command()
@click.argument("results", type=PLACE)
@click.option(
    "--with",
    "beside",
    multiple=True,
    type=PLACE,
    metavar="DIR",
    help="Show the study in DIR (of `malus run precision` or `stress`) too; may be given twice.",
)
def report(results: Path, beside: tuple[Path, ...]) -> None:
    """Make the figures, summary and page of a finished run again, from its folder RESULTS.

    \b
    Example:
      malus report results/fig5
    """
    from malus.bench.commands.run import report_again

    report_again(results, beside)


@cli.command("list")
@click.argument("what", default="everything")
def list_command(what: str) -> None:
    """List suites, methods, materials, metals, surfaces, swatches, patterns, shapes or lights.

    Without WHAT: everything.

    \b
    Example:
      malus list materials
    """
    from malus.bench.commands.list import list_things

    list_things(what)


@cli.command()
@click.argument("suite")
@click.option("--backend", default="auto", help="auto, cuda, llvm or scalar.")
def plan(suite: str, backend: str) -> None:
    """Say what a run of SUITE will do, what it leaves out and why, and what it will cost.

    A study (`stress`, `precision`) has no scenes to plan: what it does is told instead.

    \b
    Example:
      malus plan fig5
    """
    if suite in STUDIES:
        from malus.bench.studies.registry import STUDIES as KNOWN

        click.echo(KNOWN[suite].plan)
        return
    from malus.bench.commands.plan import plan_command

    plan_command(suite, backend)


@cli.command()
@click.option("--json", "as_json", is_flag=True, help="Print the findings as JSON.")
def doctor(as_json: bool) -> None:
    """Say what this machine renders with, what is missing, and the command that mends it.

    \b
    Example:
      malus doctor
    """
    from malus.bench.commands.doctor import report as examine

    sys.exit(DONE if examine(as_json) else FAILED)


for _command in (
    render_command,
    export_command,
    score_command,
    gate_command,
    bench_command,
    status_command,
    filter_command,
    capture_command,
):
    cli.add_command(_command)


def main() -> None:
    """Entry point: a user's mistake ends in one line and exit code 2, never in a traceback."""
    signal.signal(signal.SIGTERM, _terminate)
    try:
        cli.main(standalone_mode=False)
    except click.exceptions.Abort:
        _stop(STOPPED, INTERRUPTED)
    except SystemExit as leaving:
        if leaving.code == TERMINATED:
            _stop(STOPPED, TERMINATED)
        raise
    except click.exceptions.Exit as leaving:
        sys.exit(leaving.exit_code)
    except click.ClickException as mistake:
        message = " ".join(mistake.format_message().split())
        _stop(f"{message} See `{_path(mistake)} --help`.", BAD_INPUT)
    except ValueError as mistake:
        # Imported here, because `--help` must not wait for it.
        from malus.scenes.core.errors import InputError

        if not isinstance(mistake, InputError):
            raise
        _stop(str(mistake), BAD_INPUT)
    except KeyboardInterrupt:
        _stop(STOPPED, INTERRUPTED)
    except (OSError, MemoryError) as error:
        _stop(_told(error), BAD_INPUT)


def _terminate(number: int, frame: object) -> None:
    """Leave as after Ctrl-C: what is half written is removed on the way out."""
    sys.exit(TERMINATED)


def _told(error: OSError | MemoryError) -> str:
    if isinstance(error, MemoryError):
        return f"expected enough memory, found too little; ask for less at once ({error})"
    return f"{error.strerror or error}{f' {error.filename}' if error.filename else ''}"


def _path(mistake: click.ClickException) -> str:
    context = getattr(mistake, "ctx", None)
    return context.command_path if context else "malus"


def _stop(message: str, code: int) -> None:
    click.echo(f"malus: {message}", err=True)
    sys.exit(code)
