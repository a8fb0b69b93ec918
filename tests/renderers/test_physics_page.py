"""What the page on physics says of s3 and of light that is lost is what renders show."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from plain import MIRROR
from rooms import needs_arrays

from malus.renderers import render
from malus.renderers.truth import Truth
from malus.scenes import (
    Camera,
    Conductor,
    Distant,
    Light,
    Polariser,
    Sampling,
    Scene,
    Shape,
    Sky,
    SkyPolarisation,
    Sphere,
    Torus,
    Uniform,
)
from malus.scenes.materials.surface import Distribution

PAGE = " ".join(Path(__file__, "../../../reports/docs/physics.md").resolve().read_text().split())
GOLDEN = Conductor(material="gold", alpha=0.2)


def truth_of(
    light: Light, sampling: Sampling, shape: Shape | None = None, resolution: int = 24
) -> Truth:
    camera = Camera(resolution=resolution)
    scene = Scene(shape=shape or Sphere(), surface=GOLDEN, light=light, camera=camera)
    return render(scene, sampling)


def largest_s3(truth: Truth) -> float:
    assert truth.s3 is not None
    return float(abs(truth.s3[truth.mask]).max())


def told(pattern: str) -> list[float]:
    """Percentages in the only place of the page that a pattern matches, as shares."""
    (numbers,) = re.findall(pattern, PAGE)
    return [0.01 * float(number) for number in ([numbers] if isinstance(numbers, str) else numbers)]


@needs_arrays
def test_circular_light_of_gold_is_what_the_page_says() -> None:
    """Of the peak of the picture; the page rounds to a percent."""
    lamps = [
        Distant(incidence_deg=60, polarised=Polariser(angle_deg=30)),
        Distant(incidence_deg=60, azimuth_deg=0, polarised=Polariser(angle_deg=45)),
    ]
    of_sky = SkyPolarisation()
    skies = [Sky(sun=False, sun_elevation_deg=e, polarised=of_sky) for e in (15, 65)]
    expected = told(
        r"(\d+) % of the peak of the picture under a distant lamp at 60°.*?\((\d+) % at 45°"
    )
    expected += told(r"its sun (\d+) % \(sun at 15°\) to (\d+) %")
    for light, share in zip([*lamps, *skies], expected, strict=True):
        truth = truth_of(light, Sampling(samples=1024))
        found = largest_s3(truth) / truth.image[truth.mask].max()
        # The largest of 350 pixels, which noise and coarser pixels change by a tenth.
        assert found == pytest.approx(share, rel=0.12), light.label


@needs_arrays
def test_circular_light_of_other_reflections_is_what_the_page_says() -> None:
    (share,) = told(r"light from all around, up to (\d+) % of the radiance of that light")
    truth = truth_of(Uniform(), Sampling(samples=256, max_depth=5), Torus(), resolution=64)
    # Rounded to a percent; the noise of the brightest of a thousand pixels is 6 % of it.
    assert largest_s3(truth) == pytest.approx(share, rel=0.2)


@needs_arrays
@pytest.mark.parametrize(("distribution", "lost"), [("beckmann", 1 / 3), ("ggx", 2 / 3)])
def test_rough_metals_lose_as_much_as_the_page_says(
    distribution: Distribution, lost: float
) -> None:
    """In a furnace a metal that absorbs nothing returns all but what its facets send each other."""
    assert "a third of the light with Beckmann's facets, two thirds with GGX" in PAGE
    metal = Conductor(**MIRROR, alpha=1.0, distribution=distribution)
    scene = Scene(shape=Sphere(), surface=metal, light=Uniform(), camera=Camera(resolution=16))
    truth = render(scene, Sampling(samples=256))
    assert 1 - truth.image[truth.mask].mean() == pytest.approx(lost, abs=0.05)
