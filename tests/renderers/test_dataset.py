"""A dataset gives back what was put in, to the bit, and keeps what is whole when writing stops."""

from __future__ import annotations

import dataclasses
import json
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from click.testing import CliRunner
from made_up import BANDS, made_up_truth, stored
from runs import NOBODY, SUITE, one_line, run_malus

from malus.bench.commands.render import render_command
from malus.bench.datasets.render import render_dataset
from malus.renderers import Truth, render
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.datasets.planes import FIELDS, MAPS, S3, S3_ERRORS
from malus.renderers.datasets.spectral_exr import read_spectral, write_exr
from malus.scenes import Camera, InputError, Suite
from malus.scenes.core.remote import as_path


def assert_same(found: Truth, expected: Truth) -> None:
    assert found.scene == expected.scene
    assert found.interpolation_error == expected.interpolation_error
    for name in (*FIELDS, *MAPS, S3, *S3_ERRORS, "mask"):
        one, other = getattr(found, name), getattr(expected, name)
        if other is None:
            assert one is None, name
            continue
        assert (one.dtype, one.shape) == (other.dtype, other.shape), name
        # Bytes, not values: the sign of zero counts too.
        assert one.tobytes() == other.tobytes(), name


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_made_up_truths_come_back_to_the_bit(tmp_path: Path, dtype: type) -> None:
    truths = [made_up_truth(seed, dtype) for seed in range(3)]
    truths[0].specular[0, 0, 0, 1] = -0.0
    truths[0].specular[0, 1, 0, 1] = 1e-42 if dtype is np.float32 else 5e-324
    dataset = open_folder(stored(tmp_path, *truths))
    assert set(dataset.scenes) == {truth.scene.id for truth in truths}
    for truth in truths:
        assert_same(dataset.truth(truth.scene.id), truth)
    assert len(list(dataset)) == len(dataset) == 3


def test_the_fourth_component_comes_back_to_the_bit(tmp_path: Path) -> None:
    truth, random = made_up_truth(), np.random.default_rng(4)
    images = (random.normal(size=truth.image.shape).astype(np.float32) for _ in range(3))
    whole = dataclasses.replace(truth, **dict(zip((S3, *S3_ERRORS), images, strict=True)))
    folder = stored(tmp_path, whole)
    assert_same(open_folder(folder).truth(truth.scene.id), whole)
    # In files that others read, it is that of the whole light and of the specular lobe.
    for name, expected in (("stokes", whole.s3), ("specular", whole.s3), ("diffuse", 0 * whole.s3)):
        path = folder / truth.scene.id / f"{name}.exr"
        four = read_spectral(path, truth.mask.shape, BANDS, components=4)
        np.testing.assert_array_equal(four[..., 3], expected)


@pytest.mark.parametrize("index", [np.float32, np.float64, np.complex64, np.complex128])
@pytest.mark.parametrize("rough", [np.float32, np.float64])
def test_maps_of_the_material_come_back_to_the_bit(
    tmp_path: Path, index: type, rough: type
) -> None:
    truth = made_up_truth()
    shape = truth.specular.shape[:3]
    eta = (np.random.default_rng(2).random(shape) + 1j * np.random.default_rng(3).random(shape)) / 3
    eta_map = eta.astype(index) if np.issubdtype(index, np.complexfloating) else eta.real
    mapped = dataclasses.replace(
        truth,
        eta_map=eta_map.astype(index),
        alpha_map=(np.random.default_rng(4).random(shape[:2]) / 3).astype(rough),
    )
    assert mapped.eta is mapped.eta_map
    assert mapped.alpha is mapped.alpha_map
    found = open_folder(stored(tmp_path, mapped)).truth(truth.scene.id)
    assert_same(found, mapped)
    for half in found.halves():
        assert half.eta is found.eta
        assert half.alpha is found.alpha


def test_a_map_of_another_shape_is_not_stored(tmp_path: Path) -> None:
    truth = dataclasses.replace(made_up_truth(), alpha_map=np.zeros((2, 3), np.float32))
    with pytest.raises(ValueError, match="alpha_map: expected floats"):
        stored(tmp_path, truth)


@pytest.mark.parametrize("renderer", ["mitsuba", "torrance-sparrow"])
def test_renders_come_back_to_the_bit(tmp_path: Path, renderer: str) -> None:
    scene = made_up_truth().scene
    surface = scene.surface.model_copy(update={"body": "unpolarised"})
    scene = scene.model_copy(update={"surface": surface, "camera": Camera(resolution=10)})
    truth = render(scene, renderer=renderer)
    assert_same(open_folder(stored(tmp_path, truth)).truth(scene.id), truth)


def test_views_of_larger_arrays_are_stored_as_they_look(tmp_path: Path) -> None:
    """OpenEXR takes the buffer of a strided array as if it were dense."""
    truth = made_up_truth()
    flipped = dataclasses.replace(truth, specular=truth.specular[::-1, ::-1])
    assert_same(open_folder(stored(tmp_path, flipped)).truth(truth.scene.id), flipped)


def test_stokes_images_have_the_layout_of_the_paper(tmp_path: Path) -> None:
    """Channel names and attributes of JCGT 10(3) 2021, read with OpenEXR alone."""
    truth = made_up_truth()
    folder = stored(tmp_path, truth) / truth.scene.id
    for name, image in (("stokes", truth.stokes), ("specular", truth.specular)):
        file = OpenEXR.File(str(folder / f"{name}.exr"), separate_channels=True)
        header, channels = file.header(), file.channels()
        assert header["spectralLayoutVersion"] == "1.0"
        assert header["emissiveUnits"] == "W.m^-2.sr^-1"
        assert header["polarisationHandedness"] in ("left", "right")
        assert header["compression"] == OpenEXR.ZIP_COMPRESSION
        wavelengths = ("450,000000", "532,123457", "650,000000")
        spectral = {f"S{i}.{nm}nm" for i in range(4) for nm in wavelengths}
        assert set(channels) == spectral | {"R", "G", "B"}
        assert {channel.pixels.dtype for channel in channels.values()} == {np.dtype("float32")}
        np.testing.assert_array_equal(channels["S1.532,123457nm"].pixels, image[:, :, 1, 1])
        np.testing.assert_array_equal(channels["S2.650,000000nm"].pixels, image[:, :, 2, 2])
        assert not channels["S3.650,000000nm"].pixels.any()


def test_colour_science_reads_the_channel_names(tmp_path: Path) -> None:
    """A parser of the layout that nobody here wrote."""
    from colour.io.fichet2021 import PATTERN_FICHET2021, match_groups_to_nm

    truth = made_up_truth()
    path = stored(tmp_path, truth) / truth.scene.id / "stokes.exr"
    names = OpenEXR.File(str(path), separate_channels=True).channels()
    matches = [
        re.match(rf"^(S[0-3])\.*{PATTERN_FICHET2021}$", name) for name in names if name not in "RGB"
    ]
    found = {round(match_groups_to_nm(*m.group(2, 4, 5)), 6) for m in matches if m}
    assert all(matches)
    assert found == {round(nm, 6) for nm in BANDS}


def test_previews_are_grey_for_a_flat_spectrum_and_coloured_for_a_band(tmp_path: Path) -> None:
    truth = made_up_truth()
    image = np.zeros_like(truth.specular)
    image[:3, ..., 0] = 0.5  # flat
    image[3:, :, 0, 0] = 0.5  # only 450 nm
    lobe = dataclasses.replace(truth, specular=image)
    path = stored(tmp_path, lobe) / truth.scene.id / "specular.exr"
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    red, green, blue = (channels[name].pixels for name in "RGB")
    for colour in (red, green, blue):
        # The equal-energy white as tabulated has four digits.
        np.testing.assert_allclose(colour[:3], 0.5, atol=1e-3)
    assert np.all(blue[3:] > red[3:])
    assert np.all(blue[3:] > green[3:])


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        write_exr(tmp_path / "missing" / "a.exr", {"Y": np.zeros((4, 4), np.float32)})


def test_no_room_is_told_and_leaves_what_is_whole(tmp_path: Path) -> None:
    """A limit on the size of a file stands for a full disk: both cut a write short."""
    small, large = made_up_truth(0), made_up_truth(1, side=96)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with DatasetWriter(tmp_path) as writer:
        writer.add(small)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
        try:
            with pytest.raises(InputError, match="File too large"):
                writer.add(large)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert {path.name for path in tmp_path.iterdir()} == {small.scene.id, "dataset.json"}
    assert_same(open_folder(tmp_path).truth(small.scene.id), small)


def test_a_failed_scene_leaves_nothing_behind(tmp_path: Path) -> None:
    good, bad = made_up_truth(0), made_up_truth(1)
    bad = dataclasses.replace(bad, interpolation_error={"rms": float("nan")})
    with DatasetWriter(tmp_path) as writer:
        writer.add(good)
        with pytest.raises(ValueError, match="JSON"):
            writer.add(bad)
    assert {path.name for path in tmp_path.iterdir()} == {good.scene.id, "dataset.json"}
    assert open_folder(tmp_path).scenes == (good.scene.id,)


def test_a_render_that_was_stopped_goes_on(tmp_path: Path) -> None:
    def stop(done: int, total: int, label: str) -> None:
        del total, label
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_dataset(SUITE, tmp_path, NOBODY, progress=stop)
    assert len(open_folder(tmp_path)) == 2
    assert open_folder(tmp_path).record.planned == 4
    (tmp_path / ".part-nowhere-1-x").mkdir()  # of another machine: not ours to remove
    done = render_dataset(SUITE, tmp_path, NOBODY)
    assert (done["rendered"], done["taken_over"]) == (2, 2)
    again = render_dataset(SUITE, tmp_path, NOBODY)
    assert (again["rendered"], again["taken_over"]) == (0, 4)
    assert set(open_folder(tmp_path).scenes) == {scene.id for scene in SUITE.scenes()}


def sampled(**changes: int) -> Suite:
    return SUITE.model_copy(update={"sampling": SUITE.sampling.model_copy(update=changes)})


@pytest.mark.parametrize("kept", ["here", "store"])
@pytest.mark.parametrize(
    "other",
    [
        sampled(samples=2),
        sampled(seed=9),
        SUITE.model_copy(update={"camera": Camera(resolution=12)}),
        SUITE.model_copy(update={"materials": SUITE.materials[1:]}),
    ],
    ids=["samples", "seed", "size", "fewer scenes"],
)
def test_a_dataset_is_not_replaced_by_another(tmp_path: Path, kept: str, other: Suite) -> None:
    """All truths were overwritten, or left as folders that nothing lists."""
    folder = as_path(tmp_path if kept == "here" else f"memory://{tmp_path.name}")
    render_dataset(SUITE, folder, NOBODY)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(InputError, match="found 8² pixels, 32 samples, seed 1, suite quick"):
        render_dataset(other, folder, NOBODY)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_more_scenes_are_added_to_a_dataset(tmp_path: Path) -> None:
    few = SUITE.model_copy(update={"surfaces": SUITE.surfaces[1:], "methods": ("eq8",)})
    render_dataset(few, tmp_path, NOBODY)
    done = render_dataset(SUITE, tmp_path, NOBODY)
    assert (done["rendered"], done["taken_over"]) == (2, 2)


@pytest.mark.parametrize("parts", [(None,), ("1/2", "2/2")])
def test_another_version_renders_anew_and_stopped_leaves_the_old(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, parts: tuple[str | None, ...]
) -> None:
    """Stopped before its first scene, it left a dataset of none."""

    def stop(done: int, total: int, label: str) -> None:
        raise KeyboardInterrupt

    render_dataset(SUITE, tmp_path, NOBODY)
    monkeypatch.setattr("malus.bench.datasets.planned.made_by", lambda _: "malus of tomorrow")
    if parts == (None,):
        before = open_folder(tmp_path).record
        with pytest.raises(KeyboardInterrupt):
            render_dataset(SUITE, tmp_path, NOBODY, progress=stop)
        assert open_folder(tmp_path).record == before
        assert len(list(open_folder(tmp_path))) == 4
    done = [render_dataset(SUITE, tmp_path, NOBODY, part=part) for part in parts]
    assert sum(each["rendered"] for each in done) == 4
    assert len(list(open_folder(tmp_path))) == 4


def test_a_kill_leaves_nothing_that_lasts(tmp_path: Path) -> None:
    script = (
        "import sys; sys.path[:0] = [sys.argv[2]]\n"
        "from made_up import made_up_truth\n"
        "from malus.renderers.datasets.dataset_writer import DatasetWriter\n"
        "with DatasetWriter(sys.argv[1]) as writer:\n"
        "    for seed in range(10**6): writer.add(made_up_truth(seed % 600, side=48))\n"
    )
    arguments = [sys.executable, "-c", script, str(tmp_path), str(Path(__file__).parents[1])]
    process = subprocess.Popen(arguments)
    while not list(tmp_path.glob("[0-9a-f]*/scene.json")):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    # What it was writing, also where the signal came between two scenes.
    (tmp_path / f".part-{socket.gethostname()}-{process.pid}-left").mkdir()
    with DatasetWriter(tmp_path):
        pass
    assert not list(tmp_path.glob(".*"))
    dataset = open_folder(tmp_path)
    assert len(list(dataset)) == len(dataset) >= 1


def test_the_command_renders_with_mitsuba_and_takes_over(tmp_path: Path) -> None:
    arguments = ["quick", "--resolution", "8", "--samples", "2", "--out", str(tmp_path), "--json"]
    counts = []
    for _ in range(2):
        done = CliRunner().invoke(render_command, arguments, catch_exceptions=False)
        assert done.exit_code == 0
        counts.append(json.loads(done.stdout))
    assert [count["rendered"] for count in counts] == [16, 0]
    assert counts[0]["bytes"] > 0
    other = run_malus("render", *arguments[:3], "--samples", "4", "--out", str(tmp_path))
    assert other.returncode == 2
    assert "suite quick; choose another --out, or delete that folder" in one_line(other.stderr)
    dataset = open_folder(tmp_path)
    assert dataset.record.variant["name"].endswith("_polarized")
    truth = dataset.truth(dataset.scenes[0])
    assert truth.mask.any()
    assert truth.standard_error[truth.mask].any()
    # Two indices are rendered themselves: nothing is interpolated.
    assert truth.interpolation_error == {"rms": 0.0, "worst": 0.0}
