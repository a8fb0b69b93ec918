"""Files that scenes name: a dataset keeps its radiance maps, and opens no other file for them."""

from __future__ import annotations

import dataclasses
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from made_up import made_up_truth, stored

from malus.renderers import Truth
from malus.renderers.datasets.dataset import open_dataset
from malus.renderers.datasets.dataset_files import with_own_files
from malus.renderers.datasets.spectral_exr import write_exr
from malus.renderers.mitsuba.translate import tessellated
from malus.scenes import InputError
from malus.scenes.core.named_file import digest_of
from malus.scenes.lights.environment import radiance_map
from malus.scenes.lights.lights import Environment, turned
from malus.scenes.shapes.shapes import MeshFile


def with_map(path: Path, folder: Path) -> tuple[Truth, Environment]:
    """A dataset of one scene under a radiance map."""
    write_exr(path, dict.fromkeys("RGB", np.full((4, 8), 0.5, np.float32)))
    light = Environment(name=str(path), digest=digest_of(path, "radiance map"))
    truth = made_up_truth()
    truth = dataclasses.replace(truth, scene=truth.scene.model_copy(update={"light": light}))
    stored(folder, truth)
    return truth, light


def light_of(folder: Path, truth: Truth) -> Environment:
    light = open_dataset(folder).truth(truth.scene.id).scene.light
    assert isinstance(light, Environment)
    return light


def test_a_dataset_keeps_its_radiance_maps(tmp_path: Path) -> None:
    truth, light = with_map(tmp_path / "a.exr", tmp_path / "data")
    expected = radiance_map(light)
    (tmp_path / "a.exr").unlink()
    (tmp_path / "data").rename(tmp_path / "moved")
    radiance_map.cache_clear()
    found = open_dataset(tmp_path / "moved").truth(truth.scene.id)
    assert found.scene.id == truth.scene.id
    np.testing.assert_array_equal(radiance_map(light_of(tmp_path / "moved", truth)), expected)
    # Turning the light, as a rolled camera does, keeps the place.
    assert turned(light_of(tmp_path / "moved", truth), 20.0)._file is not None


@pytest.mark.parametrize("name", ["../a.exr", "{outside}", "maps/../../a.exr"])
def test_a_foreign_scene_opens_no_file_outside_its_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Not even one of the right content, whatever its hashes say."""
    truth, light = with_map(tmp_path / "a.exr", tmp_path / "data")
    monkeypatch.chdir(tmp_path / "data")
    content = {"name": name.format(outside=tmp_path / "a.exr"), "digest": light.digest}
    named = Environment.parse(content, "test")
    evil = dataclasses.replace(truth, scene=truth.scene.model_copy(update={"light": named}))
    stored(tmp_path / "evil", evil)
    shutil.rmtree(tmp_path / "evil" / "maps")
    radiance_map.cache_clear()
    with pytest.raises(InputError, match=r"evil/maps/[0-9a-f]{16}\.exr: expected a readable"):
        radiance_map(light_of(tmp_path / "evil", evil))


@pytest.mark.parametrize("digest", ["../../../../a", "", "0123456789ABCDEF"])
def test_a_digest_leads_out_of_no_dataset(tmp_path: Path, digest: str) -> None:
    light = Environment.parse({"name": "/etc/passwd", "digest": digest}, "test")
    scene = made_up_truth().scene.model_copy(update={"light": light})
    found = with_own_files(scene, tmp_path, set()).light
    assert isinstance(found, Environment)
    assert found.file == tmp_path / "maps" / "unknown"


def test_a_map_that_is_a_link_or_another_file_is_refused(tmp_path: Path) -> None:
    truth, light = with_map(tmp_path / "a.exr", tmp_path / "data")
    kept = tmp_path / "data" / "maps" / f"{light.digest}.exr"
    kept.unlink()
    kept.symlink_to(tmp_path / "a.exr")
    with pytest.raises(InputError, match="found a link"):
        light_of(tmp_path / "data", truth)
    kept.unlink()
    write_exr(kept, dict.fromkeys("RGB", np.full((4, 8), 0.6, np.float32)))
    with pytest.raises(InputError, match=f"expected digest {light.digest}"):
        light_of(tmp_path / "data", truth)


def test_a_map_or_mesh_that_changed_since_is_refused(tmp_path: Path) -> None:
    _, light = with_map(tmp_path / "a.exr", tmp_path / "data")
    write_exr(tmp_path / "a.exr", dict.fromkeys("RGB", np.full((4, 8), 0.7, np.float32)))
    radiance_map.cache_clear()
    with pytest.raises(InputError, match=f"a radiance map with digest {light.digest}"):
        radiance_map(light)
    file = tmp_path / "a.obj"
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "utf-8")
    mesh = MeshFile(path=str(file), digest=digest_of(file, "mesh file"), shading="flat")
    assert len(tessellated(mesh).faces) == 1
    tessellated.cache_clear()
    file.write_text("v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n", "utf-8")
    with pytest.raises(InputError, match="a mesh file with digest"):
        tessellated(mesh)
    os.unlink(file)
    os.mkfifo(file)
    with pytest.raises(InputError, match="found no file"):
        tessellated(mesh)
