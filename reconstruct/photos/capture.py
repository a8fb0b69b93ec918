"""Read real pictures through a rotated polariser, and turn their angles into those of malus."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from malus.reconstruct.photos.picture import MAX_PIXELS
from malus.reconstruct.photos.read_picture import SUFFIXES, read_picture
from malus.scenes.core.arrays import BoolArray, Float32Array
from malus.scenes.core.errors import InputError, first_line

Zero = Literal["vertical", "horizontal"]
Sense = Literal["anticlockwise", "clockwise"]

_ANGLES_FILE = "angles.json"
_MAX_PICTURES = 72
MAX_CAPTURE_PIXELS = 4 * MAX_PIXELS
"""Of all pictures together: 6 GB for those of three channels, while they are put into one array."""


class Capture(NamedTuple):
    """Pictures through a polariser.

    Attributes
    ----------
    pictures : (pictures, height, width, channels) float32, linear light
    angles_deg : degrees from the vertical, anticlockwise
    clipped : (height, width) bool, any picture at its largest value
    names : file names
    assumption : a sentence on how the files' values were turned into light
    """

    pictures: Float32Array
    angles_deg: tuple[float, ...]
    clipped: BoolArray
    names: tuple[str, ...]
    assumption: str


def read_capture(
    folder: Path | str,
    zero: Zero = "vertical",
    sense: Sense = "anticlockwise",
    linear: bool = False,
    offset_deg: float = 0.0,
) -> Capture:
    """Read a folder of pictures whose names end in the polariser's angle, or with `angles.json`.

    `angles.json` maps file names to degrees. Angles count from `zero` in the `sense` that a viewer
    of the pictures sees; `offset_deg` is how far the mark of 0 stands anticlockwise of `zero`.

    Raises
    ------
    InputError
        An offset that is not finite, fewer than three different angles modulo 180°, a name
        without an angle, pictures of
        different sizes, an unreadable one, or no light that is not clipped.

    Examples
    --------
    >>> import tempfile
    >>> import PIL.Image
    >>> folder = Path(tempfile.mkdtemp())
    >>> for angle, code in ((0, 60), (60, 90), (120, 90)):
    ...     PIL.Image.new("L", (2, 2), code).save(folder / f"pol_{angle:03d}.png")
    >>> capture = read_capture(folder, zero="horizontal", linear=True)
    >>> capture.pictures.shape, capture.angles_deg
    ((3, 2, 2, 1), (-90.0, -30.0, 30.0))
    """
    if not math.isfinite(offset_deg):
        raise InputError("offset", "finite degrees", f"{offset_deg}", "correct this value")
    folder = Path(folder)
    stated = _stated_angles(folder)
    angles = tuple(conventional(angle, zero, sense) + offset_deg for angle in stated.values())
    if len({round(angle % 180.0, 3) % 180.0 for angle in angles}) < 3:
        listed = ", ".join(f"{angle:g}" for angle in stated.values())
        raise InputError(
            str(folder),
            "pictures at three or more angles, different modulo 180°",
            listed or "none",
            "a sinusoid has three unknowns",
        )
    planes: list[Float32Array] = []
    clipped: BoolArray | None = None
    assumption = ""
    for name in stated:
        picture = read_picture(folder / name, linear)
        if not planes:
            _check_total(folder, len(stated), picture.linear.shape)
        if planes and picture.linear.shape != planes[0].shape:
            expected = f"{planes[0].shape[1]} x {planes[0].shape[0]}, as the first"
            size = f"{picture.linear.shape[1]} x {picture.linear.shape[0]}"
            raise InputError(str(folder / name), expected, size, "take them with one camera")
        full = np.inf if picture.transfer is None else picture.transfer.table.max()
        over = np.any(picture.linear >= full, axis=-1)
        clipped = over if clipped is None else clipped | over
        planes.append(picture.linear)
        assumption = picture.assumption
    assert clipped is not None
    _check_light(folder, planes, clipped)
    return Capture(np.stack(planes), angles, clipped, tuple(stated), assumption)


def _check_total(folder: Path, count: int, shape: tuple[int, ...]) -> None:
    """Refuse more pictures than memory holds, before all are decoded."""
    height, width = shape[:2]
    total = count * height * width
    if total > MAX_CAPTURE_PIXELS:
        raise InputError(
            str(folder),
            f"at most {MAX_CAPTURE_PIXELS / 1e6:g} megapixels together",
            f"{count} pictures of {width} x {height} = {total / 1e6:.0f} megapixels",
            "make them smaller, or take fewer angles",
        )


def _check_light(folder: Path, planes: list[Float32Array], clipped: BoolArray) -> None:
    if clipped.all() or not max(float(plane[~clipped].max()) for plane in planes) > 0:
        raise InputError(
            str(folder),
            "pictures with unclipped light",
            "black or clipped ones",
            "expose them again",
        )


def conventional(angle_deg: float, zero: Zero, sense: Sense) -> float:
    """Degrees from the vertical, anticlockwise.

    Examples
    --------
    >>> conventional(90.0, "horizontal", "anticlockwise"), conventional(30, "vertical", "clockwise")
    (0.0, -30)
    """
    turned = angle_deg if sense == "anticlockwise" else -angle_deg
    return turned - 90.0 if zero == "horizontal" else turned


def _stated_angles(folder: Path) -> dict[str, float]:
    """Degrees by file name, as they are written there."""
    if not folder.is_dir():
        raise InputError(str(folder), "a folder of pictures", "none", "check the path")
    listing = folder / _ANGLES_FILE
    if listing.is_file():
        angles = _listed(listing)
    else:
        files = sorted(p.name for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
        angles = {name: _angle_in(folder, name) for name in files}
    if len(angles) > _MAX_PICTURES:
        raise InputError(
            str(folder), f"at most {_MAX_PICTURES} pictures", f"{len(angles)}", "leave some out"
        )
    return angles


def _listed(path: Path) -> dict[str, float]:
    """Degrees by file name, from `angles.json`."""
    try:
        data = json.loads(path.read_text("utf-8"))
        angles = {str(name): float(angle) for name, angle in data.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
        example = '{"a.png": 0, "b.png": 60, "c.png": 120}'
        raise InputError(str(path), example, first_line(error), "correct it") from None
    for name, angle in angles.items():
        if not np.isfinite(angle) or Path(name).name != name:
            raise InputError(
                str(path),
                "names of files in the folder and degrees",
                f"{name}: {angle}",
                "correct it",
            )
    return angles


def _angle_in(folder: Path, name: str) -> float:
    numbers = re.findall(r"-?\d+(?:\.\d+)?", Path(name).stem)
    if not numbers:
        raise InputError(
            str(folder / name),
            "a name that ends in the polariser's angle, such as pol_045.png",
            "no number",
            f"rename it, or write {_ANGLES_FILE}",
        )
    # A hyphen before the last number joins words; an angle and its negative differ, so ask.
    return float(numbers[-1].lstrip("-"))
