"""Samples for training are the truths of the dataset, from every form, in every process."""

from __future__ import annotations

import json
import multiprocessing
import pickle
import shutil
import subprocess
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from runs import formula_dataset

import malus
from malus.bench.datasets.export import export
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.datasets.hdf5 import write_hdf5
from malus.renderers.datasets.shards import Shards, ShardScene
from malus.renderers.variant import Variant
from malus.scenes import InputError

NOBODY = Variant("scalar_spectral_polarized", "not used")
SIDE = 14
MAPS = ("stokes", "image", "mask", "normals", "specular", "diffuse", "standard_error")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return formula_dataset(tmp_path_factory.mktemp("dataset"), SIDE)


@pytest.fixture(scope="module")
def forms(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The dataset itself, and its exports, by name."""
    pytest.importorskip("h5py", reason="h5py is not installed")
    folders = {"folders": dataset.path}
    for name in ("webdataset", "hdf5"):
        folders[name] = tmp_path_factory.mktemp(name)
        export(dataset, name, folders[name])
    return folders


FORMS = ("folders", "webdataset", "hdf5")


@pytest.mark.parametrize("form", FORMS)
def test_samples_are_the_truths(dataset: Dataset, forms: dict[str, Path], form: str) -> None:
    """To the bit of float32, in which all forms store."""
    samples = malus.open_dataset(forms[form], maps=MAPS)
    assert len(samples) == len(dataset)
    for sample, truth in zip(samples, dataset.truths(), strict=True):
        assert sample["scene"] == truth.scene.id
        for name in MAPS:
            stored = np.asarray(getattr(truth, name))
            expected = stored if stored.dtype == bool else stored.astype(np.float32)
            np.testing.assert_array_equal(sample[name], expected, err_msg=name)


@pytest.mark.parametrize("form", FORMS)
def test_crops_are_windows_of_the_whole(forms: dict[str, Path], form: str) -> None:
    """The same window in all arrays; another one in another epoch; the same again."""
    whole = malus.open_dataset(forms[form], maps=MAPS)
    crops = malus.open_dataset(forms[form], maps=MAPS, crop=5, seed=3)
    first = crops[1]
    windows = [
        (top, left)
        for top in range(SIDE - 4)
        for left in range(SIDE - 4)
        if all(
            np.array_equal(first[name], whole[1][name][top : top + 5, left : left + 5])
            for name in MAPS
        )
    ]
    assert len(windows) == 1
    np.testing.assert_array_equal(crops[1]["stokes"], first["stokes"])
    crops.set_epoch(1)
    others = [crops[index]["stokes"] for index in range(len(crops))]
    crops.set_epoch(0)
    again = [crops[index]["stokes"] for index in range(len(crops))]
    assert not all(np.array_equal(a, b) for a, b in zip(others, again, strict=True))


def test_crops_begin_anywhere_where_they_fit(forms: dict[str, Path]) -> None:
    """At either end too: of a crop one pixel smaller than the picture there are four."""
    whole = malus.open_dataset(forms["folders"], maps=("stokes",))[0]["stokes"]
    crops = malus.open_dataset(forms["folders"], maps=("stokes",), crop=SIDE - 1)
    found = set()
    for epoch in range(40):  # each of four comes 40 times but once in 10^5 epochs of this length
        crops.set_epoch(epoch)
        found.add(crops[0]["stokes"].tobytes())
    expected = [whole[a : SIDE - 1 + a, b : SIDE - 1 + b] for a in (0, 1) for b in (0, 1)]
    assert found == {window.tobytes() for window in expected}


def test_all_forms_cut_the_same_crops(forms: dict[str, Path]) -> None:
    """A crop follows from seed, epoch and index, whatever stores the dataset."""
    pictures = [malus.open_dataset(forms[form], crop=6, seed=1)[2]["image"] for form in FORMS]
    for picture in pictures[1:]:
        np.testing.assert_array_equal(picture, pictures[0])


@pytest.mark.parametrize("form", FORMS)
def test_all_forms_take_seeds_and_epochs(forms: dict[str, Path], form: str) -> None:
    """Where nothing is chosen too: a training loop sets the epoch whatever it reads."""
    for chosen in ({}, {"seed": 5}):
        samples = malus.open_dataset(forms[form], **chosen)  # type: ignore[arg-type]
        before = samples[1]["stokes"]
        samples.set_epoch(1)
        np.testing.assert_array_equal(samples[1]["stokes"], before)
    with pytest.raises(InputError, match="seed: expected a whole number, 0 or larger, found -1"):
        malus.open_dataset(forms[form], seed=-1)
    for epoch in (-1, 1.5, "a"):
        with pytest.raises(InputError, match="epoch: expected a whole number, 0 or larger"):
            malus.open_dataset(forms[form], crop=5).set_epoch(epoch)  # type: ignore[arg-type]


@pytest.mark.parametrize("form", FORMS)
def test_arrays_of_a_sample_are_its_own(forms: dict[str, Path], form: str) -> None:
    """A picture divided by its mean in place leaves the truth as it is, and the next reading."""
    samples = malus.open_dataset(forms[form], maps=("image", "stokes"))
    sample = samples[1]
    before = sample["stokes"].copy()
    sample["image"] /= 2 * sample["image"].mean()
    np.testing.assert_array_equal(sample["stokes"], before)
    np.testing.assert_array_equal(samples[1]["stokes"], before)


@pytest.mark.parametrize("form", ["webdataset", "hdf5"])
def test_exports_are_told_from_datasets(forms: dict[str, Path], form: str) -> None:
    """Training, scores and exports need whole truths: the message says which folder to give."""
    with pytest.raises(InputError, match="found its export; give the folder it was made of"):
        open_folder(forms[form])


def test_an_index_of_another_export_is_noticed(forms: dict[str, Path], tmp_path: Path) -> None:
    """Where scenes lie elsewhere their arrays have the same shapes: other truths were read."""
    folder = shutil.copytree(forms["webdataset"], tmp_path / "mixed")
    index = folder / "malus-000000.tar.index.json"
    offsets = json.loads(index.read_text())
    turned = [*offsets][1:] + [*offsets][:1]
    index.write_text(json.dumps(dict(zip(turned, offsets.values(), strict=True))))
    with pytest.raises(InputError, match=r"npy where its index has .*; export the dataset again"):
        malus.open_dataset(folder, maps="stokes")[0]


def _read(samples: Any, index: int, queue: Any) -> None:
    queue.put(samples[index]["stokes"])


# Where another test of this process imported JAX, it warns of every fork; ours uses no JAX.
@pytest.mark.filterwarnings("ignore:os.fork:RuntimeWarning")
@pytest.mark.parametrize("method", ["fork", "spawn"])
@pytest.mark.parametrize("form", FORMS)
def test_workers_read_what_the_parent_reads(forms: dict[str, Path], form: str, method: str) -> None:
    """Also after the parent has opened the files, whose positions a fork shares."""
    samples = malus.open_dataset(forms[form], maps=("stokes",))
    expected = [samples[index]["stokes"] for index in range(2)]
    context = multiprocessing.get_context(method)
    queue = context.Queue()
    workers = [context.Process(target=_read, args=(samples, 1, queue)) for _ in range(2)]
    for worker in workers:
        worker.start()
    for _ in workers:
        np.testing.assert_array_equal(queue.get(timeout=60), expected[1])
    for worker in workers:
        worker.join()
    np.testing.assert_array_equal(samples[0]["stokes"], expected[0])


@pytest.mark.parametrize("form", FORMS)
def test_samples_are_pickled(forms: dict[str, Path], form: str) -> None:
    samples = malus.open_dataset(forms[form], crop=4)
    first = samples[0]
    again = pickle.loads(pickle.dumps(samples))
    np.testing.assert_array_equal(again[0]["image"], first["image"])


def test_indices_are_those_of_a_list(dataset: Dataset) -> None:
    samples = dataset.samples()
    assert samples[-1]["scene"] == samples[len(samples) - 1]["scene"]
    with pytest.raises(IndexError):
        samples[len(samples)]
    assert len(list(samples)) == len(samples)


def test_an_index_does_not_list_all_scenes(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An epoch over the indices of a dataset would be quadratic in its scenes."""
    first = dataset[0]["scene"]
    monkeypatch.setattr(Dataset, "samples", None)
    assert dataset[1]["scene"] != first


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"split": "train"}, "a dataset with splits"),
        ({"maps": ("stoke",)}, "did you mean stokes"),
        ({"crop": 99}, f"1 to {SIDE} pixels"),
    ],
)
def test_wrong_choices_are_named(dataset: Dataset, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        malus.open_dataset(dataset.path, **options)


def test_no_dataset_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"dataset\.json, shards\.json or dataset\.h5"):
        malus.open_dataset(tmp_path)


def test_a_cut_shard_is_no_sample(forms: dict[str, Path], tmp_path: Path) -> None:
    """Never fewer rows in silence."""
    for path in forms["webdataset"].iterdir():
        content = path.read_bytes()
        cut = len(content) // 2 if path.suffix == ".tar" else len(content)
        (tmp_path / path.name).write_bytes(content[:cut])
    samples = malus.open_dataset(tmp_path, maps=("stokes",))
    with pytest.raises(InputError, match="the arrays of scene"):
        list(samples)


# That reader leaves the last shard to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_shards_are_read_by_webdataset(dataset: Dataset, forms: dict[str, Path]) -> None:
    """The project's own reader gives every array back."""
    webdataset = pytest.importorskip("webdataset", reason="webdataset is not installed")
    shards = sorted(map(str, forms["webdataset"].glob("*.tar")))
    pipeline = webdataset.WebDataset(shards, shardshuffle=False).decode()
    for sample, truth in zip(pipeline, dataset.truths(), strict=True):
        assert sample["__key__"] == truth.scene.id
        np.testing.assert_array_equal(sample["stokes.npy"], truth.stokes.astype(np.float32))
        assert sample["scene.json"] == truth.scene.model_dump(mode="json")


def test_shards_are_split_by_size(dataset: Dataset, tmp_path: Path) -> None:
    """Several shards hold every scene once, in order; the same content gives the same bytes."""
    from malus.bench.datasets.export_training import _scenes
    from malus.renderers.datasets.shards import write_shards

    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_shards(tmp_path / name, _scenes(dataset, lambda *_: None), {}, limit=1)
    shards = Shards(tmp_path / "a")
    assert list(shards.ids) == list(dataset.scenes)
    files = sorted((tmp_path / "a").glob("*.tar"))
    assert len(files) == len(dataset)
    for path in files:
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
        with tarfile.open(path) as tar:
            assert {name.split(".")[0] for name in tar.getnames()} <= set(dataset.scenes)
    assert json.loads((tmp_path / "a" / "shards.json").read_text())["shape"] == [SIDE, SIDE]


def test_a_changed_byte_of_a_shard_is_found(forms: dict[str, Path], tmp_path: Path) -> None:
    """The usual tool checks every file that samples are read from, by the list beside them."""
    folder = shutil.copytree(forms["webdataset"], tmp_path / "copy")
    check = ["sha256sum", "--check", "--quiet", "--strict", "SHA256SUMS"]
    assert subprocess.run(check, cwd=folder, capture_output=True).returncode == 0
    for path in [*folder.glob("malus-*"), folder / "shards.json"]:
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
        told = subprocess.run(check, cwd=folder, capture_output=True, text=True)
        assert told.returncode == 1
        assert f"{path.name}: FAILED" in told.stdout
        content[len(content) // 2] ^= 1
        path.write_bytes(content)


def test_scenes_that_differ_make_no_hdf5(tmp_path: Path) -> None:
    """A complex index beside a real one is refused, not cut to its real part."""
    pytest.importorskip("h5py", reason="h5py is not installed")
    scenes = [
        ShardScene(name, {"stokes": np.zeros((2, 2, 1, 3)), "eta": eta}, {})
        for name, eta in (("a", np.ones((2, 2, 1))), ("b", np.ones((2, 2, 1), complex)))
    ]
    with pytest.raises(InputError, match="choose webdataset"):
        write_hdf5(tmp_path, 2, scenes, {})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("shape", None),
        ("shape", [SIDE]),
        ("maps", [1]),
        ("shards", [{"file": "a.tar"}]),
        ("splits", 3),
        ("splits", {"train": "abc"}),
    ],
)
def test_a_malformed_list_of_shards_is_one_line(
    forms: dict[str, Path], tmp_path: Path, key: str, value: object
) -> None:
    """Names of arrays that are numbers ended in a traceback."""
    shutil.copytree(forms["webdataset"], tmp_path / "copy")
    record = json.loads((tmp_path / "copy" / "shards.json").read_text("utf-8"))
    (tmp_path / "copy" / "shards.json").write_text(json.dumps(record | {key: value}), "utf-8")
    with pytest.raises(InputError, match=rf"shards\.json, key {key}.*: expected .*, found "):
        malus.open_dataset(tmp_path / "copy", split="train", maps=("stokes",), crop=SIDE)


def test_a_missing_index_is_named(forms: dict[str, Path], tmp_path: Path) -> None:
    """The shard, which is there, was said to be missing."""
    shutil.copytree(forms["webdataset"], tmp_path / "copy")
    (index,) = (tmp_path / "copy").glob("*.index.json")
    index.unlink()
    with pytest.raises(InputError, match=rf"{index.name}: expected .*, found No such file"):
        malus.open_dataset(tmp_path / "copy", maps="stokes")[0]
