"""`malus render`: the truths of a suite as a dataset, and nothing else."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from malus.bench.commands.options import (
    FOLDER,
    backend_option,
    command,
    size_options,
    work_options,
)


@command("render")
@click.argument("suite")
@click.option("--out", type=FOLDER, required=True, help="Folder or URL of the dataset.")
@size_options
@backend_option
@work_options
@click.option("--part", metavar="K/N", help="Only part K of N, such as 3/16, for job arrays.")
@click.option(
    "--workers", type=click.IntRange(min=1), help="Processes to spread over, instead of this one."
)
@click.option("--scheduler", help="Address of a Dask cluster, whose workers all see --out.")
@click.option("--json", "as_json", is_flag=True, help="Print what was done as JSON.")
def render_command(suite: str, out: Path, as_json: bool, **options: Any) -> None:
    """Render SUITE as a dataset: Stokes images of both lobes, normals and errors as OpenEXR.

    Stopped half-way, the same command goes on where it was. A scene that cannot be rendered is
    recorded and left out, and the exit code is 1 then; `malus status` tells why.

    Parts may be rendered on many machines at once into one folder that all see; the last makes it
    whole. Where they see none, copy the content of their folders into one and give the command
    without --part: it takes over what is there.

    \b
    Examples:
      malus render quick --out quick-dataset
      malus render quick --part 2/4 --out quick-parts
    """
    from malus.bench.running.inside_worker import import_all
    from malus.bench.running.worker_process import WorkerProcess

    with WorkerProcess(options.pop("timeout")) as worker:
        # It imports what it needs while this process does, which has imported little so far.
        worker.begin(import_all, "malus.bench.datasets.render")

        from malus.bench.commands.console import plain_console
        from malus.bench.commands.printing import print_json
        from malus.bench.datasets.render import render_dataset
        from malus.bench.running.progress import peak_memory, with_progress

        console = plain_console(stderr=True)
        done = with_progress(
            console,
            "scenes",
            lambda show: render_dataset(suite, out, progress=show, worker=worker, **options),
        )
    done["peak_memory_bytes"] = peak_memory()
    if as_json:
        print_json(done)
    else:
        _tell(done, out, console)
    if done["failed"]:
        sys.exit(1)


def _tell(done: dict[str, Any], out: Path, console: Any) -> None:
    part = f" (part {done['part']})" if done["part"] else ""
    console.print(
        f"{done['scenes']} scenes in {out}{part}: {done['rendered']} rendered,"
        f" {done['taken_over']} taken over; {done['seconds']:.1f} s,"
        f" {done['bytes'] / 1e6:.1f} MB written,"
        f" {done['peak_memory_bytes'] / 1e6:.0f} MB of memory",
    )
    if done["failed"]:
        from malus.bench.commands.printing import NEXT_RUN

        console.print(
            f"{done['failed']} scenes could not be rendered; `malus status {out}` tells why;"
            f" {NEXT_RUN}",
            soft_wrap=True,
        )
