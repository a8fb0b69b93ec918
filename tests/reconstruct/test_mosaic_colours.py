"""A frame that is read as grey though it has colours, has them elsewhere, or is a JPEG, is told."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import tifffile

from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.mosaic import BAYER_ORDERS, colour_hints

SONY = (90, 45, 135, 0)
RNG = np.random.default_rng(31)


def _frame(order: str | None, side: int = 64) -> np.ndarray:
    """Codes of 12 bits of coloured cloths in polarised light, with a code of noise, black 0."""
    y, x = np.mgrid[:side, :side]
    cloths = np.array([[0.7, 0.5, 0.3], [0.2, 0.4, 0.6], [0.5, 0.5, 0.5], [0.3, 0.4, 0.1]])
    colours = cloths[((x // 24) + (y // 24)) % 4] * [0.6, 1.0, 0.6]  # red and blue alike in all
    channel = np.ones((side, side), int)
    if order is not None:
        letters = np.array(["rgb".index(letter) for letter in order]).reshape(2, 2)
        channel = letters[y // 2 % 2, x // 2 % 2]
    angle = np.radians(np.array(SONY).reshape(2, 2)[y % 2, x % 2])
    light = 0.5 * (1 + 0.2 * np.cos(2 * angle - 0.7)) * (1 + 0.3 * np.sin(x / 9))
    light = light * np.take_along_axis(colours, channel[..., None], -1)[..., 0]
    return np.rint(np.clip(3000 * light + RNG.normal(0, 1, light.shape), 0, 4095))


def _hints(tmp_path: Path, frame: np.ndarray, bayer: str | None) -> str:
    tifffile.imwrite(tmp_path / "frame.tif", frame.astype(np.uint16))
    return "; ".join(read_capture(tmp_path / "frame.tif", mosaic=SONY, bayer=bayer).hints)


@pytest.mark.parametrize("order", BAYER_ORDERS)
def test_a_colour_frame_without_its_colours_is_told(tmp_path: Path, order: str) -> None:
    assert "give the order of its colours as `bayer`" in _hints(tmp_path, _frame(order), None)


def test_a_grey_frame_is_not_doubted(tmp_path: Path) -> None:
    assert "bayer" not in _hints(tmp_path, _frame(None), None)
    texture = RNG.uniform(0, 1, (64, 64)).astype(np.float32)  # the finest that there is
    assert colour_hints(texture, None) == []
    assert colour_hints(np.zeros((64, 64), np.float32), None) == []
    for _ in range(100):  # of nothing but noise around the dark level, every difference is large
        dark = RNG.normal(0, 1e-3, (64, 64)).astype(np.float32)
        assert not [hint for given in (None, "rggb", "grbg") for hint in colour_hints(dark, given)]


@pytest.mark.parametrize(("order", "given"), list(product(BAYER_ORDERS, BAYER_ORDERS)))
def test_green_stands_on_its_own_diagonal(tmp_path: Path, order: str, given: str) -> None:
    """Red for blue is not seen, and so not told."""
    same_diagonal = order.index("g") in (0, 3) and given.index("g") in (0, 3)
    same_diagonal |= order.index("g") == given.index("g") == 1
    hints = _hints(tmp_path, _frame(order), given)
    assert ("the other diagonal looks green" in hints) is not same_diagonal
    if not same_diagonal:
        assert order in hints.rpartition("as in")[2]


def test_a_lossy_frame_is_told(tmp_path: Path) -> None:
    """At quality 75, which is usual, the angle of polarisation was 2 degrees off."""
    codes = (_frame(None) / 16).astype(np.uint8)
    hints = {}
    for suffix in ("jpg", "png"):
        PIL.Image.fromarray(codes).save(tmp_path / f"frame.{suffix}")
        hints[suffix] = "".join(read_capture(tmp_path / f"frame.{suffix}", mosaic=SONY).hints)
    assert "save frames of the camera as PNG or TIFF" in hints["jpg"]
    assert "JPEG" not in hints["png"]
