"""What a capture is told: numbers as people have them, and one line for anything else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from malus.reconstruct.photos.capture import read_capture
from malus.scenes import InputError
from malus.scenes.polarisation import analyser

ANGLES = (0, 45, 90, 135)
STOKES = np.array([0.8, 0.2, -0.1])


@pytest.fixture
def stack(tmp_path: Path) -> Path:
    light = analyser([float(a) for a in ANGLES]) @ STOKES
    path = tmp_path / "stack.npy"
    np.save(path, np.tile(light[:, None, None], (1, 6, 5)).astype(np.float32))
    return path


@pytest.fixture
def frame(tmp_path: Path) -> Path:
    path = tmp_path / "frame.bin"
    path.write_bytes(bytes(range(48)))
    return path


@pytest.mark.parametrize(
    "angles", [list(ANGLES), np.array(ANGLES), np.array(ANGLES, np.float32), range(0, 180, 45)]
)
def test_angles_are_any_list_or_array_of_numbers(stack: Path, angles: object) -> None:
    assert read_capture(stack, angles=angles).angles_deg == (0.0, 45.0, 90.0, 135.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("offset_deg", "3"), ("offset_deg", None), ("offset_deg", [1.0]), ("offset_deg", True),
        ("offset_deg", float("nan")), ("white", "3"), ("white", (1, 2)), ("white", []),
        ("angles", 45), ("angles", "0,45"), ("angles", ("a", "b", "c", "d")),
        ("angles", [[0, 45, 90, 135]]), ("angles", [0, [45], 90, 135]),
        ("zero", np.array([1, 2])), ("sense", 3), ("unit", 0), ("unit", ""),
        # A set has no order, and a dict is none of angles.
        ("angles", {0, 45, 90, 135}), ("angles", {0: 1, 45: 2, 90: 3, 135: 4}),
    ],
)  # fmt: skip
def test_other_values_of_a_stack_are_told_in_one_line(
    stack: Path, name: str, value: object
) -> None:
    """`offset_deg = "3"` ended in a TypeError; a set of angles was taken in the order of hashes."""
    where = name.removesuffix("_deg")
    with pytest.raises(InputError, match=rf"^{where}: expected .*, found [^\n]*$"):
        read_capture(stack, **{"angles": ANGLES, name: value})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mosaic", 90), ("mosaic", "90,45,135,0"), ("mosaic", {90, 45, 135, 0}),
        ("size", 8), ("size", "8x6"), ("size", (8.0, 6.0)), ("size", ("8", "6")),
        ("size", (8, 6, 1)), ("packing", 8), ("packing", b"mono8"),
    ],
)  # fmt: skip
def test_other_values_of_a_frame_are_told_in_one_line(
    frame: Path, name: str, value: object
) -> None:
    told = {"mosaic": (90, 45, 135, 0), "size": (8, 6), "packing": "mono8"}
    assert read_capture(frame, **told).pictures.shape == (4, 6, 8, 1)
    assert read_capture(frame, **told | {"size": np.array([8, 6])}).pictures.shape == (4, 6, 8, 1)
    with pytest.raises(InputError, match=rf"^{name}: expected .*, found [^\n]*$"):
        read_capture(frame, **told | {name: value})


@pytest.mark.parametrize("path", [None, 3, ["a"]])
def test_what_is_no_path_is_told(path: object) -> None:
    with pytest.raises(InputError, match=r"^path: expected a path, found"):
        read_capture(path)
