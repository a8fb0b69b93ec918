"""`malus run`: render, reconstruct, score and report a suite, or run a study."""

from __future__ import annotations

import functools
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from malus.bench.commands.bench import print_findings
from malus.bench.commands.options import (
    FOLDER,
    METHOD,
    asked_metrics,
    backend_option,
    command,
    json_option,
    metric_options,
    names_in,
    size_options,
    work_options,
)
from malus.bench.studies.registry import STUDIES, run_study

if TYPE_CHECKING:
    from rich.console import Console

    from malus.bench.running.progress import Progress
    from malus.bench.running.results import Results
    from malus.bench.running.worker_process import WorkerProcess
    from malus.renderers.variant import Variant
    from malus.scenes.suite import Suite

CHANGES = ("samples", "resolution", "seed", "methods", "metrics")
"""Options that replace or add to values of the suite."""

SHARED = ("suite", "out", "backend", "timeout")
"""Options that every study accepts, also where it has no use for them."""


@command("run")
@click.argument("suite", default="fig5")
@click.option("--out", type=FOLDER, help="Folder or URL [default: results/SUITE].")
@size_options
@click.option("--method", "methods", multiple=True, help=f"{METHOD} [the suite's].")
@metric_options
@backend_option
@click.option(
    "--workers", type=click.IntRange(min=1), help="Processes to spread over, instead of this one."
)
@click.option("--scheduler", help="Address of a Dask cluster to spread over.")
@work_options
@json_option
@click.pass_context
def run_command(
    ctx: click.Context, /, suite: str, out: Path | None, as_json: bool, **options: Any
) -> None:
    """Render, reconstruct, score and report SUITE: one that malus brings, or a TOML file.

    SUITE may also be a study, which makes tables of its own: see `malus bench`.

    Stopped half-way, the same command goes on where it was. What fails is recorded and left out,
    and the exit code is 1 then; `malus status` tells why. A method that does not apply to a scene
    is no failure.

    \b
    Example:
      malus run quick --out results/quick
    """
    failed = _run_study(ctx, suite, out) if suite in STUDIES else _run(suite, out, as_json, options)
    if failed:
        sys.exit(1)


def _run_study(ctx: click.Context, name: str, out: Path | None) -> bool:
    """Run a study with the options that were given for it, and return whether it failed.

    Raises
    ------
    InputError
        If another option was given.
    """
    allowed = {option.name for option in STUDIES[name].options}
    values = {}
    for param in ctx.command.params:
        given = ctx.get_parameter_source(str(param.name)) is not ParameterSource.DEFAULT
        if given and param.name in allowed:
            values[param.name] = ctx.params[param.name]
        elif given and param.name not in SHARED:
            _refuse(name, param.opts[0], allowed)
    findings = run_study(name, out, **values)
    print_findings(findings)
    return not findings.passed


def _refuse(name: str, option: str, allowed: set[str]) -> None:
    from malus.scenes.core.errors import InputError

    names = sorted({"out", "backend", *allowed}, key=lambda word: word != "out")
    options = [f"--{word}" for word in names]
    expected = f"no option but {', '.join(options[:-1])} and {options[-1]}"
    hint = f"leave it out: the cases of {name} are fixed"
    raise InputError(f"malus run {name}", expected, option, hint)


def _run(name: str, out: Path | None, as_json: bool, options: dict[str, Any]) -> int:
    """Run a suite, and return the number of families with a failure."""
    from malus.bench.running.inside_worker import SCORING, import_all
    from malus.bench.running.worker_process import WorkerProcess

    if options["workers"] is not None or options["scheduler"] is not None:
        return _run_with(None, name, out, as_json, options)
    with WorkerProcess(options["timeout"]) as worker:
        # It imports what it needs while this process does, which has imported little so far.
        worker.begin(import_all, *SCORING)
        return _run_with(worker, name, out, as_json, options)


def _run_with(
    worker: WorkerProcess | None,
    name: str,
    out: Path | None,
    as_json: bool,
    options: dict[str, Any],
) -> int:
    """Run a suite, in a worker process where one is given."""
    from malus.bench.running.overrides import chosen_suite
    from malus.renderers.variant import chosen_variant, mitsuba

    options["metrics"] = asked_metrics(options["metrics"], options.pop("profiles"))
    changes = {key: options.pop(key) for key in CHANGES}
    variant = chosen_variant(options.pop("backend"))
    if worker is not None:
        worker.begin(mitsuba, variant)
    with names_in(name, changes):
        suite = chosen_suite(name, variant, **changes)
        _check_names(suite)

    from malus.bench.commands.console import plain_console
    from malus.bench.public.suites import run
    from malus.bench.running.progress import with_progress
    from malus.bench.running.results import replaced_by

    folder = out if out is not None else Path("results") / suite.name
    console = plain_console(stderr=True)
    earlier = replaced_by(folder, suite.id)
    announce = functools.cache(lambda: _announce(suite, variant, console))

    def work(show: Progress) -> Results:
        def progress(done: int, total: int, label: str) -> None:
            announce()  # not before: where an option is refused, that is the only line
            show(done, total, label)

        return run(suite, folder, backend=variant, progress=progress, worker=worker, **options)

    results = with_progress(console, "families", work)
    if earlier:
        _tell_replaced(earlier, console)
    return _tell(results, folder, as_json, console)


def _announce(suite: Suite, variant: Variant, console: Console) -> None:
    """Say what begins now."""
    console.print(": ".join(filter(None, (suite.name, suite.description))))
    sides = " to ".join(f"{side}²" for side in dict.fromkeys(suite.least_and_most_pixels))
    most = "" if suite.sampling.target is None else "at most "
    console.print(
        f"variant {variant.name} ({variant.reason}), {sides} pixels, "
        f"{most}{suite.sampling.samples} samples a pixel"
    )


def _tell_replaced(earlier: str, console: Console) -> None:
    """Say whose results were in the folder before, and that they are not lost."""
    from malus.scenes.core.errors import printable

    console.print(
        f"replaced results of an earlier run there ({printable(earlier)}); its parts are kept, and"
        " its command brings them back"
    )


def _check_names(suite: Suite) -> None:
    """Refuse methods and metrics that there are not, before a line is printed."""
    from malus.reconstruct.methods import by_name, get_method

    by_name((get_method(reference).name, reference) for reference in suite.methods)
    if suite.metrics:  # what scores takes its time to import
        from malus.bench.scoring.extra_metrics import get_metrics

        get_metrics(suite.metrics)


def _tell(results: Results, folder: Path, as_json: bool, console: Console) -> int:
    """Print what came of a run, and return the number of families with a failure."""
    from malus.bench.commands.printing import print_json, print_results
    from malus.bench.running.results import headline

    failed = int(results.run["families_failed"])
    if as_json:
        methods = headline(results)
        print_json({"out": str(folder), "methods": methods, "families_failed": failed})
    else:
        print_results(results, console)
        console.print(f"written to {folder}")
    if failed:
        _tell_failed(failed, results, folder, console)
    return failed


def _tell_failed(failed: int, results: Results, folder: Path, console: Any) -> None:
    from malus.bench.commands.printing import NEXT_RUN

    console.print(
        f"{failed} of {results.run['families']} families failed, wholly or for a method; the first:"
        f" {results.run['failures'][0]}. `malus status {folder}` tells all; {NEXT_RUN}",
        soft_wrap=True,
    )
