"""Suites and scenes: what they hold, and what is part of their ids."""

from __future__ import annotations

from pathlib import Path

import pytest
from suite_texts import BRUSHED, GOOD

from malus.bench.running.plan import plan
from malus.scenes import (
    Dielectric,
    Distant,
    InputError,
    Scene,
    Sphere,
    Suite,
    Uniform,
    load_suite,
    suite_names,
)


def test_fig5_is_the_papers_experiment() -> None:
    suite = load_suite("fig5")
    scenes = list(suite.scenes())
    assert len(scenes) == 24 * 5 * 3 * 5
    assert len({scene.id for scene in scenes}) == len(scenes)
    assert len(suite.wavelengths_nm) >= 8
    assert (suite.wavelengths_nm[0], suite.wavelengths_nm[-1]) == (400, 700)
    incidences = {s.light.incidence_deg for s in scenes if isinstance(s.light, Distant)}
    assert incidences == {20, 45, 60, 80}
    assert suite.bodies == ("unpolarised",)


@pytest.mark.parametrize("name", suite_names())
def test_suites_that_malus_brings_are_valid(name: str) -> None:
    suite = load_suite(name)
    assert suite.name == name
    assert suite.description
    assert sum(len(family.scenes) for family in plan(suite)) == len(list(suite.scenes()))


def test_ids_follow_content() -> None:
    one = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3), light=Uniform())
    same = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.3), light=Uniform())
    other = Scene(shape=Sphere(), surface=Dielectric(eta=1.5, alpha=0.31), light=Uniform())
    assert one.id == same.id != other.id
    assert Scene.model_validate_json(one.model_dump_json()) == one


def test_numbers_are_numbers_and_whole_ones_serve_as_floats(suite_file: Path) -> None:
    text = GOOD.replace('"carbon"', "{ alpha = 1, albedo = 0 }")
    suite_file.write_text(text, "utf-8")
    assert isinstance(load_suite(suite_file).wavelengths_nm[0], float)


def test_the_good_suite_is_good(suite_file: Path) -> None:
    suite_file.write_text(GOOD, "utf-8")
    assert load_suite(suite_file).name == "mine"


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ('kind = "sphere"', 'kind = "mesh", path = "a.obj"', "a.obj"),
        ('kind = "uniform"', 'kind = "environment", name = "a.exr"', "a.exr"),
    ],
)
def test_files_are_known_by_content(
    suite_file: Path, tmp_path: Path, old: str, new: str, name: str
) -> None:
    suite_file.write_text(GOOD.replace(old, new), "utf-8")
    with pytest.raises(InputError, match=name):
        load_suite(suite_file)
    ids = []
    for content in ("v 0 0 0\n", "v 0 0 1\n"):
        (tmp_path / name).write_text(content, "utf-8")
        ids.append(next(load_suite(suite_file).scenes()).id)
    assert ids[0] != ids[1]


def test_beckmanns_facets_are_the_default_and_no_part_of_ids() -> None:
    plain, named = (
        Dielectric(eta=1.5, alpha=0.3, **more) for more in ({}, {"distribution": "beckmann"})
    )
    assert plain.id == named.id
    assert "distribution" not in plain.model_dump()
    ggx = Dielectric(eta=1.5, alpha=0.3, distribution="ggx")
    assert ggx.id != plain.id
    assert (plain.label, ggx.label) == ("alpha 0.3", "ggx alpha 0.3")
    assert Dielectric.model_validate(ggx.model_dump()) == ggx


def test_metals_may_have_two_roughnesses(suite_file: Path) -> None:
    suite_file.write_text(BRUSHED, "utf-8")
    (scene,) = load_suite(suite_file).scenes()
    assert scene.surface.alphas == (0.1, 0.4)
    assert scene.surface.label == "alpha 0.1 x 0.4"
    assert scene.surface.isotropic_alpha == pytest.approx(0.2)  # √(0.1 · 0.4)
    assert Scene.parse(scene.model_dump(mode="json"), "here") == scene


def test_the_usual_depth_is_no_part_of_ids_where_it_means_the_same(suite_file: Path) -> None:
    """Among objects 5 is what is meant without it; for one object it is not."""
    around = """
    [[surroundings]]
    name = "desk"
    objects = [{ shape = { kind = "plane" }, surface = { eta = 1.5, alpha = 0.3 } }]
    """

    def suite(depth: int | None, more: str = "") -> Suite:
        sampling = "" if depth is None else f"sampling = {{ max_depth = {depth} }}"
        suite_file.write_text(GOOD.replace("# more", sampling + more), "utf-8")
        return load_suite(suite_file)

    assert suite(5, around).id == suite(None, around).id
    assert suite(4, around).id != suite(None, around).id
    assert suite(5).id != suite(None).id
    assert [family.id for family in plan(suite(5, around))] == [
        family.id for family in plan(suite(None, around))
    ]
