"""What `read_capture` is told of a capture: values of the right kind, that belong together."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from malus.reconstruct.photos.read_picture import SUFFIXES
from malus.scenes.core.errors import InputError

_HINT = "correct this value"


def as_degrees(name: str, value: float) -> float:
    """A finite number of degrees. Raises InputError for anything else."""
    if not _is_number(value) or not math.isfinite(value):
        raise InputError(name, "finite degrees", _told(value), _HINT)
    return float(value)


def as_level(name: str, value: float | None) -> float | None:
    """A number, or None. Raises InputError for anything else."""
    if value is not None and not _is_number(value):
        raise InputError(name, "a number", _told(value), _HINT)
    return value


def as_angles(name: str, values: Sequence[float] | None) -> tuple[float, ...] | None:
    """A list or array of numbers, or None. A set has no order. Raises InputError for anything else.

    Examples
    --------
    >>> as_angles("angles", np.array([0, 45])), as_angles("angles", None)
    ((0.0, 45.0), None)
    """
    if values is None:
        return None
    try:
        array = np.asarray(values)
    except ValueError:  # lists of different lengths
        array = np.array("")
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise InputError(name, "a list of numbers, such as (0, 45, 90, 135)", _told(values), _HINT)
    return tuple(array.astype(np.float64).tolist())


def as_size(size: tuple[int, int] | None) -> tuple[int, int] | None:
    """Width and height in pixels, or None. Raises InputError for anything else."""
    if size is None:
        return None
    array = np.array("") if isinstance(size, str) else np.asarray(size)
    if array.shape != (2,) or array.dtype.kind not in "iu":
        raise InputError("size", "width and height in pixels", _told(size), _HINT)
    width, height = array.tolist()
    return width, height


def check_belongings(
    path: Path,
    mosaic: Sequence[float] | None,
    angles: Sequence[float] | None,
    bayer: str | None,
    size: tuple[int, int] | None,
    packing: str | None,
) -> None:
    """Refuse what does not belong together: what only a frame has without it, and the reverse.

    Raises
    ------
    InputError
        With what is missing, or too much.
    """
    if packing is not None and not isinstance(packing, str):
        raise InputError("packing", "the name of a pixel format", _told(packing), _HINT)
    if mosaic is None:
        _refuse_of_frames(bayer=bayer, size=size, packing=packing)
    else:
        _check_frame(path, angles, bayer, size, packing)


def _is_number(value: object) -> bool:
    is_real = np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"  # type: ignore[arg-type]
    return bool(is_real)


def _told(value: object) -> str:
    return f"{type(value).__name__} {value!r}"


def _refuse_of_frames(**told: object) -> None:
    """Raises InputError where something is told that only a camera's frame has."""
    alone = [name for name, value in told.items() if value is not None]
    if alone:
        found = f"{' and '.join(alone)} without it"
        raise InputError("mosaic", "the four angles of a frame", found, "add it, or leave them out")


def _check_frame(
    path: Path,
    angles: Sequence[float] | None,
    bayer: str | None,
    size: tuple[int, int] | None,
    packing: str | None,
) -> None:
    """Raises InputError where what is told of a frame does not belong together."""
    if angles is not None:
        found, hint = "angles beside it", "a frame's are those of `mosaic`: leave one out"
        raise InputError("mosaic", "no other angles", found, hint)
    if (size is None) != (packing is None):
        found = "size" if packing is None else "packing"
        raise InputError("mosaic", "size with packing", f"{found} alone", "add the other")
    order = re.search(r"bayer_?(rg|bg|gr|gb)", packing.lower()) if packing is not None else None
    if order is not None and order[1] != (bayer or "")[:2]:
        expected, hint = f"bayer of {packing}, which begins with {order[1]}", "correct one of them"
        raise InputError("bayer", expected, bayer or "none", hint)
    if size is None and path.is_file() and path.suffix.lower() not in (*SUFFIXES, ".npy"):
        found, hint = path.suffix or "no suffix", "a frame without a header needs `size`, `packing`"
        raise InputError(str(path), "a picture or an array", found, hint)
