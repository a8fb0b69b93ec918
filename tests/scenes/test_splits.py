"""Splits share nothing of their disjoint axes, and each is drawn like the others."""

from __future__ import annotations

import math
from collections import Counter
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from random_suites import BASE, SPLITS, drawn, suite

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
from malus.scenes.random_suite.sequence import Numbers
from malus.scenes.random_suite.splits import (
    Splits,
    check_leaks,
    portions,
    separate,
    values_of,
)
from malus.scenes.random_suite.templates import distributions
from malus.scenes.scene import Scene


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


def test_single_values_go_to_the_largest_split_whatever_its_name() -> None:
    mostly_test = {"train": 0.1, "val": 0.1, "test": 0.8, "disjoint": ["material"]}
    materials = [{"eta": {"uniform": [1.3, 1.8]}, "weight": 2}, "pmma", "water"]
    found = shares(suite(mostly_test, materials=materials), "material")
    assert found["train"] == found["val"] == {0: 1.0}
    assert set(found["test"]) == {0, 1, 2}


def test_another_seed_shares_the_values_out_otherwise() -> None:
    """Not the lowest indices first: a split of neighbours would be tested beyond its range."""
    bands: list[set[float]] = []
    for seed in range(4):
        made = suite(SPLITS, seed=seed, materials=[INDEX])
        assert made.splits is not None
        assert made.random is not None
        cut = portions(made.random.items("material"), cut=True)
        parts = separate(cut, made.splits, "material", Numbers(seed, 0).plain)
        bands.append({part.low for part in parts["test"]})
        assert len(bands[-1]) == 10  # of 100
    # Of ten drawn from a hundred a second draw shares one on average, and nine once in 1e10.
    assert all(len(one & other) < 9 for one, other in combinations(bands, 2))


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


FLOOR = {"shape": {"kind": "plane"}, "position": [0, -1, 0]}
BALL = {"shape": {"kind": "sphere"}, "position": [2, 0, 0]}
INDEX = {"eta": {"uniform": [1.3, 1.7]}}
PMMA = FLOOR | {"surface": {"material": "pmma", "alpha": 0.1}}
OWN = {"surface": INDEX | {"alpha": 0.2}}
PARTS = [{"surface": {"alpha": 0.2}, "material": INDEX}, {"alpha": 0.3}]


def around(*objects: dict[str, Any]) -> dict[str, Any]:
    return {"surroundings": [{"name": "a", "objects": list(objects)}]}


ITS_OWN: dict[str, tuple[dict[str, Any], str, str]] = {
    "a floor's material": (around(PMMA), "material", "surroundings.0.objects.0.surface"),
    "a range of it": (around(FLOOR, BALL | OWN), "material", "surroundings.0.objects.1.surface"),
    "a roughness": (around(FLOOR | OWN), "surface", "surroundings.0.objects.0.surface"),
    "a shape": (around(FLOOR, BALL), "shape", "surroundings.0.objects.1.shape"),
    "a part's index": (
        {"surfaces": [{"pattern": {"kind": "checker"}, "parts": PARTS}]},
        "material",
        "surfaces.0.parts.0",
    ),
    "ranges that overlap": (
        {"materials": [{"eta": {"uniform": [1.3, 1.5]}}, {"eta": {"uniform": [1.4, 1.9]}}]},
        "material",
        "materials.1.eta",
    ),
}
"""Changes of a suite whose splits would share a value, the axis, and the key that is told."""


@pytest.mark.parametrize("name", ITS_OWN)
def test_what_no_axis_hands_out_is_told_when_the_suite_is_read(name: str) -> None:
    """Before a scene is drawn: whether two of a range are equal would depend on chance."""
    change, axis, key = ITS_OWN[name]
    halves = {"train": 0.5, "test": 0.5, "disjoint": [axis]}
    with pytest.raises(InputError, match=rf"key random\.{key}: expected every {axis} in one split"):
        suite(halves, **change)
    suite({"train": 1.0, "disjoint": [axis]}, **change)  # nothing is shared
    suite({"train": 0.5, "test": 0.5, "disjoint": ["light"]}, **change)


def test_objects_that_draw_and_ranges_apart_are_no_leak() -> None:
    suite(SPLITS, surroundings=[{"name": "room", "objects": [FLOOR]}])
    apart = [{"eta": {"uniform": [1.3, 1.5]}}, {"eta": {"uniform": [1.5, 1.9]}}, "pmma"]
    metals = [{"eta": {"uniform": [0.5, 3]}, "k": {"uniform": [2, 5]}}]
    suite(SPLITS, materials=[*apart, *metals])


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
        assert scene.surface.pattern.file.is_file()
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


def test_surfaces_that_differ_in_their_distribution_are_two_values() -> None:
    surfaces = [
        {"alpha": 0.3},
        {"alpha": 0.3, "distribution": "ggx"},
        {"alpha": 0.3, "albedo": 0.2},
    ]
    made = suite(SPLITS | {"disjoint": ["surface"]}, surfaces=surfaces, materials=["pmma"])
    assert made.splits is not None
    assert made.draws is not None
    scenes = [(s, s.id, made.draws.split(i)) for i, s in enumerate(made.scenes())]
    found = check_leaks(scenes, made.splits)["surface"]  # type: ignore[arg-type]
    assert set(found) == {"0.3 0.5", "ggx 0.3 0.5", "0.3 0.2"}
    assert set(found.values()) == {"train", "val", "test"}
    metal = drawn(suite(surfaces=surfaces[1:2], materials=["gold"], count=1))[0]
    assert values_of(metal, "surface") == {"ggx 0.3"}


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
