"""Content of `dataset.json`: the suite, versions, the conventions in words, and every scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, field_validator

from malus.scenes.core.files import read_json
from malus.scenes.core.model import Model
from malus.scenes.random_suite.splits import SplitName
from malus.scenes.scene import Scene

DATASET = "dataset.json"
MAX_DATASET_BYTES = 1 << 33
"""Of a file that lists scenes: room for the 10 million of the largest suite, 400 bytes each."""

CONVENTIONS = {
    "image": "rows from the top; x to the right, y up, z towards the viewer",
    "camera": "the image frame turns with a camera that is rolled or moved around the object;"
    " under a perspective one the reference axis of a pixel is the horizontal across its ray",
    "camera matrices": "intrinsics K and extrinsics [R | t] of every scene.json as OpenCV's: camera"
    " axes x right, y down, z forward, R X + t of a point X of the world (x right, y up, z towards"
    " an unmoved camera), pixel (0, 0) at the centre of the upper left one; of an orthographic"
    " camera (u, v, 1) = K (x, y, 1)",
    "stokes": "linear, reference axis +x (horizontal), s2 > 0 at +45 degrees anticlockwise as"
    " displayed; S3 > 0 where the field turns clockwise as displayed (right-handed), kept where a"
    " metal mirrors light that is polarised already, and zero elsewhere",
    "polariser angle": "transmission axis, anticlockwise from the vertical (+y) as displayed:"
    " I(angle) = (s0 - s1 cos 2 angle - s2 sin 2 angle) / 2",
    "radiance": "W m^-2 sr^-1 nm^-1 at the centre of each band, under lights of the scene's"
    " radiance; R, G, B are a preview in linear sRGB",
    "files": "stokes = specular + diffuse, which are not there where nobody can tell them apart;"
    " geometry: unit normals in the image frame, zero off the object, and the mask of pixels that"
    " it covers entirely, and normal_spread: how far the normals in a pixel differ, in degrees (the"
    " arc cosine of the length of their mean); error: standard error of stokes, and one draw of the"
    " noise of specular and diffuse (all of it in the first where they are not there)",
}
"""Meaning of the numbers, written into every dataset."""


def _is_default(value: Any) -> bool:
    return value is None or value == ""


class SceneEntry(Model):
    """One scene in `dataset.json`: its id, the hash of its `scene.json`, and a description.

    `origin` names the renders that it comes from, `bytes` is the size of its files, `index` its
    number in the suite, `split` that of a random suite that it belongs to. Datasets of earlier
    versions have none of these.
    """

    scene: str = Field(pattern=r"^[0-9a-f]{16}$")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    shape: str
    material: str
    surface: str
    body: str
    light: str
    origin: str = Field(default="", max_length=200, exclude_if=_is_default)
    bytes: int | None = Field(default=None, ge=0, exclude_if=_is_default)
    index: int | None = Field(default=None, ge=0, exclude_if=_is_default)
    split: SplitName | None = Field(default=None, exclude_if=_is_default)

    @classmethod
    def of(cls, scene: Scene, sha256: str, **more: Any) -> Self:
        """The entry of a scene; `more` are `origin`, `bytes`, `index` and `split`."""
        surface = scene.surface
        return cls(
            scene=scene.id,
            sha256=sha256,
            shape=scene.label,
            material=surface.material_label,
            surface=surface.label,
            body=surface.body,
            light=scene.light.label,
            **more,
        )


class FailedScene(Model):
    """A scene in `dataset.json` that could not be rendered, with the reason in one line.

    `origin` names the renders that it would have come from; `mendable` tells that the reason is a
    wrong input, which the user can correct.
    """

    scene: str = Field(pattern=r"^[0-9a-f]{16}$")
    origin: str = Field(default="", max_length=200)
    label: str
    reason: str = Field(max_length=2000)
    mendable: bool = False


class DatasetRecord(Model):
    """Content of `dataset.json`; `planned` is the number of scenes that there will be.

    `renders` is a hash of what decides these scenes and their images.
    """

    format: Literal["malus dataset 1"] = "malus dataset 1"
    suite: dict[str, Any] | None = None
    versions: dict[str, str] = Field(default_factory=dict)
    variant: dict[str, str] = Field(default_factory=dict)
    conventions: dict[str, str] = Field(default_factory=lambda: dict(CONVENTIONS))
    planned: int = Field(default=0, ge=0)
    renders: str = Field(default="", max_length=64, exclude_if=_is_default)
    scenes: tuple[SceneEntry, ...] = ()
    failed: tuple[FailedScene, ...] = ()

    @field_validator("scenes")
    @classmethod
    def _distinct(cls, entries: tuple[SceneEntry, ...]) -> tuple[SceneEntry, ...]:
        if len({entry.scene for entry in entries}) != len(entries):
            raise ValueError("every scene once")
        return entries


def read_dataset(folder: Path) -> tuple[DatasetRecord, str]:
    """The record of the dataset in a folder, and the SHA-256 of `dataset.json`.

    Raises
    ------
    InputError
        If there is none, or it is malformed.
    """
    content, sha256 = read_json(folder / DATASET, MAX_DATASET_BYTES)
    return DatasetRecord.parse(content, str(folder / DATASET)), sha256
