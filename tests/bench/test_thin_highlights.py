"""Highlights that samples may miss are counted, and told by `malus plan`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from malus.bench.commands.plan import plan_command
from malus.bench.running.thin_highlights import ENOUGH, highlight_samples, thin_highlights
from malus.scenes import (
    Camera,
    Conductor,
    Dielectric,
    Distant,
    Patterned,
    Placed,
    Plane,
    Scene,
    Sky,
    Sphere,
    Stripes,
    Surroundings,
    Uniform,
)
from malus.scenes.lights.lights import Light


def ball(alpha: float, camera: Camera, light: Light | None = None) -> Scene:
    surface = Dielectric(eta=1.5, alpha=alpha)
    return Scene(
        shape=Sphere(), surface=surface, light=light or Distant(incidence_deg=30), camera=camera
    )


@pytest.mark.parametrize(
    "camera",
    [
        Camera(resolution=64),
        Camera(resolution=64, half_width=2.0),
        Camera(resolution=64, projection="perspective", fov_deg=20, distance=12.0),
    ],
)
def test_samples_on_the_highlight_are_those_that_fall_there(camera: Camera) -> None:
    """Points where the normal is within α of the half vector, of light from behind the viewer."""
    alpha, samples, fine = 0.1, 16, 4096
    # The highlight lies on the front of the ball, nearer to the camera than the origin by 1.
    half, nearer = camera.half_width, 1.0
    if camera.distance is not None and camera.fov_deg is not None:
        half = (camera.distance - 1) * math.tan(math.radians(0.5 * camera.fov_deg))
        nearer = camera.distance / (camera.distance - 1)
    x = half * (2 * (np.arange(fine) + 0.5) / fine - 1)
    share = np.count_nonzero(np.hypot(x, x[:, None]) < math.sin(alpha)) / fine**2
    falling = share * camera.resolution**2 * samples
    # sin α in place of α is 0.3 % of the area, and the counted disc is right to 0.1 %; that the
    # front is nearer is left out.
    expected = pytest.approx(falling / nearer**2, rel=0.01)
    assert highlight_samples(ball(alpha, camera), samples) == expected


def test_the_highlight_of_brushed_metal_is_an_ellipse() -> None:
    """Its area is that of a disc whose radius is the geometric mean of the two."""
    brushed, round_one = (
        ball(0.1, Camera(resolution=64)).model_copy(
            update={"surface": Conductor(material="gold", alpha=alpha)}
        )
        for alpha in ((0.4, 0.1), 0.2)
    )
    expected = pytest.approx(highlight_samples(round_one, 16), rel=1e-12)
    assert highlight_samples(brushed, 16) == expected


def test_a_sun_is_mirrored_as_a_distant_light_is() -> None:
    """Over seeds the light of the highlights spreads as under such a lamp: the disc is a point."""
    camera = Camera(resolution=48)
    lamp = ball(0.003, camera)
    assert highlight_samples(ball(0.003, camera, Sky()), 64) == highlight_samples(lamp, 64)
    assert highlight_samples(ball(0.003, camera, Sky(sun=False)), 64) == math.inf


def test_the_smallest_highlight_of_all_objects_and_surfaces_counts() -> None:
    """It is as large as on its object alone; a plane is not curved and has none."""
    rough, smooth = (Dielectric(eta=1.5, alpha=alpha) for alpha in (0.3, 0.005))
    own = ball(0.3, Camera(resolution=48))

    def among(*objects: Placed) -> float:
        around = Surroundings(name="desk", objects=objects)
        return highlight_samples(own.model_copy(update={"surroundings": around}), 16)

    expected = pytest.approx(highlight_samples(ball(0.005, own.camera), 16), rel=1e-12)
    assert among(Placed(shape=Sphere(), surface=smooth)) == expected
    halved = Placed(shape=Sphere(), surface=smooth.model_copy(update={"alpha": 0.01}), scale=0.5)
    assert among(halved) == expected
    assert among(Placed(shape=Plane(), surface=smooth)) == highlight_samples(own, 16)
    striped = Patterned(pattern=Stripes(), surfaces=(rough, smooth))
    assert highlight_samples(own.model_copy(update={"surface": striped}), 16) == expected


def test_the_limits_tell_samples_as_they_are_counted() -> None:
    limits = (Path(__file__).parents[2] / "reports/docs/start/limits.md").read_text("utf-8")
    for alpha, told in ((0.02, "(42 samples)"), (0.01, "(11 samples)"), (0.003, "(one sample)")):
        count = highlight_samples(ball(alpha, Camera(resolution=48)), 64)
        assert told == ("(one sample)" if round(count) == 1 else f"({round(count)} samples)")
        assert told in limits


def test_light_from_everywhere_has_no_highlight_to_miss() -> None:
    scenes = [
        ball(1e-3, Camera(resolution=48), light) for light in (Uniform(), Distant(incidence_deg=30))
    ]
    assert highlight_samples(scenes[0], 16) == math.inf
    assert highlight_samples(scenes[1], 16) < ENOUGH
    assert thin_highlights(scenes, 16) == 1


@pytest.mark.parametrize(("alpha", "says"), [(0.003, "1 scenes have highlights"), (0.3, "")])
def test_a_plan_tells_of_them(tmp_path: Path, alpha: float, says: str) -> None:
    suite = f"""
name = "smooth"
shapes = [{{ kind = "sphere" }}]
materials = ["water"]
surfaces = [{{ alpha = {alpha} }}]
bodies = ["polarised"]
lights = [{{ kind = "uniform" }}, {{ kind = "distant", incidence_deg = 60 }}]
wavelengths_nm = [550]
methods = ["unpolarised"]
camera = {{ resolution = 24 }}
sampling = {{ samples = 16 }}
"""
    (tmp_path / "s.toml").write_text(suite, "utf-8")
    told = CliRunner().invoke(plan_command, [str(tmp_path / "s.toml"), "--backend", "scalar"])
    assert told.exit_code == 0, told.output
    assert says in told.output
    assert ("highlights" in told.output) == bool(says)
