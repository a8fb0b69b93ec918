"""A file that a scene names is known by what it holds: not by when, or from where, it was read."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path

import numpy as np
import pytest
from made_up import made_up_truth

from malus.bench.datasets.planned import planned_dataset
from malus.bench.running.plan import plan
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.datasets.spectral_exr import write_exr
from malus.renderers.mitsuba.translate import tessellated
from malus.renderers.variant import Variant
from malus.scenes import Dielectric, InputError, Scene, Uniform
from malus.scenes.camera import Camera
from malus.scenes.core.model import content_id
from malus.scenes.lights.environment import radiance_map
from malus.scenes.lights.lights import Environment
from malus.scenes.materials.measured import Measured
from malus.scenes.random_suite.random_scenes import RandomScenes
from malus.scenes.shapes.resting import lowest
from malus.scenes.shapes.shapes import MeshFile
from malus.scenes.suite import load_suite

PAINT = Dielectric(eta=1.5, alpha=0.3)
SCALAR = Variant("scalar_spectral_polarized", "asked for")
AXES = """
shapes = [{ kind = "mesh", path = "m/a.obj" }]
materials = ["pmma"]
surfaces = [{ alpha = 0.3 }]
lights = [{ kind = "environment", name = "m/a.exr" }]
"""
HEAD = 'name = "files"\nwavelengths_nm = [550]\nmethods = ["unpolarised"]\n'
DRAWN = AXES.replace("0.3", "{ uniform = [0.1, 0.4] }")
SUITES = {
    "axes": HEAD + AXES,
    "random": HEAD + "[random]\ncount = 2\n" + DRAWN,
    "folder": HEAD + "[random]\ncount = 2\n" + DRAWN.replace('"m/a.obj"', '{ folder = "m" }'),
}


def write_mesh(path: Path, height: float) -> Path:
    """A triangle of a height over its base of 1: centred, its lowest point depends on it."""
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_text(f"v 0 0 0\nv 1 0 0\nv 0 {height} 0\nf 1 2 3\n", "utf-8")
    return path


def write_map(path: Path, radiance: float) -> Path:
    path.parent.mkdir(exist_ok=True, parents=True)
    write_exr(path, dict.fromkeys("RGB", np.full((4, 8), radiance, np.float32)))
    return path


def mesh_scene(path: Path | str) -> Scene:
    shape, bands = MeshFile(path=str(path), shading="flat"), made_up_truth().scene.wavelengths_nm
    return Scene(shape=shape, surface=PAINT, light=Uniform(), wavelengths_nm=bands)


def test_an_edited_mesh_is_another_mesh(tmp_path: Path) -> None:
    before = mesh_scene(write_mesh(tmp_path / "a.obj", 1))
    first, low = tessellated(before.shape).vertices, lowest(before.shape)
    after = mesh_scene(write_mesh(tmp_path / "a.obj", 4))
    assert after.id != before.id
    assert after != before
    assert not np.allclose(tessellated(after.shape).vertices, first)
    assert lowest(after.shape) != low


def test_an_edited_radiance_map_is_another_light(tmp_path: Path) -> None:
    before = Environment(name=str(write_map(tmp_path / "a.exr", 1)))
    assert radiance_map(before).max() == 1
    after = Environment(name=str(write_map(tmp_path / "a.exr", 3)))
    assert radiance_map(after).max() == 3
    assert after.id != before.id


def test_files_of_one_name_are_two_scenes_of_a_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And it keeps a copy of each, though no digest was given."""
    scenes = []
    with DatasetWriter(tmp_path / "data") as writer:
        for name, height in (("one", 1), ("two", 4)):
            monkeypatch.chdir(write_mesh(tmp_path / name / "a.obj", height).parent)
            scenes.append(mesh_scene("a.obj"))
            writer.add(dataclasses.replace(made_up_truth(), scene=scenes[-1]))
    dataset = open_folder(tmp_path / "data")
    assert len(dataset.scenes) == 2
    assert len(list((tmp_path / "data" / "meshes").iterdir())) == 2
    for scene in scenes:
        assert dataset.truth(scene.id).scene == scene
        # Read from the folder in which it was made, wherever one is now.
        np.testing.assert_array_equal(
            tessellated(scene.shape).vertices,
            tessellated(dataset.truth(scene.id).scene.shape).vertices,
        )


def test_a_scene_keeps_the_file_that_it_was_made_of(tmp_path: Path) -> None:
    shape = mesh_scene(write_mesh(tmp_path / "a.obj", 3)).shape
    write_mesh(tmp_path / "a.obj", 4)
    with pytest.raises(InputError, match="a mesh file with digest"):
        tessellated(shape)


def test_a_file_that_comes_later_is_no_part_of_a_scene(tmp_path: Path) -> None:
    """Nothing tells whether it is still the same one: what is kept of it would be stale."""
    shape = MeshFile(path=str(tmp_path / "a.obj"), shading="flat")
    with pytest.raises(InputError, match="expected a readable mesh file"):
        tessellated(shape)
    write_mesh(tmp_path / "a.obj", 1)
    with pytest.raises(InputError, match="make the scene again"):
        tessellated(shape)
    assert len(tessellated(mesh_scene(tmp_path / "a.obj").shape).faces) == 1


@pytest.mark.parametrize("kind", sorted(SUITES))
def test_a_scene_does_not_depend_on_how_its_path_is_spelt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """Neither its id, nor the seed of its noise, nor the hash that tells a dataset's renders."""
    write_mesh(tmp_path / "here" / "m" / "a.obj", 1)
    write_map(tmp_path / "here" / "m" / "a.exr", 1)
    file = tmp_path / "here" / "a.toml"
    file.write_text(SUITES[kind], "utf-8")
    suites = []
    for folder, spelt in ((tmp_path, "here/a.toml"), (file.parent, "a.toml"), (tmp_path, file)):
        monkeypatch.chdir(folder)
        suites.append(load_suite(spelt))
    assert len({suite.id for suite in suites}) == 1
    assert len({tuple(scene.id for scene in suite.scenes()) for suite in suites}) == 1
    assert len({tuple(suite.scenes()) for suite in suites}) == 1
    seeds = {tuple(family.sampling.seed for family in plan(suite)) for suite in suites}
    assert len(seeds) == 1
    assert len({planned_dataset(suite, SCALAR).part.renders for suite in suites}) == 1
    tessellated.cache_clear()  # else what another test has read would do
    for suite in (suites[0], suites[2]):  # the second one's paths count from a folder left since
        for scene in suite.scenes():
            assert len(tessellated(scene.shape).faces) == 1


@pytest.mark.parametrize("folders", [("p", "q"), ("q", "p")])
def test_no_folder_decides_the_order_of_families(tmp_path: Path, folders: tuple[str, str]) -> None:
    """Part `i` of `n` has every n-th of them."""
    materials = []
    for name, folder in zip("ab", folders, strict=True):
        (tmp_path / folder).mkdir()
        path = tmp_path / folder / f"{name}.pbsdf"
        path.write_text(name, "utf-8")
        materials.append(Measured(path=str(path)))
    suite = load_suite("quick").model_copy(update={"materials": tuple(reversed(materials))})
    names = [family.scenes[0].surface.material_label for family in plan(suite)]
    assert names == sorted(names)
    assert set(names) == {"a", "b"}


def test_values_of_python_and_stored_ones_are_equal(tmp_path: Path) -> None:
    """JSON, pickles and other folders make no other scene."""
    write_mesh(tmp_path / "a.obj", 1)
    write_mesh(tmp_path / "sub" / "a.obj", 1)
    scene, other = mesh_scene(tmp_path / "a.obj"), mesh_scene(tmp_path / "sub" / "a.obj")
    again = Scene.model_validate_json(scene.model_dump_json())
    parsed = Scene.parse(scene.model_dump(mode="json"), "test")
    for same in (other, again, parsed, pickle.loads(pickle.dumps(scene))):
        assert same == scene
        assert hash(same) == hash(scene)
        assert same.id == scene.id
        assert len(tessellated(same.shape).faces) == 1


def test_a_scene_that_was_stored_with_its_path_keeps_its_id() -> None:
    """Datasets of malus before 2026-11 have ids with the path as it was spelt, and are read."""
    content = mesh_scene("nowhere.obj").model_dump(mode="json")
    content["shape"] |= {"path": "some/folder/a.obj", "digest": "0123456789abcdef"}
    assert Scene.parse(content, "scene.json").id == content_id(content)


def test_parsed_data_open_no_file(tmp_path: Path) -> None:
    """A dataset from elsewhere may name any file of this machine."""
    path = write_mesh(tmp_path / "a.obj", 1)
    content = mesh_scene("nowhere.obj").model_dump(mode="json")
    content["shape"] |= {"path": str(path), "digest": ""}
    foreign = Scene.parse(content, "scene.json")
    assert isinstance(foreign.shape, MeshFile)
    assert len(foreign.objects) == 1  # a part of a model that is made here is still a foreign one
    assert foreign.shape.digest == ""
    assert foreign.shape.path == str(path)


def test_random_scenes_of_python_have_digests(tmp_path: Path) -> None:
    """Those of a suite's file find theirs from its folder, which only reading it tells."""
    path = write_mesh(tmp_path / "m" / "a.obj", 1)
    axes = {"materials": ("pmma",), "surfaces": ({"alpha": 0.3},), "lights": ({"kind": "uniform"},)}
    for named in (str(path), {"folder": str(path.parent)}):
        random = RandomScenes(count=1, shapes=({"kind": "mesh", "path": named},), **axes)
        drawn = random.draws(Camera(), (550.0,)).scene(0)
        assert isinstance(drawn.shape, MeshFile)
        assert len(drawn.shape.digest) == 16
        assert drawn.shape == MeshFile(path=str(path))
