"""Small suites, commands in processes of their own, and file systems that are full or read-only."""

from __future__ import annotations

import io
import math
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pandas as pd
import pytest

from malus.bench import read_results
from malus.bench.cli import main
from malus.bench.datasets.predictions import Predictions, find_predictions, problems_of
from malus.bench.datasets.render import render_dataset
from malus.bench.running import sharing
from malus.bench.running.worker_process import WorkerProcess
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.variant import Variant
from malus.scenes import Camera, InputError, load_suite
from malus.scenes.core.result_files import EXAMPLES, PARTS

TINY = ("run", "quick", "--resolution", "8", "--samples", "2")
NOBODY = Variant("scalar_spectral_polarized", "not used")
SUITE = load_suite("quick").model_copy(
    update={
        "renderer": "torrance-sparrow",
        "lights": load_suite("quick").lights[1:],
        "bodies": ("unpolarised",),
        "camera": Camera(resolution=8),
        "methods": ("unpolarised", "eq8"),
    }
)
"""Two families of two scenes, whose truths are closed forms: a run takes a moment."""


def check_predictions(
    dataset: Dataset, folder: Path, progress: Callable[[int, int, str], None]
) -> tuple[Predictions, list[InputError]]:
    """Find predictions and every problem of every one of them, before anything is scored."""
    predictions, problems = find_predictions(folder, dataset)
    return predictions, problems + problems_of(dataset, predictions, progress)


def formula_dataset(folder: Path, side: int = 14) -> Dataset:
    """A dataset of the same scenes, made without Mitsuba, `side` pixels a side."""
    suite = SUITE.model_copy(update={"camera": Camera(resolution=side)})
    render_dataset(suite, folder, NOBODY)
    return open_folder(folder)


SMALL = load_suite("quick")
SMALL = SMALL.model_copy(
    update={
        "camera": Camera(resolution=8),
        "sampling": SMALL.sampling.model_copy(update={"samples": 2}),
    }
)
"""What TINY renders, for runs without a report."""


@contextmanager
def no_worker_process() -> Iterator[None]:
    """Do in this process what commands do in one of their own: imports are paid for once.

    That they start one, and what it is good for, is tested in test_faults and test_robust.
    """

    def stream(_: WorkerProcess, function: Callable[..., Any], *arguments: Any) -> Iterator[Any]:
        return iter(function(*arguments))

    alone = patch.object(sharing, "WORTH_SECONDS", math.inf)
    with patch.object(WorkerProcess, "stream", stream), alone:
        yield


def share_at_once(monkeypatch: pytest.MonkeyPatch, cores: int) -> None:
    """Let worker processes share tasks out after the first, as on a machine of so many cores."""
    monkeypatch.setattr(sharing, "WORTH_SECONDS", 0.0)
    monkeypatch.setattr(sharing, "WARMING_SECONDS", 0.0)
    monkeypatch.setattr(WorkerProcess, "is_free", lambda self: True)
    monkeypatch.setattr(sharing, "usable_cores", lambda: cores)
    monkeypatch.setattr(sharing, "free_memory", lambda: math.inf)


def run_malus(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Exit code and output of a malus command, all of it in this process."""
    out, errors, code = io.StringIO(), io.StringIO(), 0
    handlers = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    with (
        no_worker_process(),
        patch("sys.argv", ["malus", *arguments]),
        redirect_stdout(out),
        redirect_stderr(errors),
    ):
        try:
            main()
        except SystemExit as leaving:
            code = leaving.code if isinstance(leaving.code, int) else 0
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), errors.getvalue())


def run_malus_process(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Exit code and output of a malus command in a process of its own, native prints included."""
    process = start(*arguments)
    out, errors = process.communicate(timeout=600)
    return subprocess.CompletedProcess(arguments, process.returncode, out, errors)


def one_line(errors: str) -> str:
    """The only line that malus itself wrote to stderr; there must be one, and no traceback."""
    lines = [line for line in errors.splitlines() if line.startswith("malus: ")]
    assert len(lines) == 1, errors
    assert "Traceback" not in errors
    return lines[0]


def start(*arguments: str) -> subprocess.Popen[str]:
    """A malus command in a process and process group of its own, which Ctrl-C stops.

    A shell starts what runs in the background with SIGINT ignored, and children inherit that.
    """
    script = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from malus.bench.cli import main; main()"
    )
    command = [sys.executable, "-c", script, *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, process_group=0
    )


def end(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code of a process and what it wrote to stderr."""
    _, errors = process.communicate(timeout=120)
    return process.returncode, errors


def wait_for(true: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Wait until something is true that a running process makes true."""
    while not true():
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


def files(folder: Path) -> set[str]:
    """Names of all files in a folder and below it."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def assert_same_results(folder: Path, expected: Path) -> None:
    """To the bit: the same renders of the same seeds, whoever made them and in which order."""
    pd.testing.assert_frame_equal(
        read_results(folder).table, read_results(expected).table, check_exact=True
    )
    assert files(folder / PARTS) == files(expected / PARTS)
    for path in (expected / PARTS).iterdir():
        one, other = pd.read_parquet(folder / PARTS / path.name), pd.read_parquet(path)
        pd.testing.assert_frame_equal(one, other, check_exact=True)
    assert files(folder / EXAMPLES) == files(expected / EXAMPLES)
    for path in (expected / EXAMPLES).iterdir():
        assert (folder / EXAMPLES / path.name).read_bytes() == path.read_bytes()


@contextmanager
def mounted(folder: Path, *options: str) -> Iterator[Path]:
    """A small file system of its own, where one may mount."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", ",".join(options), "none", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("no mount here")
    if done.returncode != 0:
        pytest.skip(f"may not mount a file system here: {done.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)
