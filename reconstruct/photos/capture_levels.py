"""Dark level, white level and saturation of the pictures of a capture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from malus.reconstruct.photos.picture import Picture
from malus.reconstruct.photos.read_picture import SUFFIXES
from malus.scenes.core.arrays import BoolArray, Float32Array, Float64Array
from malus.scenes.core.colour_science import colour_science
from malus.scenes.core.errors import InputError

_PILE = 0.0005
"""Share of the values at one largest value from which the sensor may have been full there."""
_LEAST_PILE = 10
_ENDS = (1023, 4095, 16383, 1023 << 6, 4095 << 4, 16383 << 2)
"""Largest codes of 10, 12 and 14 bits in 16, as they are or in the high bits."""
_FEW = 3
_STEEPER = 4.0
"""Times as many values as any one below it has in a pile-up, of those within a tenth."""
_SAMPLES = 200_000
"""Values that are looked at; more tell nothing new and fill the memory."""
_PEDESTAL = 0.05
"""Darkest light over the brightest from which a dark level is likely."""
_SRGB_DOUBT = 0.005
"""Residual of a fit above which values taken for sRGB are tried as linear light."""


def level_of(picture: Picture, value: float, name: str) -> float:
    """Linear light of a level: a code of the file, or below 1 a share of its largest code.

    In files of floats a level is light itself.

    Raises
    ------
    InputError
        A level that is not finite, negative, or above the largest code.

    Examples
    --------
    >>> from malus.reconstruct.photos.tone_curves import linear_transfer
    >>> picture = Picture(np.zeros((1, 1, 1), np.float32), "PNG", linear_transfer(16))
    >>> level_of(picture, 65535, "white"), level_of(picture, 0.2, "black")
    (1.0, 0.2)
    """
    if not np.isfinite(value) or value < 0:
        raise InputError(name, "a level that is not negative", f"{value:g}", "correct it")
    if picture.transfer is None:
        return value
    largest = picture.transfer.table.shape[1] - 1
    if value > largest:
        hint = "give it in the file's own codes"
        raise InputError(name, f"a code of at most {largest}", f"{value:g}", hint)
    is_share = value < 1 or (name == "white" and value == 1)
    return picture.transfer.light_of(value * largest if is_share else value)


def read_black(
    black: float | str | Path, like: Picture, read: Callable[[Path], Picture]
) -> Float32Array | float:
    """Light of the dark level: a number, or the mean of a dark frame or of a folder of them.

    Raises
    ------
    InputError
        Dark frames of another size or unit, none in the folder, or an empty text.
    """
    number = _number(black)
    if number is not None:
        return level_of(like, number, "black")
    if not str(black):  # which would be the current folder
        expected, hint = "a level, or a dark frame's path", "leave it out"
        raise InputError("black", expected, "an empty text", hint)
    paths = dark_frames(black)
    if not paths:
        raise InputError("black", "a folder of dark frames", "none in it", "check the path")
    total = np.zeros(like.linear.shape, dtype=np.float64)
    for frame in paths:
        picture = read(frame)
        _check_unit(frame, picture, like)
        dark = picture.linear
        if dark.shape != total.shape:
            size, expected = (f"{s[1]} x {s[0]} x {s[2]}" for s in (dark.shape, total.shape))
            raise InputError(str(frame), expected, size, "take it with the same camera")
        total += dark
    return (total / len(paths)).astype(np.float32)


def _check_unit(path: Path, dark: Picture, like: Picture) -> None:
    """Refuse a dark frame that is not in the unit of the pictures."""
    if like.transfer is None and dark.transfer is not None:
        hint = "write it in floats, in the pictures' unit"
        raise InputError(str(path), "floats, as the pictures", "whole numbers", hint)
    if like.transfer is not None and dark.transfer is None and dark.linear.max() > 1:
        expected = "floats up to 1, which is the pictures' largest code"
        hint = "write it in the pictures' codes, as whole numbers"
        raise InputError(str(path), expected, f"{dark.linear.max():g}", hint)


def dark_files(black: float | str | Path | None) -> set[Path]:
    """The dark frame's own file, which is no picture of the capture beside it."""
    if black is None or _number(black) is not None:
        return set()
    return {Path(str(black)).resolve()}


def dark_frames(black: float | str | Path | None) -> list[Path]:
    """Files of the dark level: the dark frame's own, or those of a folder; none of a number."""
    if black is None or _number(black) is not None:
        return []
    path = Path(str(black))
    if not path.is_dir():
        return [path]
    suffixes = {*SUFFIXES, ".npy"}
    return sorted(p for p in path.iterdir() if p.suffix.lower() in suffixes and p.name[0] != ".")


def _number(black: float | str | Path) -> float | None:
    try:
        return float(str(black))
    except ValueError:
        return None


def saturation(pictures: Float32Array, largest_code: int = 0) -> Float64Array:
    """Light at which each channel (channels,) piles up at its largest value; infinite for none.

    Parameters
    ----------
    pictures : (pictures, height, width, channels) linear light
    largest_code : code of the light 1 in files whose codes are light; 0 in others
        Where the largest value is the end of 10, 12 or 14 bits, a few pixels there are enough.

    Examples
    --------
    >>> light = np.linspace(0, 2, 4000).reshape(1, 40, 100, 1)
    >>> saturation(np.minimum(light, 1.5)).tolist(), saturation(light).tolist()
    ([1.5], [inf])
    """
    highest = pictures.max(axis=(0, 1, 2)).astype(np.float64)
    ends = np.rint(highest * largest_code)
    if len(set(ends)) == 1 and ends[0] in _ENDS and largest_code > ends[0]:
        at_end = np.count_nonzero(pictures == highest.astype(np.float32))
        if at_end >= _FEW:
            return highest
    thinned, _ = _thinned(pictures, np.zeros(pictures.shape[1:3], dtype=bool))
    return np.array([_pile_up(thinned[..., i].ravel()) for i in range(pictures.shape[-1])])


def _thinned(pictures: Float32Array, clipped: BoolArray) -> tuple[Float32Array, BoolArray]:
    """Every n-th row and column of the pictures and of the clipped pixels, without a copy."""
    step = max(1, int(np.sqrt(pictures[..., 0].size / _SAMPLES)))
    return pictures[:, ::step, ::step], clipped[::step, ::step]


def _pile_up(values: Float32Array) -> float:
    """The largest value where far more values are than at any one a little below it."""
    largest = float(values.max())
    piled = int(np.count_nonzero(values == largest))
    if largest <= 0 or piled < max(_LEAST_PILE, _PILE * values.size):
        return float("inf")
    below = values[(values >= 0.9 * largest) & (values < largest)]
    counts = np.unique(below, return_counts=True)[1]
    # Without different values just below, a flat part of the scene looks the same as saturation.
    if len(counts) < 3 or piled < _STEEPER * counts.max():
        return float("inf")
    return largest


def over(light: Float32Array, level: Float64Array | float) -> BoolArray:
    """Pixels (height, width) with a channel at its level or above."""
    return np.asarray(np.any(light >= level, axis=-1))


def level_hints(
    pictures: Float32Array, clipped: BoolArray, piled: Float64Array, black_is_known: bool
) -> list[str]:
    """Hints at a saturation below the largest code, and at a dark level that was not given."""
    hints = []
    if np.isfinite(piled).any():
        levels = ", ".join(f"{level:.4g}" for level in piled[np.isfinite(piled)])
        hints.append(
            f"values pile up at {levels} of the range: taken for clipped; `white` says where"
        )
    thinned, left_out = _thinned(pictures, clipped)
    good = thinned[:, ~left_out]
    if not black_is_known and good.size:
        low, high = (float(v) for v in np.quantile(good, (0.001, 0.999)))
        if low > _PEDESTAL * high:
            hints.append(
                f"no value is below {low / high:.0%} of the largest: if that is the camera's dark "
                "level, degrees of polarisation come out too low; give it as `black`"
            )
    return hints


def linearity_hints(pictures: Float32Array, clipped: BoolArray, matrix: Float64Array) -> list[str]:
    """A hint that values taken for sRGB fit a sinusoid much better as linear light."""
    thinned, left_out = _thinned(pictures, clipped)
    good = thinned[:, ~left_out].reshape(len(pictures), -1)
    sample: Float64Array = good[:, :: max(1, good.shape[1] // 20_000)].astype(np.float64)
    if len(pictures) < 4 or good.size == 0:
        return []
    as_srgb = _residual(sample, matrix)
    light = colour_science().models.eotf_inverse_sRGB(np.clip(sample, 0, 1))
    as_light = _residual(np.asarray(light, dtype=np.float64), matrix)
    if as_srgb < _SRGB_DOUBT or as_light > 0.5 * as_srgb:
        return []
    return [
        f"the sinusoid fits to {as_light:.1%} if the files' values are linear light, and only to "
        f"{as_srgb:.1%} as sRGB: say `linear` if they are raw"
    ]


def _residual(light: Float64Array, matrix: Float64Array) -> float:
    """Root mean square residual of the sinusoid over the mean light."""
    left = light - matrix @ (np.linalg.pinv(matrix) @ light)
    return float(np.sqrt(np.mean(left**2)) / max(float(light.mean()), 1e-30))


def check_light(where: str, pictures: Sequence[Float32Array], clipped: BoolArray) -> None:
    """Refuse captures without a pixel that is lit and not clipped. Raises InputError."""
    good = ~clipped[..., None]
    if not any(float(picture.max(where=good, initial=0.0)) > 0 for picture in pictures):
        raise InputError(
            where, "pictures with unclipped light", "black or clipped ones", "expose them again"
        )
