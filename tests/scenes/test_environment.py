"""Radiance maps from OpenEXR files: what is no whole latitude-longitude map is refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from malus.scenes import InputError
from malus.scenes.lights.environment import radiance_map
from malus.scenes.lights.lights import Environment, Uniform
from malus.scenes.shapes.patterns import ImageTexture

CASES = Path(__file__).parents[1] / "cases" / "exr"


def written(path: Path, names: str = "RGB", size: tuple[int, int] = (4, 8), **header: Any) -> Path:
    planes = {name: np.full(size, 0.5, np.float32) for name in names}
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(kind | header, planes).write(str(path))
    return path


def test_a_cube_map_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="found a cube map"):
        radiance_map(Environment(name=str(CASES / "cube_environment.exr")))


def test_a_map_that_says_what_it_is_is_read(tmp_path: Path) -> None:
    path = written(tmp_path / "a.exr", envmap=OpenEXR.ENVMAP_LATLONG)
    np.testing.assert_array_equal(radiance_map(Environment(name=str(path))), np.full((4, 8), 0.5))


@pytest.mark.parametrize(
    ("size", "says"),
    [
        ((8, 8), "light probe"),
        ((6, 8), "cross"),
        ((8, 6), "cross"),
        ((2, 12), "strip"),
        ((8, 4), "on its side"),
    ],
)
@pytest.mark.parametrize("suffix", ["exr", "hdr"])
def test_the_shape_of_another_layout_is_refused(
    tmp_path: Path, size: tuple[int, int], says: str, suffix: str
) -> None:
    """Light probes of Debevec's are angular maps, square and without a word of it."""
    path = tmp_path / f"a.{suffix}"
    if suffix == "exr":
        written(path, size=size)
    else:
        head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {size[0]} +X {size[1]}\n".encode()
        path.write_bytes(head + bytes([128, 128, 128, 128]) * (size[0] * size[1]))
    with pytest.raises(InputError, match=says):
        radiance_map(Environment(name=str(path)))


@pytest.mark.parametrize("largest", [1e-12, 2e-9, 9e8, 1e12, 1e30])
def test_a_map_is_as_bright_as_other_lights_may_be(tmp_path: Path, largest: float) -> None:
    """A square or an inverse beyond float32 would make standard errors that are no numbers."""
    path = tmp_path / "a.exr"
    plane = np.zeros((4, 8), np.float32)
    plane[0, 0] = largest
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Y": plane}).write(str(path))
    light = Environment(name=str(path))
    try:
        Uniform(radiance=float(plane.max()))
    except InputError:
        with pytest.raises(InputError, match="a largest radiance of 1e-09 to 1e"):
            radiance_map(light)
    else:
        assert radiance_map(light).max() == plane.max()


def test_a_square_map_may_say_that_it_is_one(tmp_path: Path) -> None:
    path = written(tmp_path / "a.exr", size=(8, 8), envmap=OpenEXR.ENVMAP_LATLONG)
    assert radiance_map(Environment(name=str(path))).shape == (8, 8)


def test_a_part_of_a_map_is_refused(tmp_path: Path) -> None:
    whole = ((0, 0), (15, 7))
    path = written(tmp_path / "a.exr", dataWindow=((0, 0), (7, 3)), displayWindow=whole)
    with pytest.raises(InputError, match="a whole picture, found a part of it"):
        radiance_map(Environment(name=str(path)))
    with pytest.raises(InputError, match="a whole picture, found a part of it"):
        ImageTexture(path=str(path)).grey()


@pytest.mark.parametrize(
    ("case", "says"), [("two_parts", "one picture"), ("luminance_chroma", "luminance and chroma")]
)
def test_what_is_not_one_picture_of_colours_is_refused(case: str, says: str) -> None:
    path = str(CASES / f"{case}.exr")
    with pytest.raises(InputError, match=says):
        radiance_map(Environment(name=path))
    with pytest.raises(InputError, match=says):
        ImageTexture(path=path).grey()
