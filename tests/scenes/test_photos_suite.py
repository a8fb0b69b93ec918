"""The suite `photos`: what its scenes are, without a render."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import pytest

from malus.scenes import Blob, Lathe, MeshFile, Plane, Sphere, Superquadric, Torus, load_suite
from malus.scenes.random_suite.splits import check_leaks
from malus.scenes.scene import Scene
from malus.scenes.shapes.resting import lowest
from malus.scenes.suite import Suite

COUNT = 120


@pytest.fixture(scope="module")
def suite() -> Suite:
    return load_suite("photos")


@pytest.fixture(scope="module")
def scenes(suite: Suite) -> list[Scene]:
    assert suite.draws is not None
    return [suite.draws.scene(index) for index in range(COUNT)]


def test_a_larger_count_changes_no_scene(suite: Suite, scenes: list[Scene]) -> None:
    assert suite.random is not None
    larger = suite.random.model_copy(update={"count": 100_000})
    draws = larger.draws(suite.camera, suite.wavelengths_nm, suite.splits)
    assert [draws.scene(i).id for i in range(10)] == [scene.id for scene in scenes[:10]]


def test_splits_share_no_shape_material_or_light(suite: Suite, scenes: list[Scene]) -> None:
    assert suite.splits is not None
    assert suite.draws is not None
    named = [(s, s.id, suite.draws.split(i)) for i, s in enumerate(scenes)]
    assert {split for *_, split in named} == {"train", "val", "test"}
    found = check_leaks([(s, name, split) for s, name, split in named if split], suite.splits)
    assert set(found) == {"shape", "material", "light"}


def test_cameras_are_upright_and_look_down_a_little(scenes: list[Scene]) -> None:
    for scene in scenes:
        assert scene.camera.projection == "perspective"
        assert 5 <= scene.camera.elevation_deg <= 50
        assert abs(scene.camera.roll_deg) <= 4


def test_shares_of_rooms_yards_and_single_objects(scenes: list[Scene]) -> None:
    names = Counter(s.surroundings.name if s.surroundings else "none" for s in scenes)
    weights = {"none": 0.8, "table": 3, "corner": 2, "floor": 1.5, "yard": 2.5}
    for name, weight in weights.items():
        # Stratified: a share is off by the discrepancy of the sequence, a few scenes of 120.
        assert names[name] == pytest.approx(COUNT * weight / 9.8, abs=3)
    # Within each split apart, and by bands that are shared out among the splits.
    lights = Counter(s.light.kind for s in scenes)
    assert lights["interior"] == pytest.approx(COUNT * 8 / 12.5, abs=10)


def test_objects_stand_on_the_floor(scenes: list[Scene]) -> None:
    for scene in scenes:
        if scene.surroundings is None:
            continue
        floor = scene.surroundings.objects[0]
        assert isinstance(floor.shape, Plane)
        things = [p for p in scene.objects if not isinstance(p.shape, Plane)]
        assert len(things) > 1
        for placed in things:
            foot = placed.position[1] + placed.scale * lowest(placed.shape)
            assert foot == pytest.approx(floor.position[1], abs=2e-4)  # four digits are kept


def test_the_lowest_point_of_a_file_is_that_of_its_upright_axis(tmp_path: Path) -> None:
    file = tmp_path / "wedge.obj"
    file.write_text("v 0 0 0\nv 4 0 0\nv 0 2 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    heights = [lowest(MeshFile(path=str(file), up=up)) for up in ("y", "z")]
    # Half of the box 4 x 2 x 1 below its middle, of which the farthest corner is at radius 1.
    assert heights == pytest.approx([-2 / math.sqrt(21), -1 / math.sqrt(21)], abs=1e-5)


@pytest.mark.parametrize(
    "shape",
    [
        Sphere(),
        Blob(seed=4),
        Lathe(seed=13),
        Torus(tilt_deg=20),
        Superquadric(e1=0.2, e2=0.2, stretch=(1, 0.3, 0.7)),
        Superquadric(e1=0.1, e2=0.1),
    ],
)
def test_the_lowest_point_is_that_of_the_whole_mesh(shape: Blob) -> None:
    from malus.renderers.mitsuba.translate import tessellated

    exact = -1.0 if isinstance(shape, Sphere) else tessellated(shape).vertices[:, 1].min()
    is_box = isinstance(shape, Superquadric) and min(shape.e1, shape.e2) < 0.2
    bound = 0.01 if is_box else 0.005  # as its docstring promises
    assert lowest(shape) == pytest.approx(exact, abs=bound)
    assert not is_box or abs(lowest(shape) - exact) > 0.005
