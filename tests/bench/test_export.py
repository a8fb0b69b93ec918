"""Exports mean in the other tool's convention what the truth means in ours."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import OpenEXR
import pytest
from made_up import BANDS, made_up_truth
from PIL import Image
from runs import formula_dataset

import malus
from malus.bench.datasets.export import export
from malus.bench.scoring.observe import observe
from malus.reconstruct.photos.png16 import aolp_16bit
from malus.renderers import Truth
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.scenes import InputError

NAMES = ("450nm", "532.1234567nm", "650nm")


@pytest.fixture
def truth() -> Truth:
    return made_up_truth()


@pytest.fixture
def dataset(tmp_path: Path, truth: Truth) -> Dataset:
    with DatasetWriter(tmp_path / "dataset") as writer:
        writer.add(truth)
    return open_folder(tmp_path / "dataset")


def stokes_by_least_squares(images: np.ndarray, radians: np.ndarray) -> np.ndarray:
    """Literally what polanalyser.calcStokes does with images (height, width, angles)."""
    rows = 0.5 * np.array([np.ones_like(radians), np.cos(2 * radians), np.sin(2 * radians)]).T
    return np.tensordot(images, np.linalg.inv(rows.T @ rows) @ rows.T, axes=(2, 1))


@pytest.mark.parametrize("pixels", ["exr", "png"])
def test_polanalyser_finds_the_stokes_vectors_again(
    tmp_path: Path, dataset: Dataset, truth: Truth, pixels: str
) -> None:
    assert export(dataset, "polanalyser", tmp_path / "out", pixels) == 1
    for band, name in enumerate(NAMES):
        folder = tmp_path / "out" / truth.scene.id / name
        files = sorted(folder.glob(f"image*.{pixels}"))
        facts = [json.loads(path.with_suffix(".json").read_text("utf-8")) for path in files]
        images = np.stack([read(path, facts[0]["full_scale"]) for path in files], axis=-1)
        found = stokes_by_least_squares(images, np.array([fact["angle"] for fact in facts]))
        # Floats are exact to rounding; 16 bits are half a step wrong, and s is a sum of four.
        step = facts[0]["full_scale"] / 65535 if pixels == "png" else 1e-6
        np.testing.assert_allclose(found, truth.stokes[:, :, band], atol=2 * step)


def read(path: Path, full_scale: float) -> np.ndarray:
    if path.suffix == ".exr":
        return OpenEXR.File(str(path), separate_channels=True).channels()["Y"].pixels
    values = np.array(Image.open(path))
    assert values.dtype == np.uint16
    return values * (full_scale / 65535)


def test_angles_are_stated_in_both_conventions(
    tmp_path: Path, dataset: Dataset, truth: Truth
) -> None:
    export(dataset, "polanalyser", tmp_path / "out")
    folder = tmp_path / "out" / truth.scene.id / NAMES[0]
    for path in folder.glob("*.json"):
        fact = json.loads(path.read_text("utf-8"))
        # From the horizontal to the vertical it is a quarter turn, anticlockwise both.
        assert (np.degrees(fact["angle"]) - fact["malus_angle_deg"]) % 180 == pytest.approx(90)
        seen = OpenEXR.File(str(path.with_suffix(".exr")), separate_channels=True)
        expected = truth.polarised(angle_deg=fact["malus_angle_deg"])[:, :, 0]
        np.testing.assert_allclose(seen.channels()["Y"].pixels, expected, atol=1e-6)
    words = json.loads((tmp_path / "out" / "conventions.json").read_text("utf-8"))
    assert "HORIZONTAL" in words["angle"]
    assert "VERTICAL" in words["malus_angle_deg"]


def test_png_pairs_hold_angle_and_degree(tmp_path: Path, dataset: Dataset, truth: Truth) -> None:
    export(dataset, "png", tmp_path / "out")
    mask = truth.mask
    for band, name in enumerate(NAMES):
        folder = tmp_path / "out" / truth.scene.id
        aolp = np.array(Image.open(folder / f"aolp_{name}.png"))
        dolp = np.array(Image.open(folder / f"dolp_{name}.png"))
        assert aolp.dtype == dolp.dtype == np.uint16
        assert not aolp[~mask].any()
        assert not dolp[~mask].any()
        s0, s1, s2 = np.moveaxis(truth.stokes[:, :, band].astype(float), -1, 0)
        # A double angle on the circle needs no care at 0 and 180°; a step is 2π / 65536.
        turn = np.exp(2j * np.pi * aolp / 65536)
        expected = (s1 + 1j * s2) / np.hypot(s1, s2)
        np.testing.assert_allclose(turn[mask], expected[mask], atol=1e-4)
        true = np.minimum(np.hypot(s1, s2) / s0, 1.0)
        np.testing.assert_allclose(dolp[mask] / 65535, true[mask], atol=1 / 65535)


def test_the_angle_just_below_180_degrees_is_0() -> None:
    stokes = np.array([1.0, 1.0, -1e-9])
    assert aolp_16bit(stokes) == 0


def test_numpy_arrays_are_those_of_the_truth(
    tmp_path: Path, dataset: Dataset, truth: Truth
) -> None:
    export(dataset, "numpy", tmp_path / "out")
    found = np.load(tmp_path / "out" / truth.scene.id / "truth.npz", allow_pickle=False)
    for name in ("stokes", "image", "specular", "diffuse", "normals", "mask", "standard_error"):
        np.testing.assert_array_equal(found[name], getattr(truth, name))
    assert tuple(found["wavelengths_nm"]) == BANDS
    assert found["eta"].tolist() == truth.scene.eta.tolist()
    scene = json.loads((tmp_path / "out" / truth.scene.id / "scene.json").read_text("utf-8"))
    assert type(truth.scene).parse(scene, "scene.json") == truth.scene


def test_an_export_replaces_an_older_one(tmp_path: Path, dataset: Dataset, truth: Truth) -> None:
    for layout in ("png", "numpy"):
        export(dataset, layout, tmp_path / "out")
    names = {path.name for path in (tmp_path / "out" / truth.scene.id).iterdir()}
    assert names == {"truth.npz", "scene.json"}
    assert not list((tmp_path / "out").glob(".*"))


def test_exports_are_not_mixed(tmp_path: Path, dataset: Dataset) -> None:
    """Readers of a folder take what they find there for one data set."""
    more = formula_dataset(tmp_path / "more")
    assert len(more) > len(dataset)
    for older, newer in (
        ("webdataset", "hdf5"), ("hdf5", "numpy"), ("numpy", "numpy"), ("rgb2pol", "rgb2pol"),
    ):  # fmt: skip
        out = tmp_path / f"{older}-{newer}"
        export(more, older, out)
        before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
        with pytest.raises(InputError, match="choose another `out`"):
            export(dataset, newer, out)
        assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before
    for layout in ("webdataset", "hdf5"):
        export(more, layout, tmp_path / layout)
        export(dataset, layout, tmp_path / layout)
        assert len(malus.open_dataset(tmp_path / layout, maps="image")) == len(dataset)


def part_of(dataset: Dataset, numbers: list[int]) -> Dataset:
    """The dataset with some of its scenes alone, as if the others were not rendered yet."""
    entries = tuple(dataset.record.scenes[number] for number in numbers)
    record = dataset.record.model_copy(update={"scenes": entries})
    return dataclasses.replace(dataset, record=record)


@pytest.mark.parametrize("layout", ["numpy", "png", "rgb2pol", "webdataset"])
def test_an_export_grows_with_its_dataset(tmp_path: Path, layout: str) -> None:
    whole = formula_dataset(tmp_path / "dataset")
    export(part_of(whole, [0, 1]), layout, tmp_path / "out")
    export(whole, layout, tmp_path / "out")
    export(whole, layout, tmp_path / "new")
    grown, new = (
        {p.relative_to(tmp_path / name) for p in (tmp_path / name).rglob("*")}
        for name in ("out", "new")
    )
    assert grown == new
    for path in ("conventions.json", "names.json"):
        if (tmp_path / "new" / path).exists():
            assert (tmp_path / "out" / path).read_text() == (tmp_path / "new" / path).read_text()


def test_what_an_export_would_lose_is_told(tmp_path: Path) -> None:
    whole = formula_dataset(tmp_path / "dataset")
    for layout in ("numpy", "rgb2pol"):
        export(part_of(whole, [0, 2, 3]), layout, tmp_path / layout)
        with pytest.raises(InputError, match="found an export of 2 other scenes; choose another"):
            export(part_of(whole, [0, 1]), layout, tmp_path / layout)
    # Scene 2 was number 1: whoever stopped now would have its picture under the other's number.
    with pytest.raises(InputError, match="found an export of some of them, by other numbers"):
        export(whole, "rgb2pol", tmp_path / "rgb2pol")
    (tmp_path / "numpy" / whole.scenes[1]).mkdir()
    (tmp_path / "numpy" / whole.scenes[1] / "45.npy").touch()
    with pytest.raises(InputError, match=f"found {whole.scenes[1]}, a folder of something else"):
        export(whole, "numpy", tmp_path / "numpy")
    with pytest.raises(InputError, match="found another export; choose another"):
        export(whole, "numpy", tmp_path / "rgb2pol")


def test_splits_go_where_a_dataset_has_none_any_more(tmp_path: Path, dataset: Dataset) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "splits.json").write_text("{}", "utf-8")
    export(dataset, "numpy", tmp_path / "out")
    assert not (tmp_path / "out" / "splits.json").exists()
    rendered = formula_dataset(tmp_path / "rendered")
    (rendered.path / "splits.json").write_text("{}", "utf-8")
    formula_dataset(rendered.path)
    assert not (rendered.path / "splits.json").exists()


def test_maps_of_the_material_are_handed_on(tmp_path: Path, truth: Truth) -> None:
    """To methods and to NumPy, through a dataset, as they were."""
    index = np.random.default_rng(1).random(truth.image.shape) + 0.5j
    rough = np.random.default_rng(2).random(truth.mask.shape)
    mapped = dataclasses.replace(truth, eta_map=index, alpha_map=rough)
    with DatasetWriter(tmp_path / "dataset") as writer:
        writer.add(mapped)
    read_back = open_folder(tmp_path / "dataset")
    seen = observe(read_back.truth(truth.scene.id), frozenset({"eta", "alpha"}))
    export(read_back, "numpy", tmp_path / "out")
    with np.load(tmp_path / "out" / truth.scene.id / "truth.npz") as arrays:
        for found in (seen, SimpleNamespace(eta=arrays["eta"], alpha=arrays["alpha"])):
            np.testing.assert_array_equal(found.eta, index)
            np.testing.assert_array_equal(found.alpha, rough)
