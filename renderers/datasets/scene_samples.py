"""The scene folders of a dataset as a source of samples: only the files that are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from malus.renderers.datasets.planes import ERRORS, LOBES, S3, array_from_planes, channel_names
from malus.renderers.datasets.samples import RAW, Cut
from malus.renderers.datasets.scene_folder import (
    MASK,
    FileName,
    SceneRecord,
    read_maps,
    read_sensor,
)
from malus.renderers.datasets.spectral_exr import read_exr, read_spectral
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError
from malus.scenes.core.files import check_digest

SPREAD = "normal_spread"
"""A map that datasets of earlier versions lack."""

ETA = "eta"
"""The map of the refractive index."""

SENSOR = "sensor"
"""The Stokes image (height, width, channels, 3) of a polarisation camera."""

_AGAIN = "delete its folder, and render the dataset again"
_FILES: dict[str, FileName] = {
    "stokes": "stokes.exr",
    "image": "stokes.exr",
    S3: "stokes.exr",
    "specular": "specular.exr",
    "diffuse": "diffuse.exr",
    MASK: "geometry.exr",
    "normals": "geometry.exr",
    SPREAD: "geometry.exr",
    **dict.fromkeys(ERRORS, "error.exr"),
}
"""File of each array; arrays in double precision come as float32."""


@dataclass(frozen=True)
class SceneFolders:
    """Folders of scenes; every file that is read is checked against its hash.

    Attributes
    ----------
    path : Path
        Of the dataset.
    ids : tuple of str
        Of its scenes, in order.
    splits : dict of split to ids of its scenes
    record_of : function of a scene's id
        Its record, compared with the hash that the dataset has of it.
    """

    path: Path
    ids: tuple[str, ...]
    splits: Mapping[str, Sequence[str]]
    record_of: Callable[[str], SceneRecord]

    @cached_property
    def _first(self) -> SceneRecord:
        return self.record_of(self.ids[0])

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the first picture."""
        return self._first.shape

    @property
    def maps(self) -> Sequence[str]:
        """Names of the arrays that every scene has."""
        return arrays_of(self._first)

    def read(self, number: int, maps: Sequence[str], cut: Cut) -> dict[str, AnyArray]:
        """Arrays of a scene by name.

        Raises
        ------
        InputError
            A file that is missing, cut or changed, or an array that this scene lacks.
        """
        scene = self.ids[number]
        record, folder = self.record_of(scene), self.path / scene
        present = arrays_of(record)
        for name in maps:
            if name not in present:
                hint = "leave it out; other scenes of this dataset have it"
                raise InputError(f"scene {scene}", f"the array {name}", "none", hint)
        arrays = _frame(folder, record, maps)
        own = {name: _FILES[name] for name in maps if name in _FILES}
        for file in dict.fromkeys(own.values()):
            stored = record.files[file]
            check_digest(folder / file, stored.bytes, stored.sha256, _AGAIN)
            arrays |= _read(folder / file, record, [name for name in own if own[name] == file])
        others = [name for name in record.maps if name in maps]
        if others:
            stored_maps = read_maps(folder, record, others)
            arrays |= {str(name): array for name, array in stored_maps.items()}
            # Complex for metals, and so that scenes fit into one batch, for all.
            if ETA in arrays:
                arrays[ETA] = arrays[ETA].astype(np.complex64)
        window = cut(record.shape)
        return {name: np.ascontiguousarray(arrays[name][window]) for name in maps}


def arrays_of(record: SceneRecord) -> list[str]:
    """Names of the arrays of a scene."""
    unknown = () if record.scene.lobes_known else LOBES
    absent = () if SPREAD in record.dtypes else (SPREAD,)
    frame = () if record.sensor is None else (SENSOR, RAW) if record.sensor.demosaiced else (RAW,)
    own = [name for name in _FILES if name not in (*unknown, *absent)]
    return [*own, *record.maps, *frame]


def _frame(folder: Path, record: SceneRecord, names: Sequence[str]) -> dict[str, AnyArray]:
    """What a polarisation camera makes of a scene: digital numbers (height, width, frames) too."""
    if not {SENSOR, RAW} & set(names):
        return {}
    frame = read_sensor(folder, record)
    arrays: dict[str, AnyArray] = {RAW: np.moveaxis(frame.raw, 0, -1)}
    return arrays if frame.stokes is None else arrays | {SENSOR: frame.stokes}


def _read(path: Path, record: SceneRecord, names: Sequence[str]) -> dict[str, AnyArray]:
    """Arrays of one file."""
    bands = record.scene.wavelengths_nm
    if path.name not in ("geometry.exr", "error.exr"):
        stokes = read_spectral(path, record.shape, bands, components=4 if S3 in names else 3)
        parts = {"image": stokes[..., 0], S3: stokes[..., -1]}
        return {name: parts[name] if name in parts else stokes[..., :3] for name in names}
    fields = record.geometry if path.name == "geometry.exr" else record.errors
    dtypes = record.dtypes
    channels = [c for field in fields for c in channel_names(field, bands, dtypes[field])]
    marks = [MASK] if path.name == "geometry.exr" else []
    planes = read_exr(path, record.shape, [*channels, *marks])
    arrays: dict[str, AnyArray] = {
        field: array_from_planes(field, planes, bands, dtypes[field])
        for field in fields
        if field in names
    }
    return arrays | {name: planes[name] != 0 for name in marks}
