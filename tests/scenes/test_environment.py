"""Radiance maps from OpenEXR files: what is no whole latitude-longitude map is refused by name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from malus.scenes import InputError
from malus.scenes.lights.environment import radiance_map
from malus.scenes.lights.lights import Environment
from malus.scenes.shapes.patterns import ImageTexture

CASES = Path(__file__).parents[1] / "cases" / "exr"


def written(path: Path, names: str = "RGB", **header: Any) -> Path:
    planes = {name: np.full((4, 8), 0.5, np.float32) for name in names}
    kind = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(kind | header, planes).write(str(path))
    return path


def test_a_cube_map_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="found a cube map"):
        radiance_map(Environment(name=str(CASES / "cube_environment.exr")))


def test_a_map_that_says_what_it_is_is_read(tmp_path: Path) -> None:
    path = written(tmp_path / "a.exr", envmap=OpenEXR.ENVMAP_LATLONG)
    np.testing.assert_array_equal(radiance_map(Environment(name=str(path))), np.full((4, 8), 0.5))


def test_a_part_of_a_map_is_refused(tmp_path: Path) -> None:
    whole = ((0, 0), (15, 7))
    path = written(tmp_path / "a.exr", dataWindow=((0, 0), (7, 3)), displayWindow=whole)
    with pytest.raises(InputError, match="a map of all directions"):
        radiance_map(Environment(name=str(path)))


@pytest.mark.parametrize(
    ("case", "says"), [("two_parts", "one picture"), ("luminance_chroma", "luminance and chroma")]
)
def test_what_is_not_one_picture_of_colours_is_refused(case: str, says: str) -> None:
    path = str(CASES / f"{case}.exr")
    with pytest.raises(InputError, match=says):
        radiance_map(Environment(name=path))
    with pytest.raises(InputError, match=says):
        ImageTexture(path=path).grey()
