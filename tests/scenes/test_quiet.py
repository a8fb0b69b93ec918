"""One line about a damaged file, whatever the library that reads it prints."""

from __future__ import annotations

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import tifffile
from runs import start

from malus.reconstruct.photos.read_picture import read_picture
from malus.renderers.datasets.spectral_exr import read_exr, write_exr
from malus.scenes import InputError
from malus.scenes.core.quiet import quiet
from malus.scenes.lights.environment import read_grey

NOISE = np.random.default_rng(1).random((64, 64, 3)).astype(np.float32)


def damaged_exr(folder: Path) -> Path:
    """Its pixels do not begin as its table says: OpenEXR prints that on both streams."""
    path = folder / "a.exr"
    write_exr(path, {name: NOISE[..., i] for i, name in enumerate("RGB")})
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 400] = bytes(400)
    path.write_bytes(content)
    return path


def damaged_tiff(folder: Path) -> Path:
    """A tag that leads nowhere: tifffile logs that, and raises about it later."""
    path = folder / "a.tif"
    tifffile.imwrite(path, NOISE, photometric="rgb", byteorder="<")
    content = path.read_bytes()
    bits = content.index((258).to_bytes(2, "little"))  # BitsPerSample, whose values stand elsewhere
    path.write_bytes(content[: bits + 8] + b"\xff\xff\xff\x7f" + content[bits + 12 :])
    return path


@pytest.mark.parametrize("damaged", [damaged_exr, damaged_tiff])
def test_a_damaged_picture_is_one_line(tmp_path: Path, damaged: object) -> None:
    path = damaged(tmp_path)  # type: ignore[operator]
    out = tmp_path / "out"
    process = start("filter", str(path), "--preset", "plastic", "--out", str(out))
    printed, errors = process.communicate(timeout=60)
    assert process.returncode == 2
    assert printed == ""
    assert errors.startswith(f"malus: {path}: expected ")
    assert errors.count("\n") == 1, errors


@pytest.mark.parametrize(
    "read", [read_picture, read_grey, lambda path: read_exr(path, (64, 64), "RGB")]
)
def test_every_reader_of_exr_files_is_quiet(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], read: object
) -> None:
    path = damaged_exr(tmp_path)
    with pytest.raises(InputError, match=r"OpenEXR|EXR file"):
        read(path)  # type: ignore[operator]
    assert capfd.readouterr() == ("", "")


def test_streams_come_back_whatever_threads_do(capfd: pytest.CaptureFixture[str]) -> None:
    def hide(number: int) -> None:
        with quiet():
            sys.stdout.write("hidden")
            os.write(2, b"hidden")
            if number % 3 == 0:
                raise ValueError("in the midst")

    open_before = len(os.listdir("/dev/fd"))
    with ThreadPoolExecutor(8) as pool:
        found = [pool.submit(hide, number).exception() is not None for number in range(300)]
    assert found == [number % 3 == 0 for number in range(300)]
    assert len(os.listdir("/dev/fd")) == open_before
    sys.stdout.write("seen\n")
    sys.stderr.write("told\n")
    os.write(2, b"by C")
    assert capfd.readouterr() == ("seen\n", "told\nby C")
