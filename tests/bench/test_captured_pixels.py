"""Which pixels of a capture count when methods are scored on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tifffile

from malus.bench.running.capture_suite import CaptureEntry
from malus.bench.running.captures import Photographed
from malus.scenes import polarisation

SIDE = 16


def write_pictures(folder: Path, stokes: np.ndarray) -> None:
    """Pictures of 16 bits through a polariser, whose largest code is a light of 1."""
    folder.mkdir()
    for angle in (0.0, 45.0, 90.0, 135.0):
        light = np.clip(polarisation.polarised(stokes, angle), 0, 1)
        codes = np.rint(65535 * light).astype(np.uint16)
        tifffile.imwrite(folder / f"pol_{angle:03.0f}.tif", codes, photometric="rgb")


def test_clipped_pixels_count_for_no_method(tmp_path: Path) -> None:
    """Their sinusoid is cut off: it is no truth."""
    s0 = np.random.default_rng(0).uniform(0.2, 0.9, (SIDE, SIDE, 3))
    s0[3:6, 4:9] = 4.0
    write_pictures(tmp_path / "pot", np.stack([s0, 0.3 * s0, -0.1 * s0], axis=-1))
    captured = Photographed.of(CaptureEntry(folder=str(tmp_path / "pot"), linear=True), 1)
    clipped = np.zeros((SIDE, SIDE), bool)
    clipped[3:6, 4:9] = True
    np.testing.assert_array_equal(captured.scored, ~clipped)
    assert captured.about["objects"] == [SIDE**2 - 15]
