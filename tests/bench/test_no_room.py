"""A full disk and a read-only folder, for every command that writes: one line, nothing lost."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from runs import (
    NOBODY,
    SMALL,
    SUITE,
    TINY,
    assert_same_results,
    files,
    mounted,
    one_line,
    run_malus,
)

from malus.bench import run
from malus.bench.datasets.render import render_dataset
from malus.bench.running.status import status
from malus.renderers.datasets.dataset import open_folder
from malus.scenes.core.result_files import RUN, TABLE

SIZES = ("--resolution", "8", "--samples", "2")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset, a run and a picture to work on."""
    folder = tmp_path_factory.mktemp("made")
    render_dataset(SUITE, folder / "data", NOBODY)
    run(SUITE, folder / "run", NOBODY)
    y, x = np.mgrid[-1:1:32j, -1:1:32j]
    ball = np.sqrt(np.clip(0.8 - x**2 - y**2, 0, None))
    Image.fromarray((200 * ball).astype(np.uint8)).save(folder / "a.png")
    Image.fromarray((255 * (ball > 0)).astype(np.uint8)).save(folder / "mask.png")
    (folder / "capture").mkdir()
    for angle in (0, 45, 90, 135):
        light = 100 * ball * (1.5 + np.cos(np.radians(2 * angle)) / 2)
        Image.fromarray(light.astype(np.uint8)).save(folder / "capture" / f"{angle}.png")
    return folder


def commands(made: Path, out: Path) -> dict[str, tuple[str, ...]]:
    return {
        "run": (*TINY, "--out", str(out)),
        "render": ("render", "quick", *SIZES, "--out", str(out)),
        "export": ("export", str(made / "data"), "--format", "numpy", "--out", str(out)),
        "score": ("score", str(made / "data"), "--method", "eq8", "--out", str(out)),
        "filter": (
            *("filter", str(made / "a.png"), "--mask", str(made / "mask.png")),
            *("--light", "1,1,2", "--preset", "plastic", "--angle", "0", "--out", str(out)),
        ),
        "capture": ("capture", str(made / "capture"), "--fit-only", "--out", str(out)),
        "bench": ("bench", "reconstruct", "--megapixels", "0.001", "--out", str(out)),
    }


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    with mounted(tmp_path / "fixed", "ro") as folder:
        yield folder


WRITING = ("run", "render", "export", "score", "filter", "capture", "bench")


@pytest.mark.parametrize("command", WRITING)
def test_a_read_only_folder_is_one_line(made: Path, read_only: Path, command: str) -> None:
    done = run_malus(*commands(made, read_only)[command])
    assert done.returncode == 2, done.stderr
    assert "Read-only file system" in one_line(done.stderr)


ROOM = {"run": 100_000, "render": 32_768}
"""Bytes for a plan and a few parts or scenes, not for all."""


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Path]:
    """A disk of 256 KiB."""
    with mounted(tmp_path / "small", "size=256k") as folder:
        yield folder


def fill(disk: Path, free: int) -> Path:
    """A file that leaves so many bytes free."""
    ballast = disk / "ballast"
    ballast.write_bytes(bytes(max(0, shutil.disk_usage(disk).free - free)))
    return ballast


def make_room(disk: Path, ballast: Path) -> None:
    ballast.unlink()
    subprocess.run(["mount", "-o", "remount,size=16m", str(disk)], check=True)


def full(out: Path, *arguments: str) -> None:
    """A command that ends in one line for want of room, and leaves nothing half written."""
    done = run_malus(*arguments)
    assert done.returncode == 2, done.stderr
    assert f"malus: {out}" in one_line(done.stderr)
    assert "No space left on device" in done.stderr
    assert ".part-" not in done.stderr
    assert not [name for name in files(out) if ".part-" in name]


@pytest.mark.parametrize("command", ["export", "score", "filter", "capture", "report"])
def test_a_full_disk_is_one_line(made: Path, small: Path, command: str) -> None:
    out = small / "out"
    out.mkdir()
    if command == "report":
        for name in (TABLE, RUN):
            shutil.copy(made / "run" / name, out)
    fill(small, 4096)
    full(out, *(("report", str(out)) if command == "report" else commands(made, out)[command]))


def test_a_render_on_a_full_disk_is_gone_on_with(made: Path, small: Path) -> None:
    out = small / "out"
    out.mkdir()
    ballast = fill(small, ROOM["render"])
    full(out, *commands(made, out)["render"])
    assert 0 <= len(list(open_folder(out))) < 16
    assert not status(out).failed
    make_room(small, ballast)
    assert run_malus(*commands(made, out)["render"]).returncode == 0
    assert len(list(open_folder(out))) == 16


def test_a_run_on_a_full_disk_is_gone_on_with(made: Path, small: Path, tmp_path: Path) -> None:
    out = small / "out"
    out.mkdir()
    ballast = fill(small, ROOM["run"])
    full(out, *commands(made, out)["run"])
    done = status(out).done
    assert 0 < done < 8
    assert not status(out).failed
    make_room(small, ballast)
    assert run(SMALL, out).run["families_taken_over"] == done
    run(SMALL, tmp_path / "whole")
    assert_same_results(out, tmp_path / "whole")


def test_a_full_standard_output_is_named() -> None:
    with open("/dev/full", "w", encoding="utf-8") as output:
        command = [sys.executable, "-m", "malus", "list", "materials"]
        done = subprocess.run(command, stdout=output, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert "room for standard output or temporary files, found No space" in one_line(done.stderr)


@pytest.mark.parametrize("arguments", [("list", "nothing"), TINY], ids=["mistake", "run"])
def test_a_full_error_stream_leaves_the_exit_code(
    arguments: tuple[str, ...], tmp_path: Path
) -> None:
    """It was 1, as of a run of which a family failed."""
    command = [sys.executable, "-m", "malus", *arguments]
    with open("/dev/full", "w", encoding="utf-8") as errors:
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=errors, cwd=tmp_path)
    assert done.returncode == 2
