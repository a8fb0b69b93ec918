"""Suites and scenes: what they hold, and what a mistake in them says."""

from __future__ import annotations

from pathlib import Path

import pytest

from malus.bench.running.plan import plan
from malus.renderers import render
from malus.scenes import (
    Dielectric,
    Distant,
    InputError,
    Scene,
    Sphere,
    Uniform,
    load_suite,
    suite_names,
)

GOOD = """
name = "mine"
shapes = [{ kind = "sphere" }]
materials = ["water"]
surfaces = ["carbon"]
lights = [{ kind = "uniform" }]
wavelengths_nm = [500, 600]
methods = ["eq8"]
"""


@pytest.fixture
def suite_file(tmp_path: Path) -> Path:
    return tmp_path / "mine.toml"


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


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('"water"', '"watre"', "watre"),
        ('"carbon"', '"coal"', "coal"),
        ("[500, 600]", "[600, 500]", "wavelengths in increasing order"),
        ("[500, 600]", "[]", "wavelengths_nm"),
        ("[500, 600]", "[nan]", "nan"),
        ('materials = ["water"]', "materials = [{ eta = 0 }]", "greater than 1"),
        ('materials = ["water"]', "materials = [{ eta = -1.5 }]", "-1.5"),
        ('surfaces = ["carbon"]', "surfaces = [{ alpha = 0 }]", "greater than 0"),
        ('surfaces = ["carbon"]', "surfaces = [{ alpha = -0.1 }]", "-0.1"),
        ('kind = "sphere"', 'kind = "cube"', "cube"),
        ('kind = "sphere"', 'kind = "torus", minor = 0.8', "minor radius below"),
        ('kind = "uniform"', 'kind = "distant"', "incidence_deg"),
        ('name = "mine"', 'name = "mine"\ntypo = 1', "typo"),
        ("methods = [", "methods = [[", "TOML"),
        ('"eq8"', '"os:system"', "command line"),
        ('name = "mine"', "", "name"),
    ],
)
def test_a_mistake_is_one_line_that_names_file_and_key(
    suite_file: Path, old: str, new: str, expected: str
) -> None:
    assert old in GOOD
    suite_file.write_text(GOOD.replace(old, new), "utf-8")
    with pytest.raises(InputError) as mistake:
        load_suite(suite_file)
    message = str(mistake.value)
    assert expected in message
    assert str(suite_file) in message
    assert "expected" in message
    assert "found" in message
    assert "\n" not in message


PATTERN = '{ pattern = { kind = "checker" }, parts = ["rust", "carbon"] }'
PAINT = '{ shape = { kind = "plane" }, surface = { eta = 1.5, alpha = 0.1 } }'
ROOM = f'surroundings = [{{ name = "room", objects = [{PAINT}] }}]'


@pytest.mark.parametrize(
    ("finish", "more", "says"),
    [
        ('{ alpha = 0.3, albedo = "redd" }', "", "did you mean red?"),
        ("{ alpha = 0.3, albedo = [0.1, 0.2, 0.3] }", "", "one number a band, 2, found 3"),
        ('"rustt"', "", "toml, surface: expected the name of a surface, found 'rustt'"),
        (PATTERN, ROOM, "only in scenes without surroundings"),
        ('"rust"', ROOM.replace("{ eta = 1.5, alpha = 0.1 }", '"rust"'), "surface: expected"),
        (PATTERN, 'renderer = "torrance-sparrow"', "the same surface all over, found a pattern"),
        ('"rust"', f'{ROOM}\nrenderer = "torrance-sparrow"', "one object, found surroundings"),
    ],
)
def test_surfaces_that_do_not_fit_are_one_line(
    suite_file: Path, finish: str, more: str, says: str
) -> None:
    text = GOOD.replace('"carbon"', finish).replace('"uniform"', '"distant", incidence_deg = 60')
    suite_file.write_text(f"{text}camera = {{ resolution = 4 }}\n{more}\n", "utf-8")

    def used() -> None:
        suite = load_suite(suite_file)
        for scene in suite.scenes():
            render(scene, renderer=suite.renderer)

    with pytest.raises(InputError) as error:
        used()
    assert says in str(error.value)
    assert "\n" not in str(error.value)


def test_the_good_suite_is_good(suite_file: Path) -> None:
    suite_file.write_text(GOOD, "utf-8")
    assert load_suite(suite_file).name == "mine"


@pytest.mark.parametrize("content", [b"\xff\xfe", b"x" * (1 << 21)])
def test_files_that_are_no_suites(suite_file: Path, content: bytes) -> None:
    suite_file.write_bytes(content)
    with pytest.raises(InputError):
        load_suite(suite_file)


def test_unknown_suites_and_missing_meshes(suite_file: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fig5"):
        load_suite("fig6")
    with pytest.raises(InputError, match="No such file"):
        load_suite(tmp_path / "nothing.toml")
    suite_file.write_text(GOOD.replace('kind = "sphere"', 'kind = "mesh", path = "no.obj"'))
    with pytest.raises(InputError, match=r"no\.obj"):
        load_suite(suite_file)


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
