"""Datasets with maps and a polarisation camera: what is written comes back, and is scored."""

from __future__ import annotations

import json
import tarfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile
from made_up import BANDS, made_up_truth
from rooms import needs_arrays
from runs import NOBODY, SUITE, run_malus

from malus.bench.datasets.export import export
from malus.bench.datasets.maps_and_frames import Additions, seed_of, sensor_truth, well_lit
from malus.bench.datasets.render import render_dataset
from malus.bench.datasets.score import score_dataset
from malus.bench.public.suites import dataset_bytes
from malus.bench.running.plan import plan
from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.capture_fit import fit_capture
from malus.reconstruct.photos.sensor_stokes import demosaiced_stokes
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.dataset_record import CONVENTIONS
from malus.renderers.datasets.sensor_files import SensorRecord, read_frame
from malus.renderers.mitsuba.surface_maps import render_maps
from malus.renderers.variant import choose
from malus.scenes import Camera, InputError
from malus.scenes.maps import MAPS
from malus.scenes.polarisation import dolp
from malus.scenes.sensor import SensitivityFile, Sensor
from malus.scenes.sensor_frame import SensorFrame, expose
from malus.scenes.suite import Suite

SENSOR = Sensor(preset="imx250mzr", extinction_ratio=300.0)
PERFECT = Sensor(full_well=1e9, bit_depth=16, fill=0.9)
COLOUR = Sensor(bayer="rggb", sensitivities="nikon-5100", full_well=1e9, bit_depth=16)


def with_sensor(sensor: Sensor, resolution: int = 24) -> Suite:
    return SUITE.model_copy(
        update={"sensor": sensor, "camera": Camera(resolution=resolution), "maps": ()}
    )


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_without_them_a_dataset_is_what_it_was(tmp_path: Path) -> None:
    render_dataset(SUITE, tmp_path, NOBODY)
    dataset = open_folder(tmp_path)
    assert dataset.record.conventions == CONVENTIONS
    first = tmp_path / dataset.scenes[0]
    record = json.loads((first / "scene.json").read_text("utf-8"))
    assert not {"maps", "sensor"} & record.keys()
    assert not {"maps.exr", "raw.tiff", "sensor.exr"} & files(first)
    assert dataset.maps(dataset.scenes[0]) == {}
    with pytest.raises(InputError, match="expected depth, found none"):
        dataset.maps(dataset.scenes[0], ["depth"])
    with pytest.raises(InputError, match=r"add \[sensor\] to the suite"):
        dataset.frame(dataset.scenes[0])
    with pytest.raises(InputError, match="expected a dataset with frames of a sensor"):
        score_dataset(dataset, ["sensor"])


@needs_arrays
def test_maps_come_back_to_the_bit(tmp_path: Path) -> None:
    suite = with_sensor(SENSOR, 12).model_copy(update={"maps": tuple(MAPS)})
    render_dataset(suite, tmp_path)
    dataset = open_folder(tmp_path)
    for truth in dataset.truths():
        stored = dataset.maps(truth.scene.id)
        assert list(stored) == list(MAPS)
        for name, values in render_maps(truth.scene, tuple(MAPS), choose()).items():
            assert stored[name].dtype == values.dtype
            assert stored[name].tobytes() == values.tobytes(), name
        some = dataset.maps(truth.scene.id, ["uv", "depth"])
        assert list(some) == ["uv", "depth"]
    assert "plane through the origin" in dataset.record.conventions["map depth"]
    (tmp_path / dataset.scenes[0] / "maps.exr").write_bytes(b"")
    with pytest.raises(InputError, match=r"maps.exr"):
        dataset.maps(dataset.scenes[0])


@pytest.mark.parametrize("sensor", [SENSOR, COLOUR], ids=["bands", "bayer"])
def test_frames_follow_from_scene_and_seed_alone(tmp_path: Path, sensor: Sensor) -> None:
    """Whatever was rendered before: the truth and its id are enough to take the frame again."""
    suite = with_sensor(sensor)
    render_dataset(suite, tmp_path, NOBODY)
    dataset = open_folder(tmp_path)
    for truth in dataset.truths():
        frame = dataset.frame(truth.scene.id)
        seed = (suite.sampling.seed, seed_of(truth.scene))
        again = expose(truth.stokes, sensor, truth.scene.wavelengths_nm, seed)
        assert frame.sensor == sensor
        assert frame.raw.dtype == np.uint16
        assert np.array_equal(frame.raw, again.raw)
        assert frame.exposure == again.exposure
        assert frame.channels == again.channels
        assert np.array_equal(frame.stokes, demosaiced_stokes(again))


def test_the_gain_of_a_frame_is_stored(tmp_path: Path) -> None:
    """Without it the words on how to get electrons from numbers name what no file has."""
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    render_dataset(with_sensor(SENSOR), tmp_path / "dataset", NOBODY)
    dataset = open_folder(tmp_path / "dataset")
    scene = dataset.scenes[0]
    path = tmp_path / "dataset" / scene / "scene.json"
    record = json.loads(path.read_text("utf-8"))
    assert record["sensor"]["gain"] == SENSOR.digital_gain
    for layout in ("webdataset", "hdf5"):
        export(dataset, layout, tmp_path / layout)
    with tarfile.open(next((tmp_path / "webdataset").glob("*.tar"))) as shard:
        content = shard.extractfile(f"{scene}.scene.json")
        assert content is not None
        assert json.load(content)["sensor"]["gain"] == SENSOR.digital_gain
    with h5py.File(next((tmp_path / "hdf5").glob("*.h5"))) as file:
        words = json.loads(file["scene_json"][0])
        assert words["sensor"]["gain"] == SENSOR.digital_gain
    del record["sensor"]["gain"]  # as earlier versions wrote it
    assert SensorRecord.parse(record["sensor"], "scene.json").gain == SENSOR.digital_gain
    with pytest.raises(InputError, match="the gain of the sensor"):
        SensorRecord.parse(record["sensor"] | {"gain": 1.0}, "scene.json")


def test_a_sensor_can_be_added_but_not_replaced(tmp_path: Path) -> None:
    assert render_dataset(SUITE, tmp_path, NOBODY)["rendered"] == 4
    suite = with_sensor(SENSOR, SUITE.camera.resolution)
    assert render_dataset(suite, tmp_path, NOBODY)["rendered"] == 4
    assert render_dataset(suite, tmp_path, NOBODY)["rendered"] == 0
    (tmp_path / open_folder(tmp_path).scenes[0] / "raw.tiff").unlink()
    assert render_dataset(suite, tmp_path, NOBODY)["rendered"] == 1
    noisy = with_sensor(SENSOR.model_copy(update={"read_noise": 9.0}), SUITE.camera.resolution)
    for lacking in (noisy, SUITE):  # the frames that are there would be lost
        with pytest.raises(InputError, match="expected a new folder, or a dataset of the same"):
            render_dataset(lacking, tmp_path, NOBODY)
    assert render_dataset(suite, tmp_path, NOBODY)["rendered"] == 0


def test_a_frame_that_is_not_what_its_record_says_is_refused(tmp_path: Path) -> None:
    render_dataset(with_sensor(SENSOR, 12), tmp_path, NOBODY)
    dataset = open_folder(tmp_path)
    one, other, *_ = dataset.scenes
    (tmp_path / one / "raw.tiff").write_bytes((tmp_path / other / "raw.tiff").read_bytes())
    with pytest.raises(InputError, match=r"raw.tiff"):
        dataset.frame(one)
    # Whoever writes a dataset can write hashes that fit.
    record = dataset.scene(one)
    good = tifffile.imread(tmp_path / other / "raw.tiff")
    wrong: list[tuple[np.ndarray, dict[str, object]]] = [
        (good[:2], {}),
        (good[:, :11], {}),
        (good.astype(np.uint8), {}),
        (good, {"compression": "deflate"}),
    ]
    for frames, options in wrong:
        raw = tmp_path / one / "raw.tiff"
        tifffile.imwrite(raw, frames, photometric="minisblack", metadata=None, **options)
        with pytest.raises(InputError, match="expected 3 uncompressed frames"):
            read_frame(tmp_path / one, record.sensor, record.shape)
    for content in (b"", b"II*\0", good.tobytes()):
        raw.write_bytes(content)
        with pytest.raises(InputError, match="expected a TIFF file of 16-bit frames"):
            read_frame(tmp_path / one, record.sensor, record.shape)
    raw.write_bytes((tmp_path / other / "raw.tiff").read_bytes()[:800])
    with pytest.raises(InputError, match="expected 3 uncompressed frames"):
        read_frame(tmp_path / one, record.sensor, record.shape)


def test_a_file_of_sensitivities_is_not_looked_for_by_readers(tmp_path: Path) -> None:
    """What a dataset from elsewhere names is not opened; the record has the channels."""
    curves = tmp_path / "curves.csv"
    curves.write_text("nm,all\n400,1\n700,2\n", "utf-8")
    sensor = Sensor(sensitivities=SensitivityFile(path=str(curves)))
    render_dataset(with_sensor(sensor, 12), tmp_path / "dataset", NOBODY)
    curves.unlink()
    dataset = open_folder(tmp_path / "dataset")
    frame = dataset.frame(dataset.scenes[0])
    assert len(frame.channels.wavelengths_nm) == 1
    assert score_dataset(dataset, ["sensor"]).table.method.unique() == ["sensor"]


def test_the_sensor_is_scored_as_a_method(tmp_path: Path) -> None:
    """A nearly perfect one costs what demosaicing does, less the finer the picture is."""
    scores = {}
    noisy = Sensor(full_well=200, read_noise=5.0)
    for name, sensor, side in (("rough", PERFECT, 48), ("fine", PERFECT, 144), ("dim", noisy, 144)):
        render_dataset(with_sensor(sensor, side), tmp_path / name, NOBODY)
        table = score_dataset(tmp_path / name, ["unpolarised", "sensor"]).table
        assert set(table.method) == {"unpolarised", "sensor"}
        whole = table[(table.method == "sensor") & table.band_nm.isna() & table.angle_deg.isna()]
        scores[name] = whole.groupby("metric").value.mean()
    for metric in ("nmse", "dolp_mae", "aolp_mae_deg", "s1_rmse", "s2_rmse"):
        # Errors stand along outlines, whose share of the pixels falls with the side: 1/3, and a
        # root of a mean of squares with the root of it, 0.58.
        assert scores["fine"][metric] < 0.75 * scores["rough"][metric], metric
        assert scores["fine"][metric] < 0.5 * scores["dim"][metric], metric


def test_the_scored_truth_is_in_the_sensors_channels(tmp_path: Path) -> None:
    render_dataset(with_sensor(COLOUR), tmp_path, NOBODY)
    dataset = open_folder(tmp_path)
    truth = next(dataset.truths())
    frame = dataset.frame(truth.scene.id)
    ideal = sensor_truth(truth, frame)
    weights = np.array(frame.channels.weights)
    for channel in range(3):
        expected = sum(weights[channel, b] * truth.stokes[:, :, b] for b in range(3))
        # Sums of three in another order, in double precision.
        assert ideal.stokes[:, :, channel] == pytest.approx(expected, rel=1e-12, abs=1e-15)
    table = score_dataset(dataset, ["sensor"]).table
    assert set(table.band_nm.dropna()) == set(frame.channels.wavelengths_nm)


def test_the_raw_frame_is_read_as_that_of_a_camera(tmp_path: Path) -> None:
    """`malus capture` knows nothing of datasets, and sees the same degree of polarisation."""
    suite = with_sensor(PERFECT, 48).model_copy(update={"wavelengths_nm": (550.0,)})
    render_dataset(suite, tmp_path, NOBODY)
    dataset = open_folder(tmp_path)
    truth = next(dataset.truths())
    raw = tmp_path / truth.scene.id / "raw.tiff"
    fit = fit_capture(read_capture(raw, mosaic=(90, 45, 135, 0), linear=True))
    stokes = dataset.frame(truth.scene.id).stokes[:, :, 0]
    bright = truth.mask & (stokes[..., 0] > 0.1 * stokes[..., 0].max())
    assert dolp(fit.stokes[:, :, 0])[bright] == pytest.approx(dolp(stokes)[bright], abs=1e-3)


def test_pixels_with_a_hundredth_of_the_well_in_every_channel_are_scored() -> None:
    """A polariser passes half of light that is not polarised: 10 electrons of 1000 are of 20."""
    truth = made_up_truth(side=4)
    sensor = Sensor(full_well=1000.0)
    channels = sensor.channels(BANDS)
    frame = SensorFrame(sensor, np.zeros((3, 4, 4), np.uint16), exposure=2.0, channels=channels)
    light = np.zeros_like(truth.specular)
    light[0, 0, :, 0] = 0.5 * 20.1  # the light of 20.1 electrons, at 2 electrons a unit
    light[0, 1, :, 0] = 0.5 * 19.9
    light[0, 2, 0, 0] = 100.0
    light[0, 3, :, 0] = [100.0, 100.0, 0.5 * 19.9]
    ideal = replace(truth, specular=light, diffuse=np.zeros_like(light))
    assert np.argwhere(well_lit(ideal, frame)).tolist() == [[0, 0]]


def test_a_plan_tells_what_is_left_out() -> None:
    bare, full = SUITE, with_sensor(SENSOR, SUITE.camera.resolution)
    full = full.model_copy(update={"maps": ("depth", "albedo")})
    pixels = 4 * SUITE.camera.resolution**2  # of four scenes
    bands = len(SUITE.wavelengths_nm)
    assert Additions.of(bare).label == "no maps and no frames of a sensor: the suite asks for none"
    assert Additions.of(full).label == "maps (depth, albedo) and frames of a sensor"
    more = dataset_bytes(full, plan(full)) - dataset_bytes(bare, plan(bare))
    # Depth, albedo of all bands, three Stokes components and the raw frame of all bands.
    assert more == pixels * 4 * (1 + bands + 4 * bands)
    camera = SUITE.camera.model_copy(update={"resolution": 3 * SUITE.camera.resolution})
    larger = SUITE.model_copy(update={"camera": camera})
    assert dataset_bytes(larger, plan(larger)) == 9 * dataset_bytes(bare, plan(bare))


def test_the_command_lists_maps_and_sensors() -> None:
    for what, names in (("maps", MAPS), ("sensors", ("imx250mzr", "imx250myr"))):
        done = run_malus("list", what)
        assert done.returncode == 0
        assert all(name[:8] in done.stdout for name in names)
