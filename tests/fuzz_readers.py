"""Every reader of malus, with a small valid file to begin from: material for fuzzing.

A reader gets a folder and the content of one file; it has to take it or to raise an InputError.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import fuzz_contents as contents
import numpy as np
from fuzz_contents import SIDE, TRUTH, dataset, dataset_file, written
from made_up import BANDS, tensor_file, tiny_pbrdf

from malus.bench import read_results
from malus.bench.datasets.predictions import find_predictions
from malus.bench.gates.baseline import read_baseline
from malus.bench.running.parts import Parts
from malus.bench.running.status import status
from malus.reconstruct.photos.capture import read_capture
from malus.reconstruct.photos.masks_and_normals import read_normals
from malus.reconstruct.photos.read_picture import read_picture
from malus.renderers.datasets.dataset import open_folder
from malus.renderers.datasets.scene_folder import read_record
from malus.renderers.datasets.spectral_exr import read_spectral
from malus.reports.tables import sample
from malus.reports.viewer.examples import read_example
from malus.scenes import load_suite
from malus.scenes.lights.environment import radiance_map
from malus.scenes.lights.lights import Environment
from malus.scenes.materials.measured import open_pbrdf
from malus.scenes.shapes.meshes import load_mesh
from malus.scenes.shapes.patterns import ImageTexture


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


def measured_band(path: Path) -> object:
    table = open_pbrdf(path)
    table.check_bands([520.0])
    return table.mueller_at(520.0)


def capture(folder: Path, content: bytes) -> object:
    for angle in (0, 60, 120):
        (folder / f"pol_{angle}.png").write_bytes(contents.picture("png")())
    (folder / "angles.json").write_bytes(content)
    return read_capture(folder)


def capture_properties(folder: Path, content: bytes) -> object:
    """polanalyser's layout, with one JSON file in question."""
    for index, angle in enumerate((0.0, 0.785, 1.571)):
        (folder / f"image{index}.png").write_bytes(contents.picture("png")())
        (folder / f"image{index}.json").write_text(json.dumps({"angle": angle}), "utf-8")
    (folder / "image1.json").write_bytes(content)
    return read_capture(folder)


FOUR = (0.0, 45.0, 90.0, 135.0)


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
        opened = open_folder(dataset())
        predictions, _ = find_predictions(folder, opened)
        return predictions.stokes(opened.scene(TRUTH.scene.id))

    return read


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


def plan(folder: Path, content: bytes) -> object:
    (folder / "plan.json").write_bytes(content)
    return status(folder).as_json()


READERS = {
    "suite": Reader(of_file("a.toml", load_suite), lambda: contents.SUITE),
    **{
        f"mesh-{kind}": Reader(of_file(f"a.{kind}", load_mesh), contents.mesh(kind))
        for kind in ("obj", "ply", "stl", "glb", "off")
    },
    "mesh-ply-strips": Reader(of_file("a.ply", load_mesh), lambda: contents.STRIPS),
    "mesh-ply-polygons": Reader(of_file("a.ply", load_mesh), lambda: contents.POLYGONS),
    "mesh-obj-concave": Reader(of_file("a.obj", load_mesh), lambda: contents.OBJ_CONCAVE),
    "mesh-off-concave": Reader(of_file("a.off", load_mesh), lambda: contents.OFF_CONCAVE),
    "mesh-ply-concave": Reader(of_file("a.ply", load_mesh), lambda: contents.PLY_CONCAVE),
    "png": Reader(of_file("a.png", read_picture), contents.picture("png")),
    "png-16": Reader(of_file("a.png", read_picture), contents.picture("png", np.uint16)),
    "jpeg": Reader(of_file("a.jpg", read_picture), contents.picture("jpeg")),
    "tiff": Reader(of_file("a.tif", read_picture), contents.picture("tiff", np.uint16)),
    "picture-exr": Reader(of_file("a.exr", read_picture), written("a.exr", contents.colours)),
    "picture-pfm": Reader(of_file("a.pfm", read_picture), lambda: contents.PFM),
    "picture-pgm-deep": Reader(of_file("a.pgm", read_picture), lambda: contents.DEEP_PGM),
    "picture-hdr": Reader(of_file("a.hdr", read_picture), lambda: contents.HDR),
    "environment-exr": Reader(
        of_file("a.exr", lambda path: radiance_map(Environment(name=str(path)))),
        written("a.exr", contents.colours),
    ),
    "environment-hdr": Reader(
        of_file("a.hdr", lambda path: radiance_map(Environment(name=str(path)))),
        lambda: contents.HDR,
    ),
    "pattern-png": Reader(
        of_file("a.png", lambda path: ImageTexture(path=str(path)).grey()), contents.picture("png")
    ),
    "pattern-png-16": Reader(
        of_file("a.png", lambda path: ImageTexture(path=str(path)).grey()), contents.deep_grey
    ),
    "pattern-exr": Reader(
        of_file("a.exr", lambda path: ImageTexture(path=str(path)).grey()),
        written("a.exr", contents.colours),
    ),
    "pbsdf": Reader(of_file("a.pbsdf", measured_band), lambda: tensor_file(**tiny_pbrdf())),
    "normals-npy": Reader(
        of_file("a.npy", lambda path: read_normals(path, (4, 4))), written("a.npy", contents.npy)
    ),
    "normals-png": Reader(
        of_file("a.png", lambda path: read_normals(path, (8, 8))),
        contents.picture("png", np.uint16),
    ),
    "capture-angles": Reader(
        capture, lambda: b'{"pol_0.png": 0, "pol_60.png": 60.0, "pol_120.png": 120}'
    ),
    "capture-polanalyser": Reader(capture_properties, lambda: b'{"angle": 0.8, "full_scale": 2.0}'),
    "capture-pages": Reader(
        of_file("a.tif", lambda path: read_capture(path, angles=FOUR)),
        written("a.tif", contents.pages),
    ),
    "capture-npy": Reader(
        of_file("a.npy", lambda path: read_capture(path, angles=FOUR)),
        written("a.npy", contents.stack),
    ),
    "capture-mosaic": Reader(
        of_file("a.png", lambda path: read_capture(path, mosaic=FOUR)), contents.deep_grey
    ),
    "capture-raw": Reader(
        of_file(
            "a.raw",
            lambda path: read_capture(path, mosaic=FOUR, size=(16, 8), packing="mono12p"),
        ),
        lambda: bytes(range(192)),
    ),
    "png-gamma": Reader(of_file("a.png", read_picture), written("a.png", contents.with_gamma)),
    "jpeg-exif": Reader(of_file("a.jpg", read_picture), contents.with_exif),
    "avif-deep": Reader(of_file("a.avif", read_picture), contents.deep_avif),
    "jpeg-2000-opacity": Reader(of_file("a.jp2", read_picture), contents.with_opacity),
    "jpeg-2000": Reader(of_file("a.jp2", read_picture), contents.jpeg2000),
    **{
        f"picture-{kind}": Reader(of_file(f"a.{kind}", read_picture), contents.picture(kind))
        for kind in ("webp", "bmp", "ppm")
    },
    "tiff-alpha": Reader(
        of_file("a.tif", read_picture), written("a.tif", contents.associated_alpha)
    ),
    "exr-chroma": Reader(of_file("a.exr", read_picture), written("a.exr", contents.chroma)),
    "spectral-exr": Reader(
        of_file("a.exr", lambda path: read_spectral(path, (SIDE, SIDE), BANDS)),
        written("a.exr", contents.spectral),
    ),
    "spectral-exr-others": Reader(
        of_file("a.exr", lambda path: read_spectral(path, (SIDE, SIDE), BANDS)),
        written("a.exr", contents.spectral_of_others),
    ),
    "scene-json": Reader(scene_json, dataset_file("{scene}/scene.json")),
    "dataset-json": Reader(dataset_json, dataset_file("dataset.json")),
    "prediction-npz": Reader(prediction("{scene}.npz"), contents.stokes_npz),
    "prediction-npy": Reader(prediction("{scene}/0.npy"), contents.angle_npy),
    "prediction-exr": Reader(prediction("{scene}.exr"), dataset_file("{scene}/stokes.exr")),
    "results-parquet": Reader(results, written("a.parquet", contents.table)),
    "part-parquet": Reader(part, written("a.parquet", contents.table)),
    "part-failures": Reader(failures, lambda: contents.FAILURES),
    "plan-json": Reader(plan, lambda: contents.PLAN),
    "baseline": Reader(of_file("a.toml", read_baseline), written("a.toml", contents.baseline)),
    "example-npz": Reader(of_file("a.npz", read_example), contents.example),
}


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
