"""A dataset gives back what was put in, to the bit, and believes nobody."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from click.testing import CliRunner
from made_up import BANDS, made_up_truth

from malus.bench.commands.render import render_command
from malus.bench.datasets.render import render_dataset
from malus.renderers import Truth, render
from malus.renderers.datasets.dataset import open_dataset
from malus.renderers.datasets.dataset_files import with_own_files
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.datasets.planes import FIELDS, MAPS
from malus.renderers.datasets.scene_folder import IMAGES
from malus.renderers.datasets.spectral_exr import read_exr, write_exr
from malus.renderers.mitsuba.translate import tessellated
from malus.renderers.variant import Variant
from malus.scenes import Camera, InputError, load_suite
from malus.scenes.core.named_file import digest_of
from malus.scenes.lights.environment import radiance_map
from malus.scenes.lights.lights import Environment, turned
from malus.scenes.shapes.shapes import MeshFile

Damage = Callable[[Path], None]


def assert_same(found: Truth, expected: Truth) -> None:
    assert found.scene == expected.scene
    assert found.interpolation_error == expected.interpolation_error
    for name in (*FIELDS, *MAPS, "mask"):
        one, other = getattr(found, name), getattr(expected, name)
        if other is None:
            assert one is None, name
            continue
        assert (one.dtype, one.shape) == (other.dtype, other.shape), name
        # Bytes, not values: the sign of zero counts too.
        assert one.tobytes() == other.tobytes(), name


def stored(folder: Path, *truths: Truth) -> Path:
    with DatasetWriter(folder) as writer:
        for truth in truths:
            writer.add(truth)
    return folder


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_made_up_truths_come_back_to_the_bit(tmp_path: Path, dtype: type) -> None:
    truths = [made_up_truth(seed, dtype) for seed in range(3)]
    truths[0].specular[0, 0, 0, 1] = -0.0
    truths[0].specular[0, 1, 0, 1] = 1e-42 if dtype is np.float32 else 5e-324
    dataset = open_dataset(stored(tmp_path, *truths))
    assert set(dataset.scenes) == {truth.scene.id for truth in truths}
    for truth in truths:
        assert_same(dataset.truth(truth.scene.id), truth)
    assert len(list(dataset)) == len(dataset) == 3


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
    found = open_dataset(stored(tmp_path, mapped)).truth(truth.scene.id)
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
    assert_same(open_dataset(stored(tmp_path, truth)).truth(scene.id), truth)


def test_views_of_larger_arrays_are_stored_as_they_look(tmp_path: Path) -> None:
    """OpenEXR takes the buffer of a strided array as if it were dense."""
    truth = made_up_truth()
    flipped = dataclasses.replace(truth, specular=truth.specular[::-1, ::-1])
    assert_same(open_dataset(stored(tmp_path, flipped)).truth(truth.scene.id), flipped)


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
        open_dataset(tmp_path).truth(truth.scene.id)
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
        open_dataset(tmp_path).truth(truth.scene.id)


@pytest.mark.parametrize("name", ["../../etc", "/etc", "0123456789abcdef\n", "0123456789ABCDEF"])
def test_no_scene_leads_out_of_the_dataset(tmp_path: Path, name: str) -> None:
    stored(tmp_path, made_up_truth())
    edit_json(tmp_path / "dataset.json", lambda d: d["scenes"][0].update(scene=name))
    with pytest.raises(InputError, match=r"scenes\.0\.scene"):
        open_dataset(tmp_path)


def test_a_scene_of_another_name_is_refused(tmp_path: Path) -> None:
    one, other = made_up_truth(0), made_up_truth(1)
    stored(tmp_path, one, other)
    shutil.rmtree(tmp_path / one.scene.id)
    shutil.copytree(tmp_path / other.scene.id, tmp_path / one.scene.id)
    with pytest.raises(InputError, match=other.scene.id):
        open_dataset(tmp_path).truth(one.scene.id)
    with pytest.raises(InputError, match="expected one of the 2 scenes"):
        open_dataset(tmp_path).truth("0" * 16)


@pytest.mark.parametrize("text", ["", "[" * 100_000, "{}x", '{"scenes": [{"scene": 1}]}', "\xff"])
def test_json_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "dataset.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"dataset\.json"):
        open_dataset(tmp_path)


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, {"Y": np.zeros((4, 4), np.float32)})
    os.truncate(path, 1 << 30)  # sparse: takes no room
    with pytest.raises(InputError, match="at most"):
        read_exr(path, (4, 4), ["Y"])


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
    assert_same(open_dataset(tmp_path).truth(small.scene.id), small)


def test_a_failed_scene_leaves_nothing_behind(tmp_path: Path) -> None:
    good, bad = made_up_truth(0), made_up_truth(1)
    bad = dataclasses.replace(bad, interpolation_error={"rms": float("nan")})
    with DatasetWriter(tmp_path) as writer:
        writer.add(good)
        with pytest.raises(ValueError, match="JSON"):
            writer.add(bad)
    assert {path.name for path in tmp_path.iterdir()} == {good.scene.id, "dataset.json"}
    assert open_dataset(tmp_path).scenes == (good.scene.id,)


# --- render ---

SUITE = load_suite("quick").model_copy(
    update={
        "renderer": "torrance-sparrow",
        "lights": load_suite("quick").lights[1:],
        "bodies": ("unpolarised",),
        "camera": Camera(resolution=8),
    }
)
NOBODY = Variant("scalar_spectral_polarized", "not used")


def test_a_render_that_was_stopped_goes_on(tmp_path: Path) -> None:
    def stop(done: int, total: int, label: str) -> None:
        del total, label
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render_dataset(SUITE, tmp_path, NOBODY, progress=stop)
    assert len(open_dataset(tmp_path)) == 2
    assert open_dataset(tmp_path).record.planned == 4
    (tmp_path / ".part-nowhere-1-x").mkdir()  # of another machine: not ours to remove
    done = render_dataset(SUITE, tmp_path, NOBODY)
    assert (done["rendered"], done["taken_over"]) == (2, 2)
    again = render_dataset(SUITE, tmp_path, NOBODY)
    assert (again["rendered"], again["taken_over"]) == (0, 4)
    assert set(open_dataset(tmp_path).scenes) == {scene.id for scene in SUITE.scenes()}


def test_damaged_scenes_and_other_seeds_are_rendered_again(tmp_path: Path) -> None:
    render_dataset(SUITE, tmp_path, NOBODY)
    first, second, *_ = open_dataset(tmp_path).scenes
    cut(tmp_path / first / "error.exr")
    (tmp_path / second / "scene.json").write_text("{", "utf-8")
    assert render_dataset(SUITE, tmp_path, NOBODY)["rendered"] == 2
    reseeded = SUITE.model_copy(update={"sampling": SUITE.sampling.model_copy(update={"seed": 9})})
    assert render_dataset(reseeded, tmp_path, NOBODY)["rendered"] == 4
    assert len(list(open_dataset(tmp_path))) == 4
    assert not list(tmp_path.glob(".*"))


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
    dataset = open_dataset(tmp_path)
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
    dataset = open_dataset(tmp_path)
    assert dataset.record.variant["name"].endswith("_polarized")
    truth = dataset.truth(dataset.scenes[0])
    assert truth.mask.any()
    assert truth.standard_error[truth.mask].any()
    # Two indices are rendered themselves: nothing is interpolated.
    assert truth.interpolation_error == {"rms": 0.0, "worst": 0.0}


# --- files that a scene names ---


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
    named = light.model_copy(update={"name": name.format(outside=tmp_path / "a.exr")})
    evil = dataclasses.replace(truth, scene=truth.scene.model_copy(update={"light": named}))
    stored(tmp_path / "evil", evil)
    shutil.rmtree(tmp_path / "evil" / "maps")
    radiance_map.cache_clear()
    with pytest.raises(InputError, match=r"evil/maps/[0-9a-f]{16}\.exr: expected a readable"):
        radiance_map(light_of(tmp_path / "evil", evil))


@pytest.mark.parametrize("digest", ["../../../../a", "", "0123456789ABCDEF"])
def test_a_digest_leads_out_of_no_dataset(tmp_path: Path, digest: str) -> None:
    light = Environment(name="/etc/passwd", digest=digest)
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
