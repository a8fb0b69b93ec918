"""Maps, frames of a camera and s3 reach every form of a dataset that holds arrays."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rooms import needs_arrays
from runs import NOBODY, one_line, run_malus

import malus
from malus.bench.datasets.export import export
from malus.bench.datasets.export_networks import write_components
from malus.bench.datasets.render import render_dataset
from malus.reconstruct.photos.png16 import to_16bit
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant
from malus.scenes import InputError, Suite

BANDS = (450.0, 550.0, 650.0)
SUITE = Suite.parse(
    {
        "name": "mixed",
        "shapes": [{"kind": "sphere"}],
        "materials": ["pmma", "gold"],
        "surfaces": [{"alpha": 0.2, "albedo": 0.4}],
        "lights": [{"kind": "distant", "incidence_deg": 50, "polarised": {"angle_deg": 30}}],
        "wavelengths_nm": list(BANDS),
        "methods": ["unpolarised"],
        "camera": {"resolution": 16},
        "sampling": {"samples": 4, "seed": 1},
        "maps": ["depth", "object_id", "eta"],
        "sensor": {
            "bayer": "rggb",
            "sensitivities": "nikon-5100",
            "mosaic": [90, 45, 135, 0],
        },
    },
    "mixed",
)

FEW = {
    "name": "few",
    "renderer": "torrance-sparrow",
    "wavelengths_nm": [550],
    "methods": ["eq8"],
    "camera": {"resolution": 8},
    "random": {
        "count": 2,
        "seed": 1,
        "shapes": [{"kind": "sphere"}],
        "materials": [{"eta": {"uniform": [1.3, 1.7]}}],
        "surfaces": [{"alpha": 0.2, "albedo": 0.4}],
        "lights": [{"kind": "distant", "incidence_deg": 50}],
    },
}


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """A dielectric, and a metal under a polarised lamp, whose s3 is not zero."""
    folder = tmp_path_factory.mktemp("mixed")
    render_dataset(SUITE, folder)
    return open_folder(folder)


def expected_of(dataset: Dataset, scene: str) -> dict[str, np.ndarray]:
    truth, frame = dataset.truth(scene), dataset.frame(scene)
    maps = dataset.maps(scene)
    assert frame.stokes is not None
    return {
        **{str(name): maps[name] for name in ("depth", "object_id")},
        "eta": maps["eta"].astype(np.complex64),
        "s3": np.zeros_like(truth.image) if truth.s3 is None else truth.s3,
        "sensor": frame.stokes,
        "raw": np.moveaxis(frame.raw, 0, -1),
    }


@needs_arrays
@pytest.mark.parametrize("form", ["folders", "webdataset", "hdf5"])
def test_every_form_has_maps_frames_and_s3(mixed: Dataset, tmp_path: Path, form: str) -> None:
    """Of one type in all scenes, so that they fit into a batch: a metal's index is complex."""
    if form == "hdf5":
        pytest.importorskip("h5py", reason="h5py is not installed")
    folder = mixed.path
    if form != "folders":
        export(mixed, form, tmp_path)
        folder = tmp_path
    assert any(mixed.truth(scene).s3 is not None for scene in mixed.scenes)
    assert {str(mixed.maps(scene)["eta"].dtype) for scene in mixed.scenes} > {"float32"}
    samples = malus.open_dataset(folder, maps=("depth", "object_id", "eta", "s3", "sensor", "raw"))
    for sample, scene in zip(samples, mixed.scenes, strict=True):
        for name, expected in expected_of(mixed, scene).items():
            np.testing.assert_array_equal(sample[name], expected, err_msg=name)
            assert sample[name].dtype == expected.dtype, name


@needs_arrays
def test_numpy_keeps_maps_frames_and_s3(mixed: Dataset, tmp_path: Path) -> None:
    export(mixed, "numpy", tmp_path)
    for scene in mixed.scenes:
        truth, frame = mixed.truth(scene), mixed.frame(scene)
        with np.load(tmp_path / scene / "maps.npz", allow_pickle=False) as maps:
            for name, array in mixed.maps(scene).items():
                np.testing.assert_array_equal(maps[name], array)
                assert maps[name].dtype == array.dtype
        with np.load(tmp_path / scene / "sensor.npz", allow_pickle=False) as sensor:
            np.testing.assert_array_equal(sensor["raw"], frame.raw)
            np.testing.assert_array_equal(sensor["stokes"], frame.stokes)
            electrons = (sensor["raw"] - float(sensor["dark_level"])) / sensor["gain"]
            np.testing.assert_array_equal(electrons, frame.electrons)
        with np.load(tmp_path / scene / "truth.npz", allow_pickle=False) as arrays:
            assert ("s3_standard_error" in arrays) == (truth.s3 is not None)


@needs_arrays
def test_crops_of_a_raw_frame_begin_with_the_same_square(mixed: Dataset) -> None:
    """A crop at an odd pixel would have another mosaic, which nothing tells."""
    raw = mixed.frame(mixed.scenes[0]).raw[0]
    samples = malus.open_dataset(mixed.path, maps=("raw", "depth"), crop=6)
    corners = set()
    for epoch in range(12):
        samples.set_epoch(epoch)
        crop = samples[0]["raw"][..., 0]
        corners |= {
            (top, left)
            for top in range(11)
            for left in range(11)
            if np.array_equal(raw[top : top + 6, left : left + 6], crop)
        }
    assert len(corners) > 1
    assert all(top % 4 == left % 4 == 0 for top, left in corners)


@needs_arrays
def test_metadata_tell_a_raw_frame_from_an_image(mixed: Dataset) -> None:
    metadata = json.loads((mixed.path / "croissant.json").read_text("utf-8"))
    kinds = {entry["@id"]: entry["encodingFormat"] for entry in metadata["distribution"]}
    assert (kinds["raw.tiff"], kinds["sensor.exr"]) == ("image/tiff", "image/x-exr")


def test_maps_without_llvm_are_refused_before_anything_is_rendered(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="suite mixed, key maps: expected LLVM or CUDA"):
        render_dataset(SUITE, tmp_path / "out", Variant("scalar_spectral_polarized", "for a test"))
    assert not (tmp_path / "out").exists()


@needs_arrays
def test_one_name_and_all_names_of_maps(mixed: Dataset) -> None:
    assert set(malus.open_dataset(mixed.path, maps="depth")[0]) == {"scene", "depth"}
    everything = malus.open_dataset(mixed.path, maps="all")[0]
    assert {"stokes", "s3", "eta", "raw", "sensor"} < set(everything)


@needs_arrays
def test_the_fourth_component_is_a_picture(mixed: Dataset, tmp_path: Path) -> None:
    """`s3.png` is the truth's own s3, longest band first, not black."""
    import imagecodecs

    with_s3 = [mixed.truth(scene) for scene in mixed.scenes if mixed.truth(scene).s3 is not None]
    truth: Truth = with_s3[0]
    assert truth.s3 is not None
    values = np.where(truth.mask[..., None], truth.s3[..., ::-1], 0)
    write_components(tmp_path, "a", truth)
    picture = imagecodecs.png_decode((tmp_path / "a" / "s3.png").read_bytes())
    np.testing.assert_array_equal(
        picture, to_16bit((values - values.min()) / (values.max() - values.min()))
    )
    write_components(tmp_path, "b", replace(truth, s3=None))
    assert not imagecodecs.png_decode((tmp_path / "b" / "s3.png").read_bytes()).any()


@needs_arrays
@pytest.mark.parametrize("layout", ["neisf", "pol"])
def test_a_refused_dataset_leaves_no_folder(tmp_path: Path, layout: str) -> None:
    """Also where what is refused comes late."""
    suite = SUITE.model_copy(
        update={"wavelengths_nm": (*BANDS, 700.0), "sensor": None, "maps": ()},
    )
    render_dataset(suite, tmp_path / "four")
    four, out = str(tmp_path / "four"), str(tmp_path / "out")
    result = run_malus("export", four, "--format", layout, "--out", out)
    assert result.returncode == 2
    assert "1 or 3 bands" in one_line(result.stderr)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("layout", ["webdataset", "numpy", "neisf", "pol"])
def test_what_is_not_rendered_is_told(tmp_path: Path, layout: str) -> None:
    """An empty dataset is refused; one that lacks scenes says so."""
    few = Suite.parse(FEW, "few")
    render_dataset(few, tmp_path / "none", NOBODY, part="7/9")
    result = run_malus(
        "export", str(tmp_path / "none"), "--format", layout, "--out", str(tmp_path / "out")
    )
    assert result.returncode == 2
    assert "a dataset with scenes" in one_line(result.stderr)
    assert "`malus render` with the same suite and folder goes on" in one_line(result.stderr)
    assert not (tmp_path / "out").exists()
    for more in ([], ["--split", "test"]):
        scored = run_malus("score", str(tmp_path / "none"), "--method", "eq8", *more)
        assert "`malus render` with the same suite and folder goes on" in one_line(scored.stderr)
    with pytest.raises(InputError, match="`malus render` with the same suite and folder goes on"):
        malus.open_dataset(tmp_path / "none", maps="image")
    render_dataset(few, tmp_path / "half", NOBODY, part="1/2")
    if layout != "neisf":
        result = run_malus(
            "export", str(tmp_path / "half"), "--format", layout, "--out", str(tmp_path / "out")
        )
        assert result.returncode == 0
        assert "1 more of the suite are not rendered" in " ".join(result.stderr.split())


@needs_arrays
def test_shards_of_an_older_export_are_gone(mixed: Dataset, tmp_path: Path) -> None:
    """Readers that take every `.tar` of a folder would mix both; nor is an old index believed."""
    export(mixed, "webdataset", tmp_path)
    before = malus.open_dataset(tmp_path, maps=("stokes",))[0]["stokes"]
    (tmp_path / "malus-000007.tar").write_bytes(b"old")
    few = SUITE.model_copy(update={"materials": ("gold",), "maps": ()})
    render_dataset(few, tmp_path.with_name("few"))
    export(tmp_path.with_name("few"), "webdataset", tmp_path)
    assert [path.name for path in tmp_path.glob("*.tar")] == ["malus-000000.tar"]
    samples = malus.open_dataset(tmp_path, maps=("stokes",))
    expected = open_folder(tmp_path.with_name("few"))
    after = samples[0]["stokes"]
    np.testing.assert_array_equal(after, expected.truth(expected.scenes[0]).stokes)
    assert not np.array_equal(after, before)


@needs_arrays
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"crop": 4.5}, "1 to 16 pixels"),
        ({"crop": "8"}, "1 to 16 pixels"),
        ({"crop": True}, "1 to 16 pixels"),
        ({"seed": -1}, "0 or larger"),
    ],
)
def test_numbers_are_whole(mixed: Dataset, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        malus.open_dataset(mixed.path, maps="stokes", **options)  # type: ignore[arg-type]
