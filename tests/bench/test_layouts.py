"""Predictions in published layouts give back the Stokes images that they were made of."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import imagecodecs
import numpy as np
import OpenEXR
import pytest
from click.testing import CliRunner
from made_up import made_up_truth, stored
from pictures import save_16_bits
from runs import formula_dataset

from malus.bench.commands.score import score_command
from malus.bench.datasets.export import export
from malus.bench.datasets.export_views import pose
from malus.bench.datasets.layouts import LAYOUTS, layout_predictions
from malus.bench.datasets.predictions import PredictionErrors
from malus.bench.datasets.render import render_dataset
from malus.bench.datasets.score import score_dataset
from malus.renderers.datasets.dataset import Dataset, open_folder
from malus.renderers.truth import Truth
from malus.renderers.variant import Variant, choose
from malus.scenes import Camera, InputError, Sampling, load_suite

NOBODY = Variant("scalar_spectral_polarized", "not used")
SIDE = 14


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return formula_dataset(tmp_path_factory.mktemp("dataset"), SIDE)


def as_rgb2pol(folder: Path, name: str, truth: Truth) -> None:
    """Each component over its own range, black off the object; red is the third band."""
    for k in (1, 2):
        component = np.where(truth.mask[..., None], truth.stokes[..., k], 0)
        low, high = component.min(), component.max()
        save_16_bits(folder / name / f"s{k}.png", ((component - low) / (high - low))[..., ::-1])


def as_polaranything(folder: Path, name: str, truth: Truth) -> None:
    """Maps of one channel, of the first band."""
    s0, s1, s2 = np.moveaxis(truth.stokes[:, :, 0].astype(float), -1, 0)
    degree = np.hypot(s1, s2) / np.where(s0 > 0, s0, 1)
    angle = np.degrees(np.arctan2(s2, s1)) / 2
    save_16_bits(folder / "AoLP_16bit" / f"{name}.png", (angle + 90) / 180)
    save_16_bits(folder / "DoLP_16bit" / f"{name}.png", degree)


def as_pol(folder: Path, name: str, truth: Truth) -> None:
    """Malus' law, the angle from the horizontal; a camera's own scale."""
    stokes = truth.stokes.astype(float)
    scale = 0.9 / stokes[..., 0].max()
    for degrees in (0, 45, 90, 135):
        double = 2 * np.radians(degrees)
        seen = stokes[..., 0] + stokes[..., 1] * np.cos(double) + stokes[..., 2] * np.sin(double)
        save_16_bits(folder / f"pol{degrees:03}" / f"{name}.png", (scale * seen / 2)[..., ::-1])


WRITERS: dict[str, Callable[[Path, str, Truth], None]] = {
    "rgb2pol": as_rgb2pol,
    "polaranything": as_polaranything,
    "pol": as_pol,
}


@pytest.mark.parametrize("by_number", [False, True])
@pytest.mark.parametrize("layout", WRITERS)
def test_a_perfect_prediction_has_skill_one(
    dataset: Dataset, tmp_path: Path, layout: str, by_number: bool
) -> None:
    """16 bits leave 1e-5 of a component, far below what skill shows; a wrong angle would be −1."""
    for number, truth in enumerate(dataset.truths()):
        name = f"{number:04}" if by_number else truth.scene.id
        WRITERS[layout](tmp_path, name, truth)
    results = score_dataset(dataset, [], tmp_path, "mine", layout=layout)
    skill = results.headlines[results.headlines.metric == "skill"].value
    # PolarAnything's maps are of one band: the others of a dielectric differ by its dispersion.
    np.testing.assert_allclose(skill, 1.0, atol=2e-3 if layout == "polaranything" else 1e-5)
    assert results.run["predictions"]["suspicions"] == []


def test_light_off_the_object_does_not_decide_the_scale() -> None:
    truth = made_up_truth()
    assert 0 < truth.mask.sum() < truth.mask.size
    bright = np.where(truth.mask[..., None, None], truth.specular, 100 * truth.specular)
    codes = list(np.random.default_rng(1).random((2, *truth.image.shape)))
    plain, beside = (
        LAYOUTS["rgb2pol"].decode(codes, each)[..., 1:]
        for each in (truth, replace(truth, specular=bright))
    )
    assert np.array_equal(plain, beside)


@pytest.mark.parametrize("layout", WRITERS)
def test_an_export_is_read_back(dataset: Dataset, tmp_path: Path, layout: str) -> None:
    """What malus writes in a layout is a perfect prediction in it; its names are numbers."""
    export(dataset, layout, tmp_path)
    results = score_dataset(dataset, [], tmp_path, "mine", layout=layout)
    skill = results.headlines[results.headlines.metric == "skill"].value
    np.testing.assert_allclose(skill, 1.0, atol=2e-3 if layout == "polaranything" else 1e-5)
    names = json.loads((tmp_path / "names.json").read_text())
    assert list(names) == list(dataset.scenes)
    assert set(names.values()) == {f"{number:04}" for number in range(len(dataset))}


def test_an_export_has_its_signs(dataset: Dataset, tmp_path: Path) -> None:
    """Read by another library: S1 = I0 − I90 and S2 = I45 − I135, red the longest wavelength."""
    export(dataset, "pol", tmp_path)
    truth = next(dataset.truths())
    i0, i45, i90, i135 = (
        imagecodecs.png_decode((tmp_path / f"pol{a:03}" / "0000.png").read_bytes()) / 65535
        for a in (0, 45, 90, 135)
    )
    true = truth.stokes[:, :, ::-1] / truth.image[truth.mask].max()
    for difference, k in ((i0 - i90, 1), (i45 - i135, 2)):
        # Two roundings to 16 bits.
        np.testing.assert_allclose(difference[truth.mask], true[truth.mask][..., k], atol=2e-5)
    normals = imagecodecs.png_decode((tmp_path / "normal" / "0000.png").read_bytes()) / 65535
    np.testing.assert_allclose((2 * normals - 1)[truth.mask], truth.normals[truth.mask], atol=4e-5)


def test_problems_are_all_told(dataset: Dataset, tmp_path: Path) -> None:
    """A missing file and one of another size, before anything is scored."""
    for truth in dataset.truths():
        as_pol(tmp_path, truth.scene.id, truth)
    first, second = dataset.scenes[:2]
    (tmp_path / "pol045" / f"{first}.png").unlink()
    save_16_bits(tmp_path / "pol090" / f"{second}.png", np.zeros((SIDE, SIDE + 1, 3)))
    with pytest.raises(PredictionErrors) as caught:
        score_dataset(dataset, [], tmp_path, layout="pol")
    told = [str(problem) for problem in caught.value.problems]
    assert len(told) == 2
    assert f"pol045/{first}.png, found none" in told[0].replace("expected ", "", 1)
    assert f"found {SIDE + 1} × {SIDE}, 3 channels" in told[1]


def test_another_folder_is_refused(dataset: Dataset, tmp_path: Path) -> None:
    """One line that names a file of the layout."""
    with pytest.raises(InputError, match=r"expected AoLP_16bit/.*png or AoLP_16bit/0000\.png"):
        layout_predictions(dataset, tmp_path, "polaranything")


def test_the_command_scores_a_layout_with_a_profile(dataset: Dataset, tmp_path: Path) -> None:
    """From the command line: predictions, the guess beside them, the profile's metrics."""
    for truth in dataset.truths():
        as_rgb2pol(tmp_path / "in", truth.scene.id, truth)
    result = CliRunner().invoke(
        score_command,
        [str(dataset.path), "--predictions", str(tmp_path / "in"), "--layout", "rgb2pol",
         "--profile", "rgb2pol", "--out", str(tmp_path / "out"), "--json"],
        catch_exceptions=False,
    )  # fmt: skip
    assert result.exit_code == 0
    assert '"unpolarised"' in result.output
    assert (tmp_path / "out" / "results.csv").read_text().count('"rgb2pol_psnr",') == 2 * len(
        dataset
    )


def test_views_have_their_poses(tmp_path: Path) -> None:
    """A ray of each pose, as NeISF casts it, meets the point that the camera shows there."""
    suite = load_suite("quick").model_copy(
        update={
            "renderer": "torrance-sparrow",
            "lights": load_suite("quick").lights[1:],
            "bodies": ("unpolarised",),
            "camera": Camera(resolution=SIDE),
        }
    )
    camera = Camera(projection="perspective", fov_deg=40, distance=4, resolution=SIDE)
    for moved in (camera, camera.model_copy(update={"azimuth_deg": 70.0, "elevation_deg": 20.0})):
        row = pose(moved, scale=0.75)
        down, right, back, position, (height, width, focal) = row[:15].reshape(3, 5).T
        assert (height, width) == (SIDE, SIDE)
        assert np.linalg.norm(position) == pytest.approx(3.0)
        # As NeISF does: down, right, back become right, up, back, and rays count from the corner.
        axes = np.stack([right, -down, back], axis=1)
        point = np.array([0.2, -0.3, 0.1])
        inside = moved.extrinsics() @ [*point, 1.0]
        column, line, _ = (moved.intrinsics() @ inside) / inside[2]
        i, j = column + 0.5, line + 0.5  # from the picture's corner, where NeISF counts from
        ray = axes @ [(i - width / 2) / focal, -(j - height / 2) / focal, -1.0]
        towards = 0.75 * point - position
        np.testing.assert_allclose(ray / np.linalg.norm(ray), towards / np.linalg.norm(towards))
    render_dataset(suite, tmp_path / "flat", NOBODY)
    with pytest.raises(InputError, match="a perspective camera with an even number"):
        export(tmp_path / "flat", "neisf", tmp_path / "out")


@pytest.mark.parametrize(
    ("distances", "stored_as"), [((2.0, 2.0), (2.0, 2.0)), ((4.0, 4.0), (3, 3)), ((2, 4), (1.5, 3))]
)
def test_far_cameras_come_nearer_and_near_ones_stay(
    tmp_path: Path, distances: tuple[float, float], stored_as: tuple[float, float]
) -> None:
    """The world of an object shrinks into a ball of radius 3, and never grows."""
    truth, truths = made_up_truth(), []
    for azimuth, distance in zip((0.0, 70.0), distances, strict=True):
        camera = Camera(
            projection="perspective", fov_deg=40, distance=distance, resolution=6,
            azimuth_deg=azimuth,
        )  # fmt: skip
        scene = truth.scene.model_copy(update={"camera": camera})
        truths.append(replace(truth, scene=scene))
    export(stored(tmp_path / "views", *truths), "neisf", tmp_path / "out")
    (path,) = (tmp_path / "out").glob("*/poses_bounds.npy")
    positions = np.load(path)[:, :15].reshape(2, 3, 5)[:, :, 3]
    # Poses are rounded to 12 digits.
    assert sorted(np.linalg.norm(positions, axis=1)) == pytest.approx(stored_as, abs=1e-11)


def test_an_orbit_is_one_object(tmp_path: Path) -> None:
    """Two views of each object: Stokes images, masks and poses in its own folder."""
    variant = choose("auto")
    if not variant.vectorised:
        pytest.skip("needs LLVM or CUDA")
    suite = load_suite("orbit")
    small = suite.model_copy(
        update={
            "views": suite.views.model_copy(update={"count": 2}) if suite.views else None,
            "camera": suite.camera.model_copy(update={"resolution": 12}),
            "sampling": Sampling(samples=4),
        }
    )
    render_dataset(small, tmp_path / "orbit", variant)
    export(tmp_path / "orbit", "neisf", tmp_path / "out")
    folders = sorted(path for path in (tmp_path / "out").iterdir() if path.is_dir())
    assert len(folders) == len(small.lights)
    for folder in folders:
        assert np.load(folder / "poses_bounds.npy").shape == (2, 17)
        for name in ("images_s0", "images_s1", "images_s2"):
            assert sorted(p.name for p in (folder / name).iterdir()) == [
                "img_001.exr",
                "img_002.exr",
            ]
    red = [
        np.where(truth.mask, truth.stokes[:, :, 2, 1], 0)  # the band at 650 nm
        for truth in open_folder(tmp_path / "orbit").truths()
    ]
    for path in (tmp_path / "out").glob("*/images_s1/*.exr"):
        with OpenEXR.File(str(path), separate_channels=True) as file:
            stored = file.channels()["R"].pixels
        assert any(np.array_equal(stored, image) for image in red)


def test_views_grow_with_their_dataset_and_are_named(tmp_path: Path) -> None:
    """A dataset with more scenes was refused as another; no file told whose a picture was."""
    truths = []
    for seed, azimuth in ((0, 0.0), (1, 0.0), (0, 70.0)):  # two objects, the first seen twice
        truth = made_up_truth(seed)
        camera = Camera(
            projection="perspective", fov_deg=40, distance=2, resolution=6, azimuth_deg=azimuth
        )
        truths.append(replace(truth, scene=truth.scene.model_copy(update={"camera": camera})))
    export(stored(tmp_path / "few", *truths[:2]), "neisf", tmp_path / "out")
    assert export(stored(tmp_path / "all", *truths), "neisf", tmp_path / "out") == 3
    names = json.loads((tmp_path / "out" / "names.json").read_text("utf-8"))
    assert len(list((tmp_path / "out").glob("*/images_s2/*.exr"))) == 3
    assert {path.name for path in (tmp_path / "out").glob("*/")} == {
        name.split("/")[0] for name in names.values()
    }
    for truth in truths:
        name, picture = names[truth.scene.id].split("/")
        path = tmp_path / "out" / name / "images_s2" / f"{picture}.exr"
        with OpenEXR.File(str(path), separate_channels=True) as file:
            blue = file.channels()["B"].pixels
        np.testing.assert_array_equal(blue, np.where(truth.mask, truth.stokes[:, :, 0, 2], 0))
    with pytest.raises(InputError, match="found an export of 1 other scene; choose another"):
        export(tmp_path / "few", "neisf", tmp_path / "out")
