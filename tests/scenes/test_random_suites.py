"""Random scenes follow their ranges, each from its number alone, and splits share nothing."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import stats

from malus.bench.running.plan import plan
from malus.scenes import (
    Checker,
    Dielectric,
    InputError,
    Patterned,
    Sphere,
    Suite,
    Uniform,
    load_suite,
)
from malus.scenes.core.model import content_id
from malus.scenes.random_suite.clutter import Clutter, place
from malus.scenes.random_suite.sequence import Numbers
from malus.scenes.random_suite.splits import (
    Splits,
    check_leaks,
    portions,
    separate,
    values_of,
)
from malus.scenes.random_suite.templates import distribution, distributions
from malus.scenes.scene import Scene

BASE: dict[str, Any] = {
    "name": "drawn",
    "wavelengths_nm": [550],
    "methods": ["unpolarised"],
    "camera": {"resolution": 8},
}
AXES: dict[str, Any] = {
    "count": 400,
    "seed": 3,
    "shapes": [
        {"kind": "blob", "seed": {"integers": [0, 99]}},
        {"kind": "superquadric", "e1": {"uniform": [0.2, 1.8]}, "e2": 1},
        {"kind": "sphere"},
    ],
    "materials": ["pmma", "water", "polystyrene", {"eta": {"uniform": [1.3, 1.8]}, "weight": 2}],
    "surfaces": [{"alpha": {"log_uniform": [0.02, 0.5]}, "albedo": {"uniform": [0.1, 0.9]}}],
    "bodies": ["polarised", "unpolarised"],
    "lights": [
        {"kind": "distant", "incidence_deg": {"uniform": [10, 90]}, "weight": 3},
        {"kind": "uniform"},
    ],
    "cameras": [{"roll_deg": {"uniform": [-30, 30]}}],
}
SPLITS = {"train": 0.8, "val": 0.1, "test": 0.1, "disjoint": ["shape", "material", "light"]}


def suite(splits: dict[str, Any] | None = None, **axes: Any) -> Suite:
    parts = {"random": AXES | axes} | ({"splits": splits} if splits else {})
    return Suite.parse(BASE | parts, "test")


def drawn(of: Suite) -> list[Scene]:
    return list(of.scenes())


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


def test_items_are_drawn_by_their_weights() -> None:
    scenes = drawn(suite())
    kinds = Counter(scene.light.kind for scene in scenes)
    # Stratified: 400 numbers leave a share of 3/4 by a few at most, independent ones by 9.
    assert abs(kinds["distant"] - 300) <= 4
    assert abs(Counter(s.body for s in (x.surface for x in scenes))["polarised"] - 200) <= 4


def test_numbers_are_stratified_and_as_good_as_independent() -> None:
    names = [f"key {place}" for place in range(12)]
    table = np.array([[Numbers(5, i)(name) for name in names] for i in range(1024)])
    for column in table.T:
        assert sorted((column * 1024).astype(int)) == list(range(1024))
    correlation = np.corrcoef(table.T) - np.eye(len(names))
    # Of 66 correlations of 1024 independent pairs the largest is below 4.5 / √1024 almost always.
    assert np.abs(correlation).max() < 4.5 / math.sqrt(1024)


@pytest.mark.parametrize("seed", range(4))
def test_no_value_is_in_two_splits(seed: int) -> None:
    made = suite(SPLITS, seed=seed)
    found: dict[str, dict[str, set[str]]] = {}
    counts: Counter[str | None] = Counter()
    assert made.draws is not None
    for index, scene in enumerate(made.scenes()):
        split = made.draws.split(index)
        counts[split] += 1
        # Written out here, not by `values_of`: what the scene's own record says.
        content = scene.model_dump(mode="json")
        surface = content["surface"]
        values = {
            "shape": content_id(content["shape"]),
            "material": f"{surface['material']} {surface['eta']}",
            "light": content_id(content["light"]),
        }
        for axis, value in values.items():
            found.setdefault(axis, {}).setdefault(str(split), set()).add(value)
    assert abs(counts["train"] - 320) <= 4  # stratified
    for axis, by_split in found.items():
        assert set(by_split) == {"train", "val", "test"}, axis
        total = sum(map(len, by_split.values()))
        assert len(set.union(*by_split.values())) == total, axis


def test_ranges_of_a_disjoint_axis_are_cut_into_bands() -> None:
    """A test index is not a training index plus a rounding error."""
    made = suite(SPLITS, materials=[{"eta": {"uniform": [1.3, 1.8]}}], count=1000)
    assert made.draws is not None
    by_split: dict[str, list[float]] = {}
    for index, scene in enumerate(made.scenes()):
        by_split.setdefault(str(made.draws.split(index)), []).append(scene.surface.eta)
    bands = {s: {int((eta - 1.3) / 0.005) for eta in values} for s, values in by_split.items()}
    assert not bands["train"] & bands["test"]
    assert not bands["val"] & (bands["train"] | bands["test"])
    nearest = min(abs(a - b) for a in by_split["train"] for b in by_split["test"])
    assert nearest >= 0.99 * 2 * 0.005 * 0.005  # two borders of 0.5 % of a band of 0.005
    assert len(bands["test"]) == 10


def shares(made: Suite, axis: str) -> dict[str, dict[int, float]]:
    """Share of the draws that every item of an axis has in every split."""
    assert made.draws is not None
    assert made.splits is not None
    assert made.random is not None
    cut = portions(made.random.items(axis), cut=True)
    parts = separate(cut, made.splits, axis, Numbers(made.random.seed, 0).plain)
    found: dict[str, dict[int, float]] = {}
    for split, own in parts.items():
        total = math.fsum(part.weight for part in own)
        found[split] = {
            item: math.fsum(part.weight for part in own if part.item == item) / total
            for item in {part.item for part in own}
        }
    return found


@pytest.mark.parametrize("seed", range(3))
def test_each_split_of_a_disjoint_axis_is_drawn_like_the_others(seed: int) -> None:
    """A choice of two beside ranges does not keep a kind of light out of a split."""
    elevation = {"sun_elevation_deg": {"uniform": [5, 75]}}
    lights = [
        {"kind": "distant", "incidence_deg": {"uniform": [10, 90]}, "weight": 3},
        {"kind": "sky", **elevation, "sun": {"choice": [True, False]}},
    ]
    made = suite(SPLITS, seed=seed, lights=lights)
    for found in shares(made, "light").values():
        # 100 bands an item: a split of a tenth has ten of each, or one more or less.
        assert found[0] == pytest.approx(0.75, abs=0.05)
        assert found[1] == pytest.approx(0.25, abs=0.05)


@pytest.mark.parametrize("name", ["photos", "random"])
def test_the_product_suites_have_every_range_in_every_split(name: str) -> None:
    made = load_suite(name)
    assert made.random is not None
    assert made.splits is not None
    for axis in made.splits.disjoint:
        ranged = {
            item
            for item, (template, _) in enumerate(made.random.items(axis))
            if any(node.is_range or node.integers for _, node in distributions(template))
        }
        assert ranged
        for split, found in shares(made, axis).items():
            assert ranged <= set(found), (axis, split)


def test_single_values_beside_ranges_are_trained_on_and_alone_are_shared_out() -> None:
    whole = ["pmma", "water", "polystyrene", "polycarbonate", "gold"]
    ranged = {"eta": {"uniform": [1.3, 1.8]}, "weight": 5}
    found = shares(suite(SPLITS, materials=[ranged, *whole]), "material")
    assert found["val"] == found["test"] == {0: 1.0}
    assert set(found["train"]) == set(range(6))
    alone = shares(suite(SPLITS, materials=whole), "material")
    assert [len(alone[name]) for name in ("train", "val", "test")] == [3, 1, 1]


def test_a_planted_leak_is_an_error() -> None:
    made = suite(SPLITS)
    assert made.splits is not None
    assert made.draws is not None
    scenes = [(s, s.id, made.draws.split(i)) for i, s in enumerate(made.scenes())]
    check_leaks(scenes, made.splits)  # type: ignore[arg-type]
    train = next(scene for scene, _, split in scenes if split == "train")
    leak = train.model_copy(update={"surface": drawn(suite(seed=9))[0].surface})
    with pytest.raises(InputError, match=r"every (shape|light) in one split"):
        check_leaks([*scenes, (leak, leak.id, "test")], made.splits)  # type: ignore[arg-type]


def test_values_are_listed_in_one_order() -> None:
    """That of a set differs from process to process, and `splits.json` with it."""
    surfaces = tuple(Dielectric(eta=1.3 + 0.01 * k, alpha=0.3) for k in range(8))
    ball = Patterned(surfaces=surfaces, pattern=Checker(size=0.5))
    scene = Scene(shape=Sphere(), surface=ball, light=Uniform())
    splits = Splits(train=0.5, test=0.5, disjoint=("material",))
    found = check_leaks([(scene, scene.id, "train")], splits)["material"]
    assert list(found) == sorted(values_of(scene, "material"))


def test_a_fixed_material_of_a_room_is_a_leak_that_is_told() -> None:
    floor = {
        "shape": {"kind": "plane"},
        "surface": {"material": "pmma", "alpha": 0.1},
        "position": [0, -1, 0],
    }
    made = suite(SPLITS, surroundings=[{"name": "room", "objects": [floor]}])
    assert made.splits is not None
    assert made.draws is not None
    scenes = [(s, s.id, made.draws.split(i)) for i, s in enumerate(made.scenes())]
    with pytest.raises(InputError, match="pmma in"):
        check_leaks(scenes, made.splits)  # type: ignore[arg-type]


def test_files_of_folders_are_drawn_and_kept_apart(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "leaves").mkdir()
    for number in range(6):
        text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
        (tmp_path / "meshes" / f"{number}.obj").write_text(f"# {number}\n{text}", "utf-8")
        Image.fromarray(np.full((2, 2), 40 * number, np.uint8)).save(
            tmp_path / "leaves" / f"{number}.png"
        )
    (tmp_path / "meshes" / "notes.txt").write_text("no mesh", "utf-8")
    (tmp_path / "s.toml").write_text(
        """
name = "folders"
wavelengths_nm = [550]
methods = ["unpolarised"]
[random]
count = 60
materials = ["pmma"]
lights = [{ kind = "uniform" }]
[[random.shapes]]
kind = "mesh"
path = { folder = "meshes" }
shading = { choice = ["flat", "smooth"] }
[[random.surfaces]]
pattern = { kind = "image", path = { folder = "leaves" } }
parts = [{ alpha = 0.1 }, { alpha = { uniform = [0.2, 0.4] } }]
[splits]
train = 0.5
test = 0.5
disjoint = ["shape"]
""",
        "utf-8",
    )
    made = load_suite(tmp_path / "s.toml")
    assert made.draws is not None
    meshes: dict[str, set[str]] = {"train": set(), "test": set()}
    for index, scene in enumerate(made.scenes()):
        meshes[str(made.draws.split(index))].add(scene.shape.digest)
        assert Path(scene.surface.pattern.path).is_file()
    assert len(meshes["train"]) == len(meshes["test"]) == 3
    assert not meshes["train"] & meshes["test"]
    (tmp_path / "meshes" / "0.obj").write_text("# other\n" + text, "utf-8")
    assert load_suite(tmp_path / "s.toml").id != made.id, "the id follows the files' content"


def test_radiance_maps_of_a_folder_are_one_light_however_they_are_turned(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    for number in range(4):
        (tmp_path / "maps" / f"{number}.hdr").write_bytes(bytes([number]))  # drawn, not read
    lights = [
        {
            "kind": "environment",
            "turn_deg": {"uniform": [0, 360]},
            "name": {"folder": "maps"},
            "weight": 3,
        },
        {"kind": "environment", "name": "studio", "turn_deg": {"choice": [0, 90]}},
    ]
    halves = {"train": 0.5, "test": 0.5, "disjoint": ["light"]}
    made = suite(halves, lights=lights, count=60)
    assert made.random is not None
    made = made.model_copy(update={"random": made.random.with_files(tmp_path)})
    assert made.draws is not None
    by_split: dict[str, set[str]] = {"train": set(), "test": set()}
    for index, scene in enumerate(made.scenes()):
        by_split[str(made.draws.split(index))].add(scene.light.digest or scene.light.name)
    assert not by_split["train"] & by_split["test"]
    assert len(by_split["train"] | by_split["test"]) == 5
    (tmp_path / "empty").mkdir()
    lights[0]["name"] = {"folder": "empty"}
    empty = suite(lights=lights).random
    assert empty is not None
    with pytest.raises(InputError, match="files for kind environment"):
        empty.with_files(tmp_path)


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
            assert math.dist(thing.position, pinhole) > thing.scale
            assert thing.position[1] == pytest.approx(thing.scale - 1)
    assert numbers == {3, 4, 5, 6}
    crowded = Clutter(count=60, scale=(1.0, 1.0), within=2.5)
    assert len(place(crowded, [], made.camera, Numbers(1, 0))) < 10, "no room for more"


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


def test_splits_without_random_scenes_and_too_few_values_are_refused() -> None:
    axes = {
        "shapes": [{"kind": "sphere"}],
        "materials": ["pmma"],
        "surfaces": ["carbon"],
        "lights": [{"kind": "uniform"}],
    }
    with pytest.raises(InputError, match="splits of random scenes only"):
        Suite.parse(BASE | axes | {"splits": SPLITS}, "test")
    with pytest.raises(InputError, match=r"light: expected at least 3 values, found 1"):
        drawn(suite(SPLITS, lights=[{"kind": "uniform"}]))


def test_a_large_range_of_integers_ends_its_bands_between_two_of_them() -> None:
    node = distribution({"integers": (0, 250)})
    assert node is not None
    assert len(node.cuts) == 101
    edges = np.array(node.cuts) * 251
    np.testing.assert_allclose(edges, edges.round(), atol=1e-9)  # rounding of the division
    values = [node.value((v + 0.5) / 251) for v in range(251)]
    assert values == list(range(251))


def test_values_of_a_scene_are_those_of_all_its_objects() -> None:
    around = {
        "name": "floor",
        "objects": [{"shape": {"kind": "plane"}, "position": [0, -1, 0]}],
        "clutter": {"count": 2},
    }
    scene = drawn(suite(surroundings=[around], count=1))[0]
    assert len(scene.objects) == 4
    assert values_of(scene, "material") == {p.surface.material_label for p in scene.objects}
    assert len(values_of(scene, "shape")) <= 3  # a plane is no shape
