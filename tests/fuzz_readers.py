"""Every reader of malus, with a small valid file to begin from: material for fuzzing.

A reader gets a folder and the content of one file; it has to take it or to raise an InputError.
"""

from __future__ import annotations

import functools
import io
import json
import shutil
import struct
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from made_up import BANDS, made_up_truth, tensor_file, tiny_pbrdf

from malus.bench import read_results
from malus.bench.datasets.predictions import find_predictions
from malus.bench.gates.baseline import (
    DEFAULT_RULES,
    Baseline,
    RunIdentity,
    read_baseline,
    write_baseline,
)
from malus.bench.running.parts import Parts
from malus.bench.running.status import status
from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.masks_and_normals import read_normals
from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.read_picture import read_picture
from malus.reconstruct.photos.tone_curves import linear_transfer, power_transfer
from malus.reconstruct.photos.write_picture import write_picture
from malus.renderers.datasets.dataset import open_dataset
from malus.renderers.datasets.dataset_writer import DatasetWriter
from malus.renderers.datasets.scene_folder import read_record
from malus.renderers.datasets.spectral_exr import read_spectral, write_exr, write_spectral
from malus.reports.tables import sample
from malus.reports.viewer.examples import read_example
from malus.scenes import load_suite
from malus.scenes.lights.environment import radiance_map
from malus.scenes.lights.lights import Environment
from malus.scenes.materials.measured import open_pbrdf
from malus.scenes.shapes.meshes import load_mesh
from malus.scenes.shapes.patterns import ImageTexture

SIDE = 6
TRUTH = made_up_truth(side=SIDE)


@dataclass(frozen=True)
class Reader:
    """A function of a folder and the content of a file, and a valid content."""

    read: Callable[[Path, bytes], object]
    valid: Callable[[], bytes]


def of_file(name: str, read: Callable[[Path], object]) -> Callable[[Path, bytes], object]:
    """A reader of one file, whose suffix matters."""

    def put_and_read(folder: Path, content: bytes) -> object:
        (folder / name).write_bytes(content)
        return read(folder / name)

    return put_and_read


def written(name: str, write: Callable[[Path], object]) -> Callable[[], bytes]:
    """The content of a file that a function writes."""

    def content() -> bytes:
        with tempfile.TemporaryDirectory() as folder:
            write(Path(folder) / name)
            return (Path(folder) / name).read_bytes()

    return content


# --- suites and meshes ---

SUITE = b"""name = "vase"
shapes = [{ kind = "torus", tilt_deg = 30 }, { kind = "sphere" }]
materials = ["pmma", { eta = 1.5 }]
surfaces = ["rust", { alpha = 0.2, albedo = 0.4 }]
bodies = ["polarised"]
lights = [{ kind = "uniform" }, { kind = "area", incidence_deg = 60, half_angle_deg = 15 }]
wavelengths_nm = [450, 550, 650]
methods = ["unpolarised", "eq8"]
camera = { resolution = 96 }
sampling = { samples = 64, seed = 1 }
"""


def mesh(kind: str) -> Callable[[], bytes]:
    def content() -> bytes:
        import trimesh

        exported = trimesh.creation.icosahedron().export(file_type=kind)
        return exported.encode() if isinstance(exported, str) else exported

    return content


_PLY = b"""ply
format %s 1.0
element vertex 4
property float x
property float y
property float z
element %s
end_header
"""
STRIPS = _PLY % (b"ascii", b"tristrips 1\nproperty list int int vertex_indices")
STRIPS += b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n7 0 1 2 3 -1 0 1\n"
POLYGONS = _PLY % (b"binary_little_endian", b"face 2\nproperty list uchar int vertex_indices")
POLYGONS += np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]]).tobytes()
POLYGONS += b"\4" + np.int32([0, 1, 2, 3]).tobytes() + b"\3" + np.int32([0, 1, 3]).tobytes()


ARROW = ((0, 0, 0), (2, 1, 0), (0, 2, 0), (1, 1, 0.5), (0.5, 1, 0))
"""Corners of a concave face."""
OBJ_CONCAVE = "".join("v {} {} {}\n".format(*corner) for corner in ARROW).encode()
OBJ_CONCAVE += b"vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1 \\\n 4/1/1\nf -5//-1 -4//-1 -3//-1 -1//-1\n"
OFF_CONCAVE = "".join("{} {} {}\n".format(*corner) for corner in ARROW).encode()
OFF_CONCAVE = b"OFF # a comment\n5 2 0\n" + OFF_CONCAVE + b"4 0 1 2 3\n5 0 1 2 3 4\n"
PLY_CONCAVE = _PLY % (b"binary_little_endian", b"face 2\nproperty list uchar int vertex_indices")
PLY_CONCAVE += np.float32(ARROW[:4]).tobytes()
PLY_CONCAVE += 2 * (b"\4" + np.int32([0, 1, 2, 3]).tobytes())


def measured_band(path: Path) -> object:
    table = open_pbrdf(path)
    table.check_bands([520.0])
    return table.mueller_at(520.0)


# --- pictures ---


def picture(kind: str, depth: type = np.uint8) -> Callable[[], bytes]:
    def content() -> bytes:
        from PIL import Image

        codes = np.random.default_rng(1).integers(0, np.iinfo(depth).max, (8, 8, 3), depth)
        out = io.BytesIO()
        if kind == "tiff":
            import tifffile

            tifffile.imwrite(out, codes, photometric="rgb", compression="deflate")
        elif depth is np.uint16:
            import imagecodecs

            return bytes(imagecodecs.png_encode(codes))
        else:
            Image.fromarray(codes).save(out, format=kind)
        return out.getvalue()

    return content


def deep_grey() -> bytes:
    import imagecodecs

    codes = np.random.default_rng(1).integers(0, 1 << 16, (8, 8), np.uint16)
    return bytes(imagecodecs.png_encode(codes))


def colours(path: Path) -> None:
    write_exr(path, dict.fromkeys("RGB", np.full((4, 8), 0.5, np.float32)))


HDR = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + bytes([128, 128, 128, 129]) * 32


def npy(path: Path) -> None:
    np.save(path, np.full((4, 4, 3), 0.5, np.float32))


def capture(folder: Path, content: bytes) -> object:
    for angle in (0, 60, 120):
        (folder / f"pol_{angle}.png").write_bytes(picture("png")())
    (folder / "angles.json").write_bytes(content)
    return read_capture(folder)


def capture_properties(folder: Path, content: bytes) -> object:
    """polanalyser's layout, with one JSON file in question."""
    for index, angle in enumerate((0.0, 0.785, 1.571)):
        (folder / f"image{index}.png").write_bytes(picture("png")())
        (folder / f"image{index}.json").write_text(json.dumps({"angle": angle}), "utf-8")
    (folder / "image1.json").write_bytes(content)
    return read_capture(folder)


def jpeg2000() -> bytes:
    import imagecodecs

    codes = np.random.default_rng(1).integers(0, 1 << 16, (8, 8, 3), np.uint16)
    data = imagecodecs.jpeg2k_encode(codes, level=0, codecformat="jp2", reversible=True)
    return bytes(data)


def with_opacity() -> bytes:
    """A JPEG 2000 file whose colours are multiplied by an opacity."""
    codes = np.full((8, 8, 4), 99, np.uint8)
    picture = Picture(
        codes[..., :3].astype(np.float32) / 255,
        "JPEG2000",
        linear_transfer(8),
        codes[..., 3],
        {"cdef": struct.pack(">13H", 4, 0, 0, 1, 1, 0, 2, 2, 0, 3, 3, 2, 0)},
        premultiplied=True,
    )
    return written("a.jp2", lambda path: write_picture(path, picture))()


def deep_avif() -> bytes:
    import imagecodecs

    codes = np.random.default_rng(1).integers(0, 1 << 10, (8, 8, 3), np.uint16)
    return bytes(imagecodecs.avif_encode(codes, bitspersample=10, level=90, transfer=8))


def with_gamma(path: Path) -> None:
    light = np.random.default_rng(1).random((8, 8, 3), np.float32)
    write_picture(path, Picture(light, "PNG", power_transfer(1.0, 16), metadata={"gamma": 1.0}))


def with_exif() -> bytes:
    """A JPEG of a camera in its Adobe RGB mode."""
    from PIL import Image

    exif, out = Image.Exif(), io.BytesIO()
    exif.get_ifd(0x8769).update({0xA001: 65535, 0xA500: 2.2})
    exif.get_ifd(0x8769)[0xA005] = {1: "R03"}
    xmp = b"<x:xmpmeta xmlns:x='adobe:ns:meta/'><exif:Gamma>22/10</exif:Gamma></x:xmpmeta>"
    Image.new("RGB", (8, 8), (99, 5, 200)).save(out, "JPEG", exif=exif, xmp=xmp)
    return out.getvalue()


def pages(path: Path) -> None:
    import tifffile

    codes = np.random.default_rng(1).integers(1, 1 << 16, (4, 8, 8, 3), np.uint16)
    tifffile.imwrite(path, codes, photometric="rgb")


def associated_alpha(path: Path) -> None:
    import tifffile

    codes = np.full((8, 8, 4), 99, np.uint8)
    tifffile.imwrite(path, codes, photometric="rgb", extrasamples=["assocalpha"])


def stack(path: Path) -> None:
    np.save(path, np.random.default_rng(1).random((4, 8, 8, 3), np.float32))


def chroma(path: Path) -> None:
    write_exr(path, dict.fromkeys(("Y", "RY", "BY", "A"), np.full((4, 8), 0.5, np.float32)))


FOUR = (0.0, 45.0, 90.0, 135.0)


# --- datasets and predictions ---


@functools.cache
def dataset() -> Path:
    """A dataset of one scene, whose files are never changed."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    with DatasetWriter(folder) as writer:
        writer.add(TRUTH)
    return folder


def dataset_file(name: str) -> Callable[[], bytes]:
    return lambda: (dataset() / name.format(scene=TRUTH.scene.id)).read_bytes()


def scene_json(folder: Path, content: bytes) -> object:
    (folder / TRUTH.scene.id).mkdir(exist_ok=True)
    (folder / TRUTH.scene.id / "scene.json").write_bytes(content)
    return read_record(folder / TRUTH.scene.id)


def dataset_json(folder: Path, content: bytes) -> object:
    (folder / "dataset.json").write_bytes(content)
    return status(folder)


def prediction(name: str) -> Callable[[Path, bytes], object]:
    def read(folder: Path, content: bytes) -> object:
        path = folder / name.format(scene=TRUTH.scene.id)
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
        if path.suffix == ".npy":
            for angle in (45, 90):
                image = TRUTH.polarised(angle)
                np.save(path.with_name(f"{angle}.npy"), image)
        opened = open_dataset(dataset())
        predictions, _ = find_predictions(folder, opened)
        return predictions.stokes(opened.scene(TRUTH.scene.id))

    return read


def stokes_npz() -> bytes:
    out = io.BytesIO()
    np.savez_compressed(out, stokes=TRUTH.stokes)
    return out.getvalue()


def angle_npy() -> bytes:
    out = io.BytesIO()
    np.save(out, TRUTH.polarised(0))
    return out.getvalue()


# --- results ---


def results(folder: Path, content: bytes) -> object:
    (folder / "results.parquet").write_bytes(content)
    (folder / "run.json").write_text(json.dumps(sample.run()), "utf-8")
    return read_results(folder)


def part(folder: Path, content: bytes) -> object:
    (folder / "parts").mkdir(exist_ok=True)
    (folder / "parts" / "a.parquet").write_bytes(content)
    return Parts(folder).table("a"), Parts(folder).methods("a")


def failures(folder: Path, content: bytes) -> object:
    (folder / "parts").mkdir(exist_ok=True)
    (folder / "parts" / "a.failed.json").write_bytes(content)
    return [str(failure.reason) for failure in Parts(folder).failures("a")]


FAILURES = b'{"family": "sphere", "failures": [{"scene": null, "method": "eq8", "reason": "x"}]}'
PLAN = (
    b'{"suite": "a", "suite_id": "b", "methods": ["eq8"], '
    b'"families": [{"id": "0123456789abcdef", "label": "sphere", "scenes": 2}]}'
)


def plan(folder: Path, content: bytes) -> object:
    (folder / "plan.json").write_bytes(content)
    return status(folder).as_json()


def table(path: Path) -> None:
    sample.table().head(50).to_parquet(path, index=False)


def baseline(path: Path) -> None:
    origin = RunIdentity(suite="gate", scenes="0", seed=1, variant="scalar")
    write_baseline(path, Baseline(origin=origin, rules=DEFAULT_RULES))


def example() -> bytes:
    meta = {"scene": "0" * 16, "label": "sphere", "wavelengths_nm": list(BANDS)}
    out = io.BytesIO()
    images = {"truth": TRUTH.stokes, "mask": TRUTH.mask, "mixed": TRUTH.mask}
    np.savez_compressed(out, **images, meta=np.array(json.dumps(meta)))
    return out.getvalue()


def spectral(path: Path) -> None:
    write_spectral(path, TRUTH.stokes, BANDS)


def spectral_of_others(path: Path) -> None:
    """Half floats, PIZ, one decimal, opacity, left-handed: what other programs write."""
    import OpenEXR

    names = [f"S{part}.{band:.1f}nm" for band in BANDS for part in range(3)]
    planes = {name: np.full((SIDE, SIDE), 0.5, np.float16) for name in [*names, "A"]}
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header | {"polarisationHandedness": "left"}, planes).write(str(path))


READERS = {
    "suite": Reader(of_file("a.toml", load_suite), lambda: SUITE),
    **{
        f"mesh-{kind}": Reader(of_file(f"a.{kind}", load_mesh), mesh(kind))
        for kind in ("obj", "ply", "stl", "glb", "off")
    },
    "mesh-ply-strips": Reader(of_file("a.ply", load_mesh), lambda: STRIPS),
    "mesh-ply-polygons": Reader(of_file("a.ply", load_mesh), lambda: POLYGONS),
    "mesh-obj-concave": Reader(of_file("a.obj", load_mesh), lambda: OBJ_CONCAVE),
    "mesh-off-concave": Reader(of_file("a.off", load_mesh), lambda: OFF_CONCAVE),
    "mesh-ply-concave": Reader(of_file("a.ply", load_mesh), lambda: PLY_CONCAVE),
    "png": Reader(of_file("a.png", read_picture), picture("png")),
    "png-16": Reader(of_file("a.png", read_picture), picture("png", np.uint16)),
    "jpeg": Reader(of_file("a.jpg", read_picture), picture("jpeg")),
    "tiff": Reader(of_file("a.tif", read_picture), picture("tiff", np.uint16)),
    "picture-exr": Reader(of_file("a.exr", read_picture), written("a.exr", colours)),
    "environment-exr": Reader(
        of_file("a.exr", lambda path: radiance_map(Environment(name=str(path)))),
        written("a.exr", colours),
    ),
    "environment-hdr": Reader(
        of_file("a.hdr", lambda path: radiance_map(Environment(name=str(path)))), lambda: HDR
    ),
    "pattern-png": Reader(
        of_file("a.png", lambda path: ImageTexture(path=str(path)).grey()), picture("png")
    ),
    "pattern-png-16": Reader(
        of_file("a.png", lambda path: ImageTexture(path=str(path)).grey()), deep_grey
    ),
    "pattern-exr": Reader(
        of_file("a.exr", lambda path: ImageTexture(path=str(path)).grey()),
        written("a.exr", colours),
    ),
    "pbsdf": Reader(of_file("a.pbsdf", measured_band), lambda: tensor_file(**tiny_pbrdf())),
    "normals-npy": Reader(
        of_file("a.npy", lambda path: read_normals(path, (4, 4))), written("a.npy", npy)
    ),
    "normals-png": Reader(
        of_file("a.png", lambda path: read_normals(path, (8, 8))), picture("png", np.uint16)
    ),
    "capture-angles": Reader(
        capture, lambda: b'{"pol_0.png": 0, "pol_60.png": 60.0, "pol_120.png": 120}'
    ),
    "capture-polanalyser": Reader(capture_properties, lambda: b'{"angle": 0.8, "full_scale": 2.0}'),
    "capture-pages": Reader(
        of_file("a.tif", lambda path: read_capture(path, angles=FOUR)), written("a.tif", pages)
    ),
    "capture-npy": Reader(
        of_file("a.npy", lambda path: read_capture(path, angles=FOUR)), written("a.npy", stack)
    ),
    "capture-mosaic": Reader(
        of_file("a.png", lambda path: read_capture(path, mosaic=FOUR)), deep_grey
    ),
    "capture-raw": Reader(
        of_file(
            "a.raw",
            lambda path: read_capture(path, mosaic=FOUR, size=(16, 8), packing="mono12p"),
        ),
        lambda: bytes(range(192)),
    ),
    "png-gamma": Reader(of_file("a.png", read_picture), written("a.png", with_gamma)),
    "jpeg-exif": Reader(of_file("a.jpg", read_picture), with_exif),
    "avif-deep": Reader(of_file("a.avif", read_picture), deep_avif),
    "jpeg-2000-opacity": Reader(of_file("a.jp2", read_picture), with_opacity),
    "jpeg-2000": Reader(of_file("a.jp2", read_picture), jpeg2000),
    **{
        f"picture-{kind}": Reader(of_file(f"a.{kind}", read_picture), picture(kind))
        for kind in ("webp", "bmp", "ppm")
    },
    "tiff-alpha": Reader(of_file("a.tif", read_picture), written("a.tif", associated_alpha)),
    "exr-chroma": Reader(of_file("a.exr", read_picture), written("a.exr", chroma)),
    "spectral-exr": Reader(
        of_file("a.exr", lambda path: read_spectral(path, (SIDE, SIDE), BANDS)),
        written("a.exr", spectral),
    ),
    "spectral-exr-others": Reader(
        of_file("a.exr", lambda path: read_spectral(path, (SIDE, SIDE), BANDS)),
        written("a.exr", spectral_of_others),
    ),
    "scene-json": Reader(scene_json, dataset_file("{scene}/scene.json")),
    "dataset-json": Reader(dataset_json, dataset_file("dataset.json")),
    "prediction-npz": Reader(prediction("{scene}.npz"), stokes_npz),
    "prediction-npy": Reader(prediction("{scene}/0.npy"), angle_npy),
    "prediction-exr": Reader(prediction("{scene}.exr"), dataset_file("{scene}/stokes.exr")),
    "results-parquet": Reader(results, written("a.parquet", table)),
    "part-parquet": Reader(part, written("a.parquet", table)),
    "part-failures": Reader(failures, lambda: FAILURES),
    "plan-json": Reader(plan, lambda: PLAN),
    "baseline": Reader(of_file("a.toml", read_baseline), written("a.toml", baseline)),
    "example-npz": Reader(of_file("a.npz", read_example), example),
}  # fmt: skip


def verdict(name: str, content: bytes) -> str | None:
    """What is wrong with the way in which a reader takes a content; None where nothing is."""
    import traceback

    from malus.scenes import InputError

    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    try:
        READERS[name].read(folder, content)
    except InputError as error:
        return None if str(error).isprintable() else "InputError: more than one line"
    except BaseException as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if "malus" in f.filename]
        place = f"{Path(frames[-1].filename).name}:{frames[-1].name}" if frames else "?"
        return f"{type(error).__name__} in {place}"
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return None
