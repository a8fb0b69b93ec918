"""Random scenes follow their ranges, each from its number alone."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
import pytest
from random_suites import AXES, BASE, SPLITS, drawn, suite
from scipy import stats

from malus.bench.running.plan import plan
from malus.scenes import (
    Camera,
    InputError,
    Suite,
)
from malus.scenes.random_suite.clutter import Clutter, place
from malus.scenes.random_suite.sequence import Numbers
from malus.scenes.random_suite.templates import distribution, variants


def test_a_larger_count_keeps_the_first_scenes_to_the_bit() -> None:
    few, many = drawn(suite(count=100)), drawn(suite(count=200))
    assert many[:100] == few
    assert [scene.id for scene in many[:100]] == [scene.id for scene in few]
    assert len({scene.id for scene in many}) == 200
    noise = {family.sampling.seed for family in plan(suite(count=100))}
    assert len(noise) == 100, "one seed for all scenes would give all the same noise"


def test_a_scene_is_drawn_alone() -> None:
    made = suite(SPLITS)
    scenes = drawn(made)
    assert made.draws is not None
    for index in (399, 0, 17):
        assert load_again(made).draws.scene(index) == scenes[index]  # type: ignore[union-attr]


def load_again(made: Suite) -> Suite:
    again = Suite.parse(made.model_dump(mode="json"), "its own dump")
    assert again.id == made.id
    return again


def test_another_seed_draws_other_scenes_and_a_further_key_no_other_values() -> None:
    scenes = drawn(suite())
    assert not {s.id for s in scenes} & {s.id for s in drawn(suite(seed=4))}
    light = {"kind": "distant", "incidence_deg": {"uniform": [10, 90]}}
    before = drawn(suite(lights=[light]))
    after = drawn(suite(lights=[light | {"azimuth_deg": {"uniform": [-90, 90]}}]))
    assert [s.light.incidence_deg for s in before] == [s.light.incidence_deg for s in after]
    assert [s.surface for s in before] == [s.surface for s in after]


def test_a_further_range_in_front_redraws_the_first_alone() -> None:
    """`files.md` said that no other key was drawn anew; ids of scenes depend on it, so it stays."""
    light = {"kind": "area", "incidence_deg": {"uniform": [10, 90]}}
    sized = light | {"half_angle_deg": {"uniform": [5, 35]}}
    in_front = {"azimuth_deg": {"uniform": [-90, 90]}} | sized
    before, after = drawn(suite(lights=[sized])), drawn(suite(lights=[in_front]))
    assert [s.light.incidence_deg for s in before] != [s.light.incidence_deg for s in after]
    assert [s.light.half_angle_deg for s in before] == [s.light.half_angle_deg for s in after]
    assert [s.surface for s in before] == [s.surface for s in after]


@pytest.mark.parametrize("splits", [None, SPLITS])
def test_draws_pass_a_kolmogorov_smirnov_test(splits: dict[str, Any] | None) -> None:
    """The test's 5 % bound holds for independent draws; stratified ones lie far inside it.

    With splits a range is cut into 100 bands, whose borders leave 1 % of it out: that moves the
    distribution by 1e-4 at most, which 400 draws cannot see.
    """
    scenes = drawn(suite(splits))
    values = {
        "alpha": np.log([s.surface.alpha for s in scenes]),
        "albedo": np.array([s.surface.albedo for s in scenes]),
        "eta": np.array([s.surface.eta for s in scenes if s.surface.eta]),
        "incidence": np.array([s.light.incidence_deg for s in scenes if s.light.kind == "distant"]),
        "roll": np.array([s.camera.roll_deg for s in scenes]),
        "e1": np.array([s.shape.e1 for s in scenes if s.shape.kind == "superquadric"]),
    }
    ends = {
        "alpha": (math.log(0.02), math.log(0.5)),
        "albedo": (0.1, 0.9),
        "eta": (1.3, 1.8),
        "incidence": (10, 90),
        "roll": (-30, 30),
        "e1": (0.2, 1.8),
    }
    for name, (low, high) in ends.items():
        assert values[name].min() >= low
        assert values[name].max() <= high
        test = stats.kstest(values[name], "uniform", (low, high - low))
        assert test.pvalue > 0.05, (name, test)


def test_every_value_inside_a_choice_is_tried_before_anything_is_rendered() -> None:
    """Of two choices inside a choice of two, one value each was tried: a wrong one came later."""

    def values(template: Any) -> set[Any]:
        if not isinstance(template, dict):
            return {template}
        parts = template.get("choice") or template.get("uniform") or list(template.values())
        return set().union(*map(values, parts))

    inner = [{"a": {"choice": [1, 2]}}, {"a": {"uniform": [3.0, 4.0]}}, {"a": {"choice": [5, 6]}}]
    nested = {"b": {"choice": [*inner, {"choice": [7, {"choice": [8, 9, 10]}]}]}}
    tried = set().union(*map(values, variants(nested)))
    assert tried == values(nested)
    wrong = {"alpha": 0.1, "albedo": {"choice": [0.5, 7]}}
    right = {"alpha": {"uniform": [0.1, 0.2]}, "albedo": {"choice": [0.2, 0.3]}}
    with pytest.raises(InputError, match=r"surfaces\.0.*albedo"):
        suite(surfaces=[{"choice": [wrong, right]}])


def test_items_are_drawn_by_their_weights() -> None:
    scenes = drawn(suite())
    kinds = Counter(scene.light.kind for scene in scenes)
    # Stratified: 400 numbers leave a share of 3/4 by a few at most, independent ones by 9.
    assert abs(kinds["distant"] - 300) <= 4
    assert abs(Counter(s.body for s in (x.surface for x in scenes))["polarised"] - 200) <= 4


def test_numbers_are_stratified_and_nearly_independent() -> None:
    names = [f"key {place}" for place in range(12)]
    table = np.array([[Numbers(5, i)(name) for name in names] for i in range(1024)])
    for column in table.T:
        assert sorted((column * 1024).astype(int)) == list(range(1024))
    correlation = np.corrcoef(table.T) - np.eye(len(names))
    # Of 66 correlations of 1024 independent pairs the largest is below 3.6 / √1024 almost always.
    assert np.abs(correlation).max() < 1.25 * 3.6 / math.sqrt(1024)


def test_chance_correlations_are_as_large_as_is_told() -> None:
    names, count = [f"key {place}" for place in range(40)], 256
    table = np.array([[Numbers(2, i)(name) for name in names] for i in range(count)])
    assert ((table[::2] < 0.5) != (table[1::2] < 0.5)).all()  # neighbours in opposite halves
    pairs = np.corrcoef(table.T)[np.triu_indices(len(names), 1)]
    # The root of the mean square of 780 correlations is known to a part of 1 / √(2 · 780): 3 %.
    assert np.sqrt(count * np.mean(pairs**2)) == pytest.approx(1.25, rel=3 * 0.03)
    # Their mean is 0 within 4 of its standard errors: no two names go together on purpose.
    assert abs(pairs.mean()) < 4 * 1.25 / math.sqrt(count * len(pairs))


def test_clutter_touches_nothing_and_leaves_the_camera_clear() -> None:
    floor = {"shape": {"kind": "plane"}, "position": [0, -1, 0], "scale": 20}
    ball = {"shape": {"kind": "sphere"}, "position": [2, -0.5, 0], "scale": 0.5}
    around = {
        "name": "floor",
        "objects": [floor, ball],
        "clutter": {"count": {"integers": [3, 6]}, "scale": [0.3, 0.8], "within": 3.5},
    }
    camera = {"projection": "perspective", "fov_deg": 60, "distance": {"uniform": [2, 3]}}
    made = suite(surroundings=[around], cameras=[camera], count=60)
    numbers = set()
    for scene in made.scenes():
        balls = [p for p in scene.objects if p.shape.kind != "plane"]
        numbers.add(len(balls) - 2)
        for place_, one in enumerate(balls):
            for other in balls[:place_]:
                apart = math.dist(one.position, other.position)
                assert apart >= one.scale + other.scale - 1e-9
        for thing in balls[2:]:
            pinhole = (0, 0, scene.camera.distance)
            # Half its radius and 0.25 between its bounding sphere and the pinhole.
            gap = math.dist(thing.position, pinhole) - thing.scale
            assert gap >= 0.5 * thing.scale + 0.25 - 1e-9
            assert thing.position[1] == pytest.approx(thing.scale - 1)
    assert numbers == {3, 4, 5, 6}
    crowded = Clutter(count=60, scale=(1.0, 1.0), within=2.5)
    assert len(place(crowded, [], made.camera, Numbers(1, 0))) < 10, "no room for more"
    # No ball of radius 1 is as near as this to one of radius 6.
    large = {"shape": {"kind": "sphere"}, "position": [0, 0, -4], "scale": 6}
    assert not place(crowded, [large], Camera(), Numbers(1, 0))


def test_clutter_is_spread_evenly_over_the_floor() -> None:
    """Of a disc of radius R the mean of r² is R²/2, with a deviation of R²/√12 a position."""
    tiny = Clutter(count=1, scale=(0.01, 0.01), within=40.0)
    placed = [place(tiny, [], Camera(), Numbers(1, scene))[0] for scene in range(400)]
    share = [math.hypot(*one["position"][::2]) ** 2 / 40.0**2 for one in placed]
    # Five deviations of a mean of 400.
    assert np.mean(share) == pytest.approx(0.5, abs=5 / math.sqrt(12 * 400))
    assert {one["position"][1] for one in placed} == {-0.99}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"surfaces": [{"alpha": {"uniform": [0.5, 0.1]}}]}, "the lower first"),
        ({"surfaces": [{"alpha": {"uniform": [0.5, 1.5]}}]}, "less than or equal to 1"),
        ({"surfaces": [{"alpha": {"log_uniform": [0, 1]}}]}, "ends above 0"),
        ({"surfaces": [{"alpha": {"unifrom": [0.1, 1]}}]}, r"first.*key surface\.alpha"),
        ({"surfaces": [{"alpha": {"uniform": [0.1, 1], "step": 2}}]}, "nothing beside it"),
        ({"materials": ["pmma", "watre"]}, r"materials\.1.*watre"),
        ({"materials": [{"eta": {"choice": []}}]}, "a list of values"),
        ({"materials": [{"eta": {"choice": [1.4], "weights": [0]}}]}, "above 0"),
        ({"materials": [{"eta": {"choice": [1.4, 2], "weights": [1e308] * 2}}]}, "below 1e9"),
        ({"lights": [{"kind": "distant", "incidence_deg": {"uniform": [0, 200]}}]}, "180"),
        ({"lights": [{"kind": "uniform", "weight": 0}]}, "weight"),
        ({"shapes": [{"kind": "blob", "seed": {"integers": [0.5, 9]}}]}, "two whole numbers"),
        ({"cameras": [{"roll": {"uniform": [0, 9]}}]}, "did you mean roll_deg"),
        ({"surroundings": [{"name": "a", "objcts": []}]}, "did you mean objects"),
        ({"surroundings": [{"name": "a", "clutter": {"count": -1}}]}, "count"),
        ({"count": 0}, "count"),
    ],
)
def test_a_wrong_range_is_told_in_one_line(change: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        suite(**change)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"splits": {"train": 0.8, "test": 0.1}}, "add up to 1"),
        ({"splits": SPLITS | {"disjoint": ["colour"]}}, "disjoint"),
        ({"shapes": [{"kind": "sphere"}]}, r"shapes: expected no axis beside \[random\]"),
    ],
)
def test_wrong_splits_and_axes_are_told(change: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        Suite.parse(BASE | {"random": AXES} | change, "test")


@pytest.mark.parametrize("thing", [["plane"], "plane", 3])
def test_an_object_that_is_no_table_is_told(thing: object) -> None:
    around = [{"name": "floor", "objects": [thing]}]
    for splits in (None, SPLITS):
        with pytest.raises(InputError, match=r"surroundings\.0.*objects\.0.*table"):
            suite(splits, surroundings=around)


def test_a_large_range_of_integers_ends_its_bands_between_two_of_them() -> None:
    node = distribution({"integers": (0, 250)})
    assert node is not None
    assert len(node.cuts) == 101
    edges = np.array(node.cuts) * 251
    np.testing.assert_allclose(edges, edges.round(), atol=1e-9)  # rounding of the division
    values = [node.value((v + 0.5) / 251) for v in range(251)]
    assert values == list(range(251))
