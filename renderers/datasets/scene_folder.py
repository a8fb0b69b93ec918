"""Write one truth as a folder of files, and read it back to the bit.

`scene.json` holds the scene and the size and SHA-256 of every image, so that a truncated, changed
or swapped file is detected before it is decoded. Arrays in double precision (Torrance-Sparrow)
are stored once more as their bits in `float64.exr`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from malus.renderers.datasets.map_planes import (
    MapType,
    all_channels,
    map_planes,
    map_types,
    maps_from_planes,
)
from malus.renderers.datasets.planes import (
    ERRORS,
    FIELDS,
    LOBES,
    MAPS,
    S3,
    S3_ERRORS,
    Bands,
    DType,
    FieldName,
    array_from_planes,
    channel_names,
    doubles_of_words,
    dtypes_of,
    is_double,
    names_of_words,
    planes,
    words_of_doubles,
)
from malus.renderers.datasets.sensor_files import (
    DEMOSAICED,
    RAW,
    SensorRecord,
    read_frame,
    write_frame,
)
from malus.renderers.datasets.spectral_exr import read_exr, read_spectral, write_exr, write_spectral
from malus.renderers.datasets.stokes_channels import Channels
from malus.renderers.truth import Truth
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import check_digest, digest, read_json, replace_folder
from malus.scenes.core.model import Model
from malus.scenes.core.remote import lstat
from malus.scenes.maps import MapName
from malus.scenes.scene import Scene
from malus.scenes.sensor_frame import SensorFrame

SCENE = "scene.json"
MAX_SCENE_BYTES = 1 << 20

FileName = Literal[
    "stokes.exr", "diffuse.exr", "specular.exr", "geometry.exr", "error.exr", "float64.exr",
    "maps.exr", "raw.tiff", "sensor.exr",
]  # fmt: skip
IMAGES: tuple[FileName, ...] = (
    "stokes.exr", "diffuse.exr", "specular.exr", "geometry.exr", "error.exr",
)  # fmt: skip
EXACT: FileName = "float64.exr"
MAPS_FILE: FileName = "maps.exr"

MASK = "mask"
_AGAIN = "delete its folder, and render the dataset again"

Side = Annotated[int, Field(ge=1, le=8192)]


class StoredFile(Model):
    """Size and hash that an image file must have."""

    bytes: int = Field(ge=0)
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


class CameraMatrices(Model):
    """Where a scene's camera stands and how it images, as OpenCV counts: see `Camera`."""

    intrinsics: tuple[tuple[float, float, float], ...] = Field(min_length=3, max_length=3)
    extrinsics: tuple[tuple[float, float, float, float], ...] = Field(min_length=3, max_length=3)


class SceneRecord(Model):
    """Content of `scene.json`; `origin` names the renders that the truth comes from.

    Records from before cameras were moved have no `camera`.
    """

    format: Literal["malus scene 1"] = "malus scene 1"
    scene: Scene
    origin: str = Field(default="", max_length=200)
    shape: tuple[Side, Side]
    dtypes: dict[FieldName, DType]
    interpolation_error: dict[str, float] = Field(default_factory=dict)
    samples: int | None = Field(default=None, ge=2)
    camera: CameraMatrices | None = None
    files: dict[FileName, StoredFile]
    maps: dict[MapName, MapType] = Field(default_factory=dict)
    sensor: SensorRecord | None = None

    @property
    def doubles(self) -> tuple[FieldName, ...]:
        """Names of the arrays in double precision."""
        return tuple(name for name in self.dtypes if is_double(self.dtypes[name]))

    @property
    def images(self) -> tuple[FileName, ...]:
        """Files of this scene's truth; without the lobes where these cannot be told apart."""
        unknown = () if self.scene.lobes_known else ("diffuse.exr", "specular.exr")
        images = (name for name in IMAGES if name not in unknown)
        return (*images, *([EXACT] if self.doubles else []))

    @property
    def errors(self) -> tuple[FieldName, ...]:
        """Names of the arrays in `error.exr`; those of s3 where the truth has it."""
        return (*ERRORS, *(name for name in S3_ERRORS if name in self.dtypes))

    @property
    def geometry(self) -> tuple[FieldName, ...]:
        """Names of the arrays in `geometry.exr`: normals, and the maps that the truth has."""
        return ("normals", *(name for name in MAPS if name in self.dtypes))


def write_scene(folder: Path, truth: Truth, origin: str = "") -> None:
    """Write a truth as `folder`, which appears when it is complete and replaces an older one.

    Raises
    ------
    InputError
        If it cannot be written.
    ValueError
        If an array has another shape or type than a truth has.
    """
    dtypes = dtypes_of(truth)
    replace_folder(folder, lambda temporary: _write_files(temporary, truth, origin, dtypes))


def read_scene(folder: Path) -> Truth:
    """Read the truth in a folder, equal to the bit to the one that was written.

    Raises
    ------
    InputError
        If a file is missing, cut, changed or not what `scene.json` says.
    """
    record, _ = read_record(folder)
    _check_files(folder, record, record.images)
    arrays = _read_images(folder, record)
    if record.doubles:
        arrays |= _read_doubles(folder, record)
    return Truth(
        scene=record.scene,
        interpolation_error=dict(record.interpolation_error),
        samples=record.samples,
        **arrays,
    )


def read_maps(
    folder: Path, record: SceneRecord, names: Iterable[MapName] | None = None
) -> dict[MapName, AnyArray]:
    """Maps (height, width, ...) of a scene by name, equal to the bit to those that were written.

    Parameters
    ----------
    folder : Path
    record : SceneRecord
        Of that folder.
    names : names of maps, optional
        By default all that the scene has.

    Raises
    ------
    InputError
        If it has not all of these, or their file is missing, cut or changed.
    """
    types = record.maps
    for name in () if names is None else names:
        if name not in types:
            hint = "add it to the maps of the suite, and render the dataset again"
            known = ", ".join(types) or "none"
            raise InputError(f"{folder / SCENE}, key maps", name, known, hint)
    if not types:
        return {}
    _check_files(folder, record, [MAPS_FILE])
    bands = record.scene.wavelengths_nm
    planes = read_exr(folder / MAPS_FILE, record.shape, all_channels(types, bands))
    chosen = {name: types[name] for name in (types if names is None else names)}
    return maps_from_planes(planes, chosen, bands)


def read_sensor(folder: Path, record: SceneRecord) -> SensorFrame:
    """The raw frame of a polarisation camera in a scene's folder, and the Stokes image from it.

    Raises
    ------
    InputError
        If there is none, or a file of it is missing, cut or changed.
    """
    if record.sensor is None:
        hint = "add [sensor] to the suite, and render the dataset again"
        raise InputError(f"{folder / SCENE}, key sensor", "a frame of a sensor", "none", hint)
    widths = {len(row) for row in record.sensor.channels.weights}
    if widths != {len(record.scene.wavelengths_nm)}:
        where = f"{folder / SCENE}, key sensor"
        raise InputError(where, "a weight for each band", f"{widths.pop()}", _AGAIN)
    files: list[FileName] = [RAW, *([DEMOSAICED] if record.sensor.demosaiced else [])]
    _check_files(folder, record, files)
    return read_frame(folder, record.sensor, record.shape)


def _check_files(folder: Path, record: SceneRecord, names: Iterable[FileName]) -> None:
    """Compare files with their sizes and hashes in the record. Raises InputError."""
    for name in names:
        stored = record.files.get(name)
        if stored is None:
            where = f"{folder / SCENE}, key files"
            raise InputError(where, f"an entry for {name}", "nothing", _AGAIN)
        check_digest(folder / name, stored.bytes, stored.sha256, _AGAIN)


def read_record(folder: Path) -> tuple[SceneRecord, str]:
    """The validated `scene.json` of a folder, whose name must be the scene's id, and its hash.

    Raises
    ------
    InputError
        If it is missing or malformed, or belongs to another scene.
    """
    path = folder / SCENE
    if folder.is_symlink():
        raise InputError(str(folder), "a folder", "a link", _AGAIN)
    content, sha256 = read_json(path, MAX_SCENE_BYTES)
    record = SceneRecord.parse(content, str(path))
    if record.scene.id != folder.name:
        raise InputError(f"{path}, key scene", f"scene {folder.name}", record.scene.id, _AGAIN)
    missing = [name for name in FIELDS if name not in record.dtypes]
    if missing:
        raise InputError(f"{path}, key dtypes", f"the type of {missing[0]}", "nothing", _AGAIN)
    return record, sha256


def is_whole(folder: Path, record: SceneRecord) -> bool:
    """Whether every file is there at its full size: enough to keep a scene."""
    try:
        sizes = {name: lstat(folder / name).st_size for name in record.files}
    except OSError:
        return False
    return all(sizes[name] == stored.bytes for name, stored in record.files.items())


def _write_files(folder: Path, truth: Truth, origin: str, dtypes: dict[FieldName, DType]) -> None:
    bands = truth.scene.wavelengths_nm
    write_spectral(folder / "stokes.exr", truth.stokes, bands, truth.s3)
    lobes = LOBES if truth.scene.lobes_known else ()
    for name in lobes:
        s3 = truth.s3 if name == "specular" else None  # diffuse light has none
        write_spectral(folder / f"{name}.exr", getattr(truth, name), bands, s3)
    errors = [name for name in dtypes if name in (*ERRORS, *S3_ERRORS)]
    write_exr(folder / "error.exr", _planes(truth, errors))
    geometry = _planes(truth, [name for name in dtypes if name in ("normals", *MAPS)])
    write_exr(folder / "geometry.exr", geometry | {MASK: truth.mask.astype(np.float32)})
    exact = words_of_doubles(_planes(truth, [name for name in dtypes if is_double(dtypes[name])]))
    if exact:
        write_exr(folder / EXACT, exact)
    if truth.maps:
        write_exr(folder / MAPS_FILE, map_planes(truth.maps, bands))
    if truth.frame is not None:
        write_frame(folder, truth.frame)
    record: dict[str, Any] = {
        "format": "malus scene 1",
        "scene": truth.scene.model_dump(mode="json"),
        "origin": origin,
        "shape": list(truth.mask.shape),
        "dtypes": dtypes,
        "interpolation_error": truth.interpolation_error,
        "samples": truth.samples,
        "camera": {
            "intrinsics": truth.scene.camera.intrinsics().tolist(),
            "extrinsics": truth.scene.camera.extrinsics().tolist(),
        },
        "files": {path.name: _stored(path) for path in sorted(folder.iterdir())},
    }
    # Scenes without these have the record that they always had.
    if truth.maps:
        record["maps"] = map_types(truth.maps)
    if truth.frame is not None:
        record["sensor"] = SensorRecord.of(truth.frame).model_dump(mode="json")
    text = json.dumps(record, indent=1, allow_nan=False)
    (folder / SCENE).write_text(text + "\n", encoding="utf-8")


def _stored(path: Path) -> dict[str, Any]:
    size, sha256 = digest(path)
    return {"bytes": size, "sha256": sha256}


def _planes(truth: Truth, names: Iterable[FieldName]) -> Channels:
    """Planes (height, width) of several arrays of a truth by channel name."""
    bands = truth.scene.wavelengths_nm
    return {
        channel: plane
        for name in names
        for channel, plane in planes(name, getattr(truth, name), bands).items()
    }


def _read_images(folder: Path, record: SceneRecord) -> dict[str, Any]:
    shape, bands = record.shape, record.scene.wavelengths_nm
    arrays: dict[str, AnyArray]
    if record.scene.lobes_known:
        arrays = {name: read_spectral(folder / f"{name}.exr", shape, bands) for name in LOBES}
    else:
        whole = read_spectral(folder / "stokes.exr", shape, bands)
        arrays = {"specular": whole, "diffuse": np.zeros_like(whole)}
    if S3 in record.dtypes:
        name = "specular.exr" if record.scene.lobes_known else "stokes.exr"
        arrays[S3] = read_spectral(folder / name, shape, bands, components=4)[..., 3]
    errors = read_exr(folder / "error.exr", shape, _channels(record, record.errors, bands))
    arrays |= _arrays_from_channels(errors, record, record.errors, bands)
    names = [*_channels(record, record.geometry, bands), MASK]
    geometry = read_exr(folder / "geometry.exr", shape, names)
    return (
        arrays
        | _arrays_from_channels(geometry, record, record.geometry, bands)
        | {MASK: geometry[MASK] != 0}
    )


def _read_doubles(folder: Path, record: SceneRecord) -> dict[str, AnyArray]:
    bands = record.scene.wavelengths_nm
    names = _channels(record, record.doubles, bands)
    stored = read_exr(folder / EXACT, record.shape, names_of_words(names), dtype=np.uint32)
    return _arrays_from_channels(doubles_of_words(stored, names), record, record.doubles, bands)


def _channels(record: SceneRecord, names: Iterable[FieldName], bands: Bands) -> list[str]:
    return [c for name in names for c in channel_names(name, bands, record.dtypes[name])]


def _arrays_from_channels(
    channels: Channels, record: SceneRecord, names: Iterable[FieldName], bands: Bands
) -> dict[str, AnyArray]:
    return {name: array_from_planes(name, channels, bands, record.dtypes[name]) for name in names}
