"""A full disk and a read-only folder, for every command that writes: one line, nothing lost."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from runs import NOBODY, SUITE, end, files, mounted, start

from malus.bench import run
from malus.bench.datasets.render import render_dataset
from malus.bench.running.status import status
from malus.renderers.datasets.dataset import open_dataset

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
    return folder


def commands(made: Path, out: Path) -> dict[str, tuple[str, ...]]:
    return {
        "render": ("render", "quick", *SIZES, "--out", str(out)),
        "export": ("export", str(made / "data"), "--format", "numpy", "--out", str(out)),
        "score": ("score", str(made / "data"), "--method", "eq8", "--out", str(out)),
        "filter": (
            *("filter", str(made / "a.png"), "--mask", str(made / "mask.png")),
            *("--light", "1,1,2", "--preset", "plastic", "--angle", "0", "--out", str(out)),
        ),
        "bench": ("bench", "reconstruct", "--megapixels", "0.001", "--out", str(out)),
    }


def one_line(errors: str) -> str:
    lines = [line for line in errors.splitlines() if line.startswith("malus: ")]
    assert len(lines) == 1, errors
    assert "Traceback" not in errors
    return lines[0]


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    with mounted(tmp_path / "fixed", "ro") as folder:
        yield folder


@pytest.mark.parametrize("command", ["render", "export", "score", "filter", "bench"])
def test_a_read_only_folder_is_one_line(made: Path, read_only: Path, command: str) -> None:
    code, errors = end(start(*commands(made, read_only)[command]))
    assert code == 2, errors
    assert "Read-only file system" in one_line(errors)


@pytest.mark.parametrize("command", ["render", "export", "score", "filter", "report"])
def test_a_full_disk_is_one_line_and_leaves_nothing_half_written(
    made: Path, tmp_path: Path, command: str
) -> None:
    with mounted(tmp_path / "small", "size=256k") as small:
        out = small / "out"
        out.mkdir()
        if command == "report":
            for name in ("results.parquet", "run.json"):
                (out / name).write_bytes((made / "run" / name).read_bytes())
        free = 32_768 if command == "render" else 4096
        ballast = small / "ballast"
        taken = sum(f.stat().st_size for f in out.rglob("*") if f.is_file())
        ballast.write_bytes(bytes(max(0, 256 * 1024 - taken - free)))
        arguments = ("report", str(out)) if command == "report" else commands(made, out)[command]
        code, errors = end(start(*arguments))
        assert code == 2, errors
        assert "No space left on device" in one_line(errors)
        assert not [name for name in files(out) if ".part-" in name]
        if command != "render":
            return
        assert 0 <= len(list(open_dataset(out))) < 16
        assert not status(out).failed
        ballast.unlink()
        subprocess.run(["mount", "-o", "remount,size=16m", str(small)], check=True)
        code, errors = end(start(*arguments))
        assert code == 0, errors
        assert len(list(open_dataset(out))) == 16
