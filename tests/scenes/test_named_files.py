"""Meshes, pictures, measured materials, radiance maps: a dataset keeps those that scenes name."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
from made_up import made_up_truth
from PIL import Image

from malus.renderers.datasets import dataset_files, dataset_writer
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.datasets.dataset_files import with_own_files
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.datasets.spectral_exr import write_exr
from malus.renderers.mitsuba.translate import tessellated
from malus.scenes import Distant, InputError
from malus.scenes.core.named_file import digest_of
from malus.scenes.lights.environment import radiance_map
from malus.scenes.lights.lights import Environment, turned
from malus.scenes.materials.measured import Measured
from malus.scenes.materials.surface import Dielectric, Patterned
from malus.scenes.scene import Scene
from malus.scenes.shapes.patterns import ImageTexture
from malus.scenes.shapes.shapes import MeshFile, Sphere
from malus.scenes.surroundings import Placed, Surroundings

KINDS = ["mesh", "picture", "material", "map", "beside"]
NAMES = {"picture": "a.png", "material": "a.pbsdf", "map": "a.exr"}
FOLDERS = {"picture": "pictures", "material": "materials", "map": "maps"}
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def naming(kind: str, path: str, digest: str) -> Scene:
    """A scene that names a file: its mesh, pattern's picture, material, light, a mesh beside it.

    Parsed, as what comes from elsewhere is: nothing of it is changed or opened.
    """
    scene = made_up_truth().scene
    named = {"path": path, "digest": digest}
    if kind == "material":
        return scene.model_copy(update={"surface": Measured.parse(named, "test")})
    if kind == "map":
        light = Environment.parse({"name": path, "digest": digest}, "test")
        return scene.model_copy(update={"light": light})
    mesh = MeshFile.parse(named | {"shading": "flat"}, "test")
    if kind == "mesh":
        return scene.model_copy(update={"shape": mesh})
    if kind == "picture":
        paint = scene.surface
        assert isinstance(paint, Dielectric)
        texture = ImageTexture.parse(named, "test")
        patterned = Patterned(pattern=texture, surfaces=(paint, paint))
        return scene.model_copy(update={"surface": patterned})
    beside = (Placed(shape=Sphere(), surface=scene.surface),)
    beside += (Placed(shape=mesh, surface=scene.surface, position=(3, 0, 0)),)
    around = Surroundings(name="room", objects=beside)
    return scene.model_copy(update={"surroundings": around})


def opened(scene: Scene) -> object:
    """What rendering reads of the file that a scene names."""
    tessellated.cache_clear()
    radiance_map.cache_clear()
    if isinstance(scene.light, Environment):
        return radiance_map(scene.light)
    if isinstance(scene.surface, Measured):
        return scene.surface.checked().read_bytes()
    if isinstance(scene.surface, Patterned):
        assert isinstance(scene.surface.pattern, ImageTexture)
        return scene.surface.pattern.grey()
    shape = scene.surroundings.objects[1].shape if scene.surroundings else scene.shape
    return tessellated(shape).vertices


def holding(kind: str, folder: Path) -> tuple[Path, str]:
    """A file for `naming`, and its digest."""
    path = folder / NAMES.get(kind, "a.obj")
    if kind == "picture":
        Image.fromarray(np.eye(4, dtype=np.uint8)).save(path)
    elif kind == "map":
        write_exr(path, dict.fromkeys("RGB", np.full((4, 8), 0.5, np.float32)))
    else:
        path.write_text(OBJ, "utf-8")
    return path, digest_of(path, kind)


def stored_scene(folder: Path, scene: Scene) -> Dataset:
    with DatasetWriter(folder) as writer:
        writer.add(dataclasses.replace(made_up_truth(), scene=scene))
    return open_folder(folder)


@pytest.mark.parametrize("kind", KINDS)
def test_a_dataset_keeps_its_files(tmp_path: Path, kind: str) -> None:
    path, digest = holding(kind, tmp_path)
    scene = naming(kind, str(path), digest)
    expected = opened(scene)
    stored_scene(tmp_path / "data", scene)
    path.unlink()
    (tmp_path / "data").rename(tmp_path / "moved")
    found = open_folder(tmp_path / "moved").truth(scene.id).scene
    assert found.id == scene.id
    np.testing.assert_array_equal(opened(found), expected)
    # Turning the light, as a rolled camera does, keeps the place.
    rolled = found.model_copy(update={"light": turned(found.light, 20.0)})
    np.testing.assert_array_equal(opened(rolled), expected)
    (kept,) = (tmp_path / "moved").glob(f"{FOLDERS.get(kind, 'meshes')}/*")
    kept.write_bytes(b"another")
    with pytest.raises(InputError, match=f"expected digest {digest}"):
        open_folder(tmp_path / "moved").truth(scene.id)


@pytest.mark.parametrize("digest", [None, "", "../../a", "0123456789abcdef"])
@pytest.mark.parametrize("name", ["../{name}", "{folder}/{name}", "link{suffix}", "pipe{suffix}"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_foreign_scene_opens_no_file_outside_its_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, name: str, digest: str | None
) -> None:
    """Not even one of the right digest (None), and a pipe is not waited for."""
    path, right = holding(kind, tmp_path)
    evil = tmp_path / "evil"
    name = name.format(name=path.name, folder=tmp_path, suffix=path.suffix)
    scene = naming(kind, name, right if digest is None else digest)
    monkeypatch.setattr(dataset_writer, "keep_files", lambda *_: None)
    dataset = stored_scene(evil, scene)
    (evil / f"link{path.suffix}").symlink_to(path)
    os.mkfifo(evil / f"pipe{path.suffix}")
    unknown = evil / FOLDERS.get(kind, "meshes") / f"unknown{path.suffix}"
    monkeypatch.chdir(evil)
    found = dataset.truth(scene.id).scene  # what reading, scoring and exporting begin with
    with pytest.raises(
        InputError, match=rf"evil/{unknown.parent.name}/\w+\{path.suffix}: expected a read"
    ):
        opened(found)
    unknown.parent.mkdir()
    for other in (unknown, unknown.with_stem(right)):
        other.symlink_to(path)
    if digest != "0123456789abcdef":
        with pytest.raises(InputError, match="found a link"):
            dataset.truth(scene.id)
        unknown.unlink()
        unknown.write_bytes(path.read_bytes())
    if digest in ("", "../../a"):
        with pytest.raises(InputError, match=f"expected digest {digest}, found {right}"):
            dataset.truth(scene.id)


def test_a_suffix_leads_out_of_no_dataset(tmp_path: Path) -> None:
    for name in ("a.\0", "a.obj/../../b", "a. ", "a.\n", "a.\u0601"):
        scene = with_own_files(naming("mesh", name, "0" * 16), tmp_path, set())
        assert isinstance(scene.shape, MeshFile)
        assert scene.shape.file == tmp_path / "meshes" / ("0" * 16)


@pytest.mark.parametrize("digest", ["../../../../a", "", "0123456789ABCDEF"])
def test_a_digest_leads_out_of_no_dataset(tmp_path: Path, digest: str) -> None:
    light = with_own_files(naming("map", "/etc/passwd", digest), tmp_path, set()).light
    assert isinstance(light, Environment)
    assert light.file == tmp_path / "maps" / "unknown"


@pytest.mark.parametrize(
    ("kind", "called"),
    [
        ("picture", "picture"),
        ("map", "radiance map"),
        ("mesh", "mesh file"),
        ("beside", "mesh file"),
    ],
)
def test_a_file_that_changed_since_is_refused(tmp_path: Path, kind: str, called: str) -> None:
    path, digest = holding(kind, tmp_path)
    scene = naming(kind, str(path), digest)
    opened(scene)
    path.write_bytes(path.read_bytes() + b"\n")
    with pytest.raises(InputError, match=f"a {called} with digest {digest}"):
        opened(scene)
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(InputError, match="found no file"):
        opened(scene)


def test_an_open_dataset_reads_a_file_of_many_scenes_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, digest = holding("material", tmp_path)
    scenes = [naming("material", str(path), digest)]
    scenes.append(scenes[0].model_copy(update={"light": Distant(incidence_deg=30)}))
    with DatasetWriter(tmp_path / "data") as writer:
        for scene in scenes:
            writer.add(dataclasses.replace(made_up_truth(), scene=scene))
    read: list[Path] = []
    hashed = dataset_files.digest
    monkeypatch.setattr(dataset_files, "digest", lambda p: read.append(p) or hashed(p))
    found = list(open_folder(tmp_path / "data").truths())
    assert len(found) == 2
    assert len(read) == 1
    # Whoever opens the file still sees that it is another.
    read[0].write_bytes(b"another")
    with pytest.raises(InputError, match=f"a pBRDF file with digest {digest}"):
        opened(found[1].scene)


def test_a_suite_with_the_digest_of_another_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(OBJ, encoding="ascii")
    right = MeshFile.parse({"path": "a.obj"}, "test").located(tmp_path).digest
    told = MeshFile.parse({"path": "a.obj", "digest": right}, "test")
    assert told.located(tmp_path).digest == right
    other = MeshFile.parse({"path": "a.obj", "digest": "aa"}, "test")
    with pytest.raises(InputError, match=rf"a mesh file with digest aa, found {right}"):
        other.located(tmp_path)
