"""One truth as a folder of files, and back to the bit.

`scene.json` holds the scene and the size and SHA-256 of every image, so that a file that was cut,
changed or swapped is found before it is decoded. Truths in double precision (Torrance-Sparrow)
are stored once more as their bits in `float64.exr`, because the spectral layout knows 32-bit
floats only.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from malus.renderers.spectral_exr import (
    Channels,
    read_exr,
    read_spectral,
    stokes_channels,
    stokes_from_channels,
    write_exr,
    write_spectral,
)
from malus.renderers.storage import check_digest, digest, read_json, replace_folder
from malus.renderers.truth import Truth
from malus.scenes.errors import InputError
from malus.scenes.model import Model
from malus.scenes.scene import Scene

SCENE = "scene.json"
MAX_SCENE_BYTES = 1 << 20

FileName = Literal[
    "stokes.exr", "diffuse.exr", "specular.exr", "geometry.exr", "error.exr", "float64.exr"
]
IMAGES: tuple[FileName, ...] = (
    "stokes.exr", "diffuse.exr", "specular.exr", "geometry.exr", "error.exr",
)  # fmt: skip
EXACT: FileName = "float64.exr"

FieldName = Literal[
    "specular", "diffuse", "standard_error", "specular_noise", "diffuse_noise", "normals"
]
LOBES: tuple[FieldName, ...] = ("specular", "diffuse")
ERRORS: tuple[FieldName, ...] = ("standard_error", "specular_noise", "diffuse_noise")
STOKES: tuple[FieldName, ...] = (*LOBES, *ERRORS)
FIELDS: tuple[FieldName, ...] = (*STOKES, "normals")
MASK = "mask"
_AGAIN = "render this scene again"

Side = Annotated[int, Field(ge=1, le=8192)]


class StoredFile(Model):
    """What a file must be to be believed."""

    bytes: int = Field(ge=0)
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


class SceneRecord(Model):
    """Content of `scene.json`; `origin` tells what renders the truth comes from."""

    format: Literal["malus scene 1"] = "malus scene 1"
    scene: Scene
    origin: str = Field(default="", max_length=200)
    shape: tuple[Side, Side]
    dtypes: dict[FieldName, Literal["float32", "float64"]]
    interpolation_error: dict[str, float] = Field(default_factory=dict)
    files: dict[FileName, StoredFile]

    @property
    def doubles(self) -> tuple[FieldName, ...]:
        """Arrays in double precision."""
        return tuple(name for name in FIELDS if self.dtypes[name] == "float64")


def write_scene(folder: Path, truth: Truth, origin: str = "") -> None:
    """Write a truth as `folder`, which appears when it is whole and replaces an older one.

    Raises
    ------
    InputError
        If it cannot be written.
    ValueError
        If an array has another shape or type than a truth has.
    """
    dtypes = _checked(truth)
    replace_folder(folder, lambda temporary: _write_files(temporary, truth, origin, dtypes))


def read_scene(folder: Path) -> Truth:
    """The truth in a folder, equal to the one that was written, to the bit.

    Raises
    ------
    InputError
        If a file is missing, cut, changed or not what `scene.json` says.
    """
    record, _ = read_record(folder)
    for name in (*IMAGES, *([EXACT] if record.doubles else [])):
        stored = record.files.get(name)
        if stored is None:
            where = f"{folder / SCENE}, key files"
            raise InputError(where, f"an entry for {name}", "nothing", _AGAIN)
        check_digest(folder / name, stored.bytes, stored.sha256, _AGAIN)
    arrays = _read_images(folder, record)
    if record.doubles:
        arrays |= _read_doubles(folder, record)
    return Truth(
        scene=record.scene,
        interpolation_error=dict(record.interpolation_error),
        **arrays,
    )


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
    """Whether every file is there at its full size: enough to take a scene over."""
    try:
        sizes = {name: (folder / name).lstat().st_size for name in record.files}
    except OSError:
        return False
    return all(sizes[name] == stored.bytes for name, stored in record.files.items())


def _checked(truth: Truth) -> dict[FieldName, str]:
    """Types of the arrays, whose shapes must be those of one truth."""
    height, width = truth.mask.shape
    stokes = (height, width, len(truth.scene.wavelengths_nm), 3)
    for name in FIELDS:
        array = getattr(truth, name)
        expected = (height, width, 3) if name == "normals" else stokes
        if array.shape != expected or array.dtype not in (np.float32, np.float64):
            raise ValueError(
                f"{name}: expected floats {expected}, found {array.dtype} {array.shape}"
            )
    return {name: str(getattr(truth, name).dtype) for name in FIELDS}


def _write_files(folder: Path, truth: Truth, origin: str, dtypes: dict[FieldName, str]) -> None:
    bands = truth.scene.wavelengths_nm
    write_spectral(folder / "stokes.exr", truth.stokes, bands)
    for name in LOBES:
        write_spectral(folder / f"{name}.exr", getattr(truth, name), bands)
    errors = [_planes(name, getattr(truth, name), bands) for name in ERRORS]
    write_exr(folder / "error.exr", {k: v for part in errors for k, v in part.items()})
    geometry = _planes("normals", truth.normals, bands) | {MASK: truth.mask.astype(np.float32)}
    write_exr(folder / "geometry.exr", geometry)
    words = _words(truth, [name for name in FIELDS if dtypes[name] == "float64"])
    if words:
        write_exr(folder / EXACT, words)
    names = (*IMAGES, *([EXACT] if words else []))
    record = {
        "format": "malus scene 1",
        "scene": truth.scene.model_dump(mode="json"),
        "origin": origin,
        "shape": list(truth.mask.shape),
        "dtypes": dtypes,
        "interpolation_error": truth.interpolation_error,
        "files": {name: _stored(folder / name) for name in names},
    }
    text = json.dumps(record, indent=1, allow_nan=False)
    (folder / SCENE).write_text(text + "\n", encoding="utf-8")


def _stored(path: Path) -> dict[str, Any]:
    size, sha256 = digest(path)
    return {"bytes": size, "sha256": sha256}


def _planes(name: str, array: NDArray[Any], bands: tuple[float, ...]) -> Channels:
    """Planes (height, width) of an array by channel name, the array's name first."""
    if name == "normals":
        return {f"normals.{axis}": array[..., index] for index, axis in enumerate("XYZ")}
    return dict(stokes_channels(array, bands, prefix=f"{name}."))


def _assembled(name: str, channels: Channels, bands: tuple[float, ...]) -> NDArray[Any]:
    if name == "normals":
        return np.stack([channels[f"normals.{axis}"] for axis in "XYZ"], axis=-1)
    return stokes_from_channels(channels, bands, prefix=f"{name}.")


def _read_images(folder: Path, record: SceneRecord) -> dict[str, NDArray[Any]]:
    shape, bands = record.shape, record.scene.wavelengths_nm
    arrays: dict[str, NDArray[Any]] = {
        name: read_spectral(folder / f"{name}.exr", shape, bands) for name in LOBES
    }
    for file, names, more in (("error.exr", ERRORS, ()), ("geometry.exr", ("normals",), (MASK,))):
        channels = [c for name in names for c in _channel_names(name, bands)]
        planes = read_exr(folder / file, shape, [*channels, *more])
        arrays |= {name: _assembled(name, planes, bands) for name in names}
        if more:
            arrays[MASK] = planes[MASK] != 0
    return arrays


def _channel_names(name: str, bands: tuple[float, ...]) -> list[str]:
    return list(_planes(name, np.empty((0, 0, len(bands), 3)), bands))


def _words(truth: Truth, doubles: list[FieldName]) -> Channels:
    """The bits of double precision arrays as pairs of 32-bit words, by channel name."""
    words: Channels = {}
    for name in doubles:
        planes = _planes(name, getattr(truth, name), truth.scene.wavelengths_nm)
        for channel, plane in planes.items():
            pair = np.ascontiguousarray(plane, dtype="<f8").view("<u4").reshape(*plane.shape, 2)
            words |= {f"{channel}.low": pair[..., 0], f"{channel}.high": pair[..., 1]}
    return words


def _read_doubles(folder: Path, record: SceneRecord) -> dict[str, NDArray[Any]]:
    bands = record.scene.wavelengths_nm
    channels = [c for name in record.doubles for c in _channel_names(name, bands)]
    names = [f"{channel}.{word}" for channel in channels for word in ("low", "high")]
    words = read_exr(folder / EXACT, record.shape, names, dtype=np.uint32)
    planes: Channels = {}
    for channel in channels:
        pair = np.stack([words[f"{channel}.low"], words[f"{channel}.high"]], axis=-1)
        planes[channel] = pair.astype("<u4").view("<f8")[..., 0]
    return {name: _assembled(name, planes, bands) for name in record.doubles}
