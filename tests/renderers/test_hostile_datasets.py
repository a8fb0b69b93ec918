"""A dataset believes nobody: damaged and hostile files are refused by name, or rendered again."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from made_up import made_up_truth, stored
from runs import NOBODY, SUITE

from malus.bench.datasets.render import render_dataset
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.dataset_record import MAX_DATASET_BYTES, SceneEntry
from malus.renderers.datasets.scene_folder import IMAGES
from malus.renderers.datasets.spectral_exr import read_exr, write_exr
from malus.scenes import InputError, load_suite
from malus.scenes.core.files import read_json
from malus.scenes.suite import MOST_SCENES

Damage = Callable[[Path], None]


def edit_json(path: Path, change: Callable[[dict], None]) -> None:
    content = json.loads(path.read_text("utf-8"))
    change(content)
    path.write_text(json.dumps(content), "utf-8")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


def flip(path: Path) -> None:
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 1
    path.write_bytes(raw)


def link(path: Path) -> None:
    shutil.move(path, path.parent.parent / "elsewhere")
    path.symlink_to(path.parent.parent / "elsewhere")


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


HASHED = [*IMAGES, "float64.exr", "scene.json"]
DAMAGED = [(damage, name) for damage in (cut, flip, Path.unlink, link, pipe) for name in HASHED]
# Nothing has the hash of dataset.json: a bit that flips in its free text stays unseen.
DAMAGED += [(damage, "../dataset.json") for damage in (cut, Path.unlink, link, pipe)]


@pytest.mark.parametrize(("damage", "name"), DAMAGED)
def test_a_damaged_file_is_named(tmp_path: Path, damage: Damage, name: str) -> None:
    truth = made_up_truth(dtype=np.float64)
    path = stored(tmp_path, truth) / truth.scene.id / name
    damage(path.resolve())
    with pytest.raises(InputError) as caught:
        open_folder(tmp_path).truth(truth.scene.id)
    assert Path(name).name in caught.value.where


def rehash(folder: Path, change: Callable[[Path], None]) -> None:
    """Change a scene as somebody would who also corrects all hashes."""
    import hashlib

    change(folder)

    def correct(record: dict) -> None:
        for name in record["files"]:
            raw = (folder / name).read_bytes()
            digest = hashlib.sha256(raw).hexdigest()
            record["files"][name] = {"bytes": len(raw), "sha256": digest}

    edit_json(folder / "scene.json", correct)
    sha256 = hashlib.sha256((folder / "scene.json").read_bytes()).hexdigest()
    edit_json(folder.parent / "dataset.json", lambda d: d["scenes"][0].update(sha256=sha256))


def larger(folder: Path) -> None:
    write_exr(folder / "geometry.exr", {"mask": np.zeros((64, 64), np.float32)})


def extra_channel(folder: Path) -> None:
    channels = OpenEXR.File(str(folder / "geometry.exr"), separate_channels=True).channels()
    planes = {name: channel.pixels for name, channel in channels.items()}
    write_exr(folder / "geometry.exr", planes | {"smuggled": planes["mask"]})


def whole_numbers(folder: Path) -> None:
    names = ["normals.X", "normals.Y", "normals.Z", "mask"]
    write_exr(folder / "geometry.exr", dict.fromkeys(names, np.zeros((6, 6), np.uint32)))


def huge(folder: Path) -> None:
    edit_json(folder / "scene.json", lambda r: r.update(shape=[8192, 8192]))


def two_parts(folder: Path) -> None:
    plane = np.zeros((6, 6), np.float32)
    parts = [OpenEXR.Part({}, {n: plane}, n) for n in ("a", "b")]
    OpenEXR.File(parts).write(str(folder / "geometry.exr"))


def no_exr(folder: Path) -> None:
    (folder / "geometry.exr").write_bytes(b"P6 6 6 255 " + bytes(108))


def cut_inside(folder: Path) -> None:
    cut(folder / "geometry.exr")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (larger, "64 × 64"),
        (extra_channel, "smuggled"),
        (whole_numbers, "uint32"),
        (huge, "at most 2147483648 bytes"),
        (two_parts, "one part"),
        (no_exr, "geometry.exr"),
        (cut_inside, "geometry.exr"),
    ],
)
def test_a_hostile_file_with_correct_hashes_is_refused(
    tmp_path: Path, change: Callable[[Path], None], says: str
) -> None:
    truth = made_up_truth()
    rehash(stored(tmp_path, truth) / truth.scene.id, change)
    with pytest.raises(InputError, match=says):
        open_folder(tmp_path).truth(truth.scene.id)


@pytest.mark.parametrize("name", ["../../etc", "/etc", "0123456789abcdef\n", "0123456789ABCDEF"])
def test_no_scene_leads_out_of_the_dataset(tmp_path: Path, name: str) -> None:
    stored(tmp_path, made_up_truth())
    edit_json(tmp_path / "dataset.json", lambda d: d["scenes"][0].update(scene=name))
    with pytest.raises(InputError, match=r"scenes\.0\.scene"):
        open_folder(tmp_path)


def test_a_scene_of_another_name_is_refused(tmp_path: Path) -> None:
    one, other = made_up_truth(0), made_up_truth(1)
    stored(tmp_path, one, other)
    shutil.rmtree(tmp_path / one.scene.id)
    shutil.copytree(tmp_path / other.scene.id, tmp_path / one.scene.id)
    with pytest.raises(InputError, match=other.scene.id):
        open_folder(tmp_path).truth(one.scene.id)
    with pytest.raises(InputError, match="expected one of the 2 scenes"):
        open_folder(tmp_path).truth("0" * 16)


@pytest.mark.parametrize("text", ["", "[" * 100_000, "{}x", '{"scenes": [{"scene": 1}]}', "\xff"])
def test_json_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "dataset.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"dataset\.json"):
        open_folder(tmp_path)


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, {"Y": np.zeros((4, 4), np.float32)})
    os.truncate(path, 1 << 30)  # sparse: takes no room
    with pytest.raises(InputError, match="at most"):
        read_exr(path, (4, 4), ["Y"])


def test_a_record_that_is_too_large_is_not_read_and_a_small_one_costs_its_own_size(
    tmp_path: Path,
) -> None:
    path = tmp_path / "dataset.json"
    path.write_text("{}", "utf-8")
    tracemalloc.start()
    assert read_json(path, MAX_DATASET_BYTES)[0] == {}
    # The buffer of an open file is 8 kB or a block of the disk; the limit is thousands of times it.
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    os.truncate(path, MAX_DATASET_BYTES + 1)  # sparse: takes no room
    with pytest.raises(InputError, match=f"at most {MAX_DATASET_BYTES} bytes"):
        open_folder(tmp_path)
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()


def test_a_dataset_of_the_most_scenes_that_a_suite_may_have_can_be_read_back() -> None:
    suite = load_suite("random")
    scenes = itertools.islice(suite.scenes(), 40)
    more = {"origin": "0" * 16, "bytes": 10**7, "index": MOST_SCENES, "split": "train"}
    entries = [SceneEntry.of(scene, "0" * 64, **more).model_dump() for scene in scenes]
    # As `dataset.json` is written, with the indentation and comma of every line.
    average = len(json.dumps({"scenes": entries}, indent=1)) / len(entries)
    assert average * MOST_SCENES < MAX_DATASET_BYTES


def test_damaged_scenes_are_rendered_again(tmp_path: Path) -> None:
    render_dataset(SUITE, tmp_path, NOBODY)
    first, second, *_ = open_folder(tmp_path).scenes
    cut(tmp_path / first / "error.exr")
    (tmp_path / second / "scene.json").write_text("{", "utf-8")
    assert render_dataset(SUITE, tmp_path, NOBODY)["rendered"] == 2
    assert len(list(open_folder(tmp_path))) == 4
    assert not list(tmp_path.glob(".*"))
