"""Models made in Python: a mistake is told in one line, and equal content has one id."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType

import numpy as np
import pytest

from malus.scenes import (
    Dielectric,
    Distant,
    InputError,
    Scene,
    Sphere,
    Uniform,
    load_suite,
)
from malus.scenes.camera import Camera
from malus.scenes.core.model import Model, content_id
from malus.scenes.materials.surface import Conductor, Patterned
from malus.scenes.shapes.patterns import Checker, Noise, Stripes
from malus.scenes.shapes.shapes import Plane
from malus.scenes.surroundings import Placed

PAINT = Dielectric(eta=1.5, alpha=0.3)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Dielectric(material="plastik", alpha=0.3), "Dielectric, .*material"),
        (lambda: Camera(resolution=16.5), "Camera, key resolution: expected a valid integer"),
        (lambda: Scene(wavelengths_nm=550), "Scene, key"),
        (lambda: Distant(), "Distant, key incidence_deg: expected this key, found nothing"),
        (
            lambda: Distant(60),
            "Distant: expected every value by its name, found 1 value without a name: 60; "
            "write key=value; known: incidence_deg, azimuth_deg",
        ),
        (lambda: Sphere(1, 2), "Sphere: .*found 2 values without a name: 1; leave it out"),
        (lambda: Dielectric(etta=1.5, alpha=0.3), "did you mean eta"),
        (
            lambda: Scene(
                shape={"kind": "sphere"},
                surface={"kind": "dielectric", "eta": 1.5, "alpha": -1},
                light={"kind": "uniform"},
            ),
            r"Scene, key surface\.alpha: expected greater than 0, found -1",
        ),
        (
            lambda: Placed(shape=Plane(), surface=PAINT, position=(0, "up", 0)),
            r"Placed, key position\.1: expected a valid number",
        ),
    ],
)
def test_a_mistake_in_python_is_told_in_one_line(make: Callable[[], Model], says: str) -> None:
    """Of data inside data it tells the place in the outermost."""
    with pytest.raises(InputError, match=says) as told:
        make()
    assert len(str(told.value).splitlines()) == 1


@pytest.mark.parametrize(
    "make",
    [
        lambda zero: Camera(roll_deg=zero),
        lambda zero: Distant(incidence_deg=30, azimuth_deg=zero),
        lambda zero: Placed(shape=Plane(), surface=PAINT, position=(zero, -1.0, zero)),
        lambda zero: Placed(shape=Plane(), surface=PAINT, position=[0.0, -1.0, zero]),
        lambda zero: Scene(
            shape=Sphere(), surface=PAINT, light=Uniform(), camera={"roll_deg": zero}
        ),
    ],
)
def test_a_zero_has_no_sign(make: Callable[[float], Model]) -> None:
    """Equal scenes have equal ids: in mathematics -0.0 is 0.0, in JSON it is another text."""
    assert make(-0.0) == make(0.0)
    assert make(-0.0).id == make(0.0).id


def test_what_is_parsed_keeps_its_zeros() -> None:
    """Scenes that are drawn or stored with -0.0 have ids of it, which stay."""
    content = Distant(incidence_deg=30, azimuth_deg=0.0).model_dump(mode="json")
    signed = content | {"azimuth_deg": -0.0}
    assert Distant.parse(signed, "test").id == content_id(signed) != content_id(content)


def test_a_stop_while_a_scene_is_written_is_not_lost() -> None:
    """Whichever Python function Ctrl-C falls into: pydantic drops what some of them raise."""
    parts = (PAINT, Conductor(material="gold", alpha=(0.1, 0.3)))
    scene = Scene(
        shape=Sphere(),
        surface=Patterned(pattern=Checker(), surfaces=parts),
        light=Uniform(),
    )
    for model in (scene, load_suite("quick")):
        stops = 0
        while _stopped_in_call(model, stops):
            stops += 1
        assert stops


def _stopped_in_call(model: Model, number: int) -> bool:
    """Whether writing a model calls so many Python functions, and stops in the last of them."""
    left = number

    def stop(frame: FrameType, event: str, _: object) -> None:
        nonlocal left
        if event == "call" and frame.f_code.co_name != "model_dump":
            left -= 1
            if left < 0:
                sys.setprofile(None)
                raise KeyboardInterrupt

    sys.setprofile(stop)
    try:
        model.model_dump(mode="json")
    except KeyboardInterrupt:
        return True
    finally:
        sys.setprofile(None)
    assert left >= 0, "a stop was lost"
    return False


def test_a_pattern_stands_in_tables_with_the_means_of_its_surfaces() -> None:
    parts = (
        Dielectric(eta=1.4, alpha=0.1, albedo=0.2),
        Dielectric(eta=1.5, alpha=0.1, albedo=0.2, body="unpolarised"),
        Dielectric(eta=1.9, alpha=0.7, albedo=0.8, distribution="ggx"),
    )
    whole = Patterned(pattern=Stripes(), surfaces=parts)
    assert whole.alpha == whole.isotropic_alpha == pytest.approx(0.3, rel=1e-12)
    assert whole.indices((550.0,)) == pytest.approx([1.6], rel=1e-12)
    assert whole.albedos((550.0,)) == pytest.approx([0.4], rel=1e-12)
    assert whole.distribution is None  # methods are told none where the surfaces differ
    assert whole.body == "mixed"
    alike = Patterned(pattern=Stripes(), surfaces=(parts[0], parts[0]))
    assert (alike.distribution, alike.body) == ("beckmann", "polarised")


@pytest.mark.parametrize("size", [0.2, 1.0])
def test_waves_of_a_noise_are_between_its_size_and_a_third_of_it(size: float) -> None:
    lengths = 2 * np.pi / np.linalg.norm(Noise(seed=4, size=size).waves()[:, :3], axis=1)
    assert lengths.max() == pytest.approx(size, rel=1e-12)
    assert size / 3 < lengths.min() < size / 2
