"""`malus render`: the truths of a suite as a dataset, and nothing else."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from rich.console import Console

from malus.bench.datasets.render import render_dataset
from malus.bench.running.overrides import overridden
from malus.bench.running.progress import peak_memory, with_progress
from malus.bench.running.worker_process import TIMEOUT_SECONDS, WorkerProcess
from malus.renderers.variant import choose
from malus.scenes.suite import load_suite


def render_for_command_line(
    name: str,
    out: Path,
    overrides: dict[str, Any],
    backend: str,
    as_json: bool,
    timeout: float = TIMEOUT_SECONDS,
    retry_failed: bool = False,
) -> int:
    """Render a suite for the command line; the number of scenes that could not be rendered."""
    variant = choose(backend)
    suite = overridden(load_suite(name), overrides, variant)
    console = Console(stderr=True)
    with WorkerProcess(timeout) as child:
        done = with_progress(
            console,
            "scenes",
            lambda show: render_dataset(suite, out, variant, show, child, retry_failed),
        )
    done["peak_memory_bytes"] = memory = peak_memory()
    failed: int = done["failed"]
    if as_json:
        sys.stdout.write(json.dumps(done) + "\n")
        return failed
    console.print(
        f"{done['scenes']} scenes in {out}: {done['rendered']} rendered, {done['taken_over']} taken"
        f" over; {done['seconds']:.1f} s, {done['bytes'] / 1e6:.1f} MB written,"
        f" {memory / 1e6:.0f} MB of memory",
        highlight=False,
    )
    if failed:
        console.print(
            f"{failed} scenes could not be rendered; `malus status {out}` tells why; a next run"
            " leaves them out, with --retry-failed it tries them again",
            highlight=False,
            soft_wrap=True,
        )
    return failed
