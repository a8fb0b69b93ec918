"""The command line. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import sys

try:
    import errno
    import gc
    import io
    import os
    import re
    import signal
    from collections.abc import Sequence
    from contextlib import suppress

    import click

    from malus.bench.commands.bench import bench_command
    from malus.bench.commands.capture import capture_command
    from malus.bench.commands.compare import compare_command
    from malus.bench.commands.doctor import doctor_command
    from malus.bench.commands.export import export_command
    from malus.bench.commands.filter import filter_command
    from malus.bench.commands.gate import gate_command
    from malus.bench.commands.list import list_command
    from malus.bench.commands.options import Group
    from malus.bench.commands.plan import plan_command
    from malus.bench.commands.render import render_command
    from malus.bench.commands.report import report_command
    from malus.bench.commands.run import run_command
    from malus.bench.commands.score import score_command
    from malus.bench.commands.status import status_command
    from malus.bench.commands.train import train_command
    from malus.bench.studies.registry import STUDIES
except KeyboardInterrupt:
    # A command just given: its Ctrl-C may come before `main` can catch it.
    sys.stderr.write("malus: stopped; nothing was written\n")
    sys.exit(130)

UNMAPPED = "failed to map segment"
"""In the message of a library that could not be loaded for want of memory."""

BAD_INPUT, HUNG_UP, INTERRUPTED, TERMINATED = 2, 129, 130, 143
"""Exit codes, besides 0 and the 1 of a command whose work failed in part."""

SELDOM = 100_000
"""New objects after which Python looks for garbage; by default 700. Nearly all are of modules and
tables, which stay: looking among them every time takes a twentieth of a report."""

STOPPED = "stopped; the same command "
GOES_ON, BEGINS_ANEW = "goes on where it was", "begins anew"
FROM_VALIDATION = "goes on from its last validation"
KEEPING = ("run", "render")
"""Commands that keep what is done when they are stopped; a training does at every validation."""


@click.group(
    cls=Group,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="malus")
def cli() -> None:
    """Synthetic ground truth for methods that tell polarisation from one unpolarised image.

    \b
    Example:
      malus run fig5 --out results/fig5
    """


for _command in (
    run_command,
    render_command,
    plan_command,
    status_command,
    report_command,
    score_command,
    compare_command,
    gate_command,
    export_command,
    train_command,
    filter_command,
    capture_command,
    bench_command,
    list_command,
    doctor_command,
):
    cli.add_command(_command)


def main() -> None:
    """Run the command line; a user's mistake ends in one line and exit code 2, not a traceback."""
    gc.set_threshold(SELDOM)
    try:
        _check_output()
        _check_surroundings()
        # A notebook's, which this environment need not have; malus draws into files.
        os.environ.pop("MPLBACKEND", None)
        _obey_stops()
        cli.main(standalone_mode=False)
    except (click.exceptions.Abort, KeyboardInterrupt):
        _stop(_stopped(sys.argv[1:]), INTERRUPTED)
    except SystemExit as leaving:
        if leaving.code in (HUNG_UP, TERMINATED):
            _stop(_stopped(sys.argv[1:]), leaving.code)
        raise
    except click.exceptions.Exit as leaving:
        sys.exit(leaving.exit_code)
    except click.exceptions.NoArgsIsHelpError as asked:
        click.echo(asked.format_message())
        sys.exit(BAD_INPUT)
    except click.ClickException as mistake:
        message = " ".join(mistake.format_message().split()).rstrip(".")
        end = "" if message.endswith("?") else "."
        _stop(f"{message}{end} See `{_command_path(mistake)} --help`.", BAD_INPUT)
    except ValueError as mistake:
        # Imported here, because `--help` must not wait for it.
        from malus.scenes.core.errors import InputError

        if not isinstance(mistake, InputError):
            raise
        _stop(str(mistake), BAD_INPUT)
    except (OSError, MemoryError, ImportError) as error:
        _stop(_reason(error), BAD_INPUT)


def _check_output() -> None:
    """Refuse a closed standard output, and let it take what its encoding lacks, as `?`.

    The next file that is opened would get what is printed.
    """
    if sys.stdout is None:
        _stop("expected standard output, found it closed; write to a file or /dev/null", BAD_INPUT)
    if isinstance(sys.stdout, io.TextIOWrapper):  # a test's is none
        sys.stdout.reconfigure(errors="replace")


def _check_surroundings() -> None:
    """Refuse a working folder that is gone, and a number of threads that numba cannot be given.

    Every family would fail of the one, and the other end where numba is imported, or print a
    traceback there.
    """
    try:
        os.getcwd()
    except FileNotFoundError:
        _stop("working folder: expected a folder, found a removed one; `cd` to another", BAD_INPUT)
    threads = os.environ.get("NUMBA_NUM_THREADS", "")
    if not threads:
        os.environ.pop("NUMBA_NUM_THREADS", None)  # set to nothing, numba tells it in a traceback
    elif not re.fullmatch(r"\s*\+?0*[1-9]\d*\s*", threads):
        from malus.scenes.core.errors import InputError

        where = "environment variable NUMBA_NUM_THREADS"
        _stop(str(InputError(where, "a number above 0", threads, "unset it")), BAD_INPUT)


def _obey_stops() -> None:
    """Leave as after Ctrl-C on SIGTERM, and where the terminal is closed but under `nohup`."""
    signal.signal(signal.SIGTERM, _terminate)
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) == signal.SIG_DFL:
        signal.signal(signal.SIGHUP, _terminate)


def _terminate(number: int, frame: object) -> None:
    """Leave as after Ctrl-C: what is half written is removed on the way out."""
    sys.exit(128 + number)  # as shells count


def _stopped(words: Sequence[str]) -> str:
    """What the same command does after a stop; most begin anew, as studies do without --rows."""
    keeps = any(word.startswith("--rows") for word in words)
    if not words or words[0] not in (*KEEPING, "train"):
        return STOPPED + (GOES_ON if keeps else BEGINS_ANEW)
    command = cli.commands[words[0]]
    params = command.make_context(words[0], list(words[1:]), resilient_parsing=True).params
    if words[0] == "train":
        from malus.bench.learning.options import DEFAULT_MODEL, kept_state

        keeps = not params["ablates"] and kept_state(params["out"] or DEFAULT_MODEL).exists()
        return STOPPED + (FROM_VALIDATION if keeps else BEGINS_ANEW)
    return STOPPED + (GOES_ON if params.get("suite") not in STUDIES else BEGINS_ANEW)


def _reason(error: OSError | MemoryError | ImportError) -> str:
    if isinstance(error, ImportError) and UNMAPPED not in str(error):
        return _unmet(error)
    if not isinstance(error, OSError):
        detail = f" ({error})" if str(error) else ""
        return f"expected enough memory, found too little; ask for less at once{detail}"
    reason = error.strerror or error
    if error.errno == errno.ENOSPC and not error.filename:
        return f"expected room for standard output or temporary files, found {reason}; make room"
    return f"{reason}{f' {error.filename}' if error.filename else ''}"


def _unmet(error: ImportError) -> str:
    """What to install where a package that malus needs is missing or does not fit.

    Raises
    ------
    ImportError
        The error itself, where none is: it is a fault of malus.
    """
    try:
        from malus.bench.public.requirements import unmet_requirements
    except ImportError:  # what reads requirements is missing, too
        raise error from None
    unmet = unmet_requirements()
    if not unmet or "malus" in unmet:
        raise error
    packages = " ".join(f"'{need}'" for need in unmet.values())
    return f"expected the packages that malus needs, found {error}; pip install {packages}"


def _command_path(mistake: click.ClickException) -> str:
    context = getattr(mistake, "ctx", None)
    return context.command_path if context else "malus"


def _stop(message: str, code: int) -> None:
    with suppress(OSError):  # where the disk of the error stream is full, the exit code tells
        click.echo(f"malus: {message}", err=True)
    sys.exit(code)
