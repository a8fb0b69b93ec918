"""A radiance map is rendered as it is documented: each row is a band of directions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from rooms import needs_arrays

from malus.renderers.mitsuba.lighting import environment_emitter
from malus.renderers.variant import choose, mitsuba
from malus.scenes import Environment, Interior, Sky
from malus.scenes.lights.environment import directions, light_shares, radiance_map, solid_angles
from malus.scenes.lights.lights import MapLight

pytestmark = needs_arrays


def from_directions(light: MapLight, toward: np.ndarray) -> np.ndarray:
    """Radiance of Mitsuba's emitter from unit vectors (rows, columns, 3)."""
    import drjit as dr

    mi: Any = mitsuba(choose("llvm"))
    emitter = mi.load_dict(environment_emitter(mi, light))
    point = dr.zeros(mi.SurfaceInteraction3f, toward[..., 0].size)
    point.wi = -mi.Vector3f(np.ascontiguousarray(toward.reshape(-1, 3).T, np.float32))
    return np.array(emitter.eval(point)[0, 0][0]).reshape(toward.shape[:-1])


@pytest.fixture
def stripes(tmp_path: Path) -> Environment:
    """Few rows, so that half a row is many degrees."""
    path = tmp_path / "stripes.exr"
    plane = np.random.default_rng(3).uniform(0.1, 1.0, (4, 8)).astype(np.float32)
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Y": plane}).write(str(path))
    return Environment(name=str(path), turn_deg=20, tilt_deg=15, heading_deg=-40)


def test_the_middle_of_a_pixel_has_its_radiance(stripes: Environment) -> None:
    """Mitsuba has rows from pole to pole, and would show the map of 4 rows up to 22° elsewhere."""
    for light in (stripes, Environment(), Sky(sun_elevation_deg=30), Interior(seed=2)):
        values = radiance_map(light)
        toward = directions(*values.shape, light.rotation)
        # A direction in single precision is wrong by a few 1e-7: by 1e-4 of a pixel, where an
        # edge has the largest difference.
        np.testing.assert_allclose(from_directions(light, toward), values, atol=1e-4 * values.max())


def test_between_two_rows_is_their_mean(stripes: Environment) -> None:
    values = radiance_map(stripes)
    toward = directions(8, 8, stripes.rotation)  # a quarter above and below the middle of a row
    above = np.vstack([values[:1], values[:-1]])
    below = np.vstack([values[1:], values[-1:]])
    found = from_directions(stripes, toward)
    np.testing.assert_allclose(found[::2], 0.75 * values + 0.25 * above, rtol=1e-5)
    np.testing.assert_allclose(found[1::2], 0.75 * values + 0.25 * below, rtol=1e-5)


@pytest.mark.parametrize("row", [0, 1, 4])
def test_methods_weigh_a_row_by_the_light_that_the_renderer_makes_of_it(
    row: int, tmp_path: Path
) -> None:
    """By its band alone, a lamp in an outermost row would be told 8 % too dim."""
    path = tmp_path / "lamp.exr"
    plane = np.zeros((5, 10), np.float32)
    plane[row] = 1.0
    OpenEXR.File({"type": OpenEXR.scanlineimage}, {"Y": plane}).write(str(path))
    fine = 500, 20
    rendered = from_directions(Environment(name=str(path)), directions(*fine))
    light = float((rendered * solid_angles(*fine)).sum())
    # A sum over 100 directions a row; single precision adds less.
    assert float(10 * light_shares(5, 10)[row, 0]) == pytest.approx(light, rel=1e-4)
