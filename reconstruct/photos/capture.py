"""Read real pictures through a rotated polariser, or a frame of a polarisation camera."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from malus.reconstruct.photos.capture_angles import (
    Sense,
    Unit,
    Zero,
    check_angles,
    check_counting,
    conventional,
    in_degrees,
)
from malus.reconstruct.photos.capture_arguments import (
    as_angles,
    as_degrees,
    as_level,
    as_size,
    check_belongings,
)
from malus.reconstruct.photos.capture_levels import (
    check_light,
    dark_files,
    level_hints,
    level_of,
    linearity_hints,
    over,
    read_black,
    saturation,
)
from malus.reconstruct.photos.capture_stacks import Stack, open_stack, read_frame
from malus.reconstruct.photos.mosaic import (
    check_frame,
    check_mosaic,
    colour_hints,
    demosaic,
    spread_over_neighbours,
)
from malus.reconstruct.photos.picture import MAX_PIXELS, Picture
from malus.reconstruct.photos.raw_frames import read_raw
from malus.scenes.core.arrays import BoolArray, Float32Array, Float64Array
from malus.scenes.core.brief_repr import brief_repr
from malus.scenes.core.errors import InputError
from malus.scenes.polarisation import analyser

_LOSSY = (
    "a JPEG mixes neighbouring pixels, and so the angles: save frames of the camera as PNG or TIFF"
)

MAX_CAPTURE_PIXELS = 4 * MAX_PIXELS
"""Of all pictures together: 6 GB for those of three channels, while they are put into one array."""


class Capture(NamedTuple):
    """Pictures through a polariser.

    Attributes
    ----------
    pictures : (pictures, height, width, channels) float32, linear light
    angles_deg : degrees from the vertical, anticlockwise
    clipped : (height, width) bool, any picture at the largest value that the sensor gives
    names : file names
    assumption : a sentence on how the files' values were turned into light
    hints : what may be wrong with levels or colours, and the option that would mend it
    one_exposure : whether all pictures are one frame, between which nothing can move
    channels : names of the channels where they are bands of a spectrum: `450nm` and so on

    Examples
    --------
    >>> pictures = np.full((4, 2, 3, 1), 0.5, np.float32)
    >>> names = ("a.png", "b.png", "c.png", "d.png")
    >>> dark = np.zeros((2, 3), bool)
    >>> capture = Capture(pictures, (0.0, 45.0, 90.0, 135.0), dark, names, "light")
    >>> capture.pictures[0].shape
    (2, 3, 1)
    """

    pictures: Float32Array
    angles_deg: tuple[float, ...]
    clipped: BoolArray
    names: tuple[str, ...]
    assumption: str
    hints: tuple[str, ...] = ()
    one_exposure: bool = False
    channels: tuple[str, ...] = ()

    @property
    def wavelengths_nm(self) -> tuple[float, ...] | None:
        """Wavelengths of the channels where they are bands of a spectrum, such as `450nm`."""
        return tuple(float(name.removesuffix("nm")) for name in self.channels) or None

    def __repr__(self) -> str:
        """Shapes of its arrays, in one line."""
        return brief_repr(self)


@dataclass(frozen=True)
class _Levels:
    """What `read_capture` was told of the dark level and the white level."""

    black: float | str | Path | None
    white: float | None
    read_dark: Callable[[Path], Picture]

    def black_of(self, picture: Picture) -> Float32Array | float:
        """Light of the dark level in the scale of a picture."""
        return 0.0 if self.black is None else read_black(self.black, picture, self.read_dark)

    def white_of(self, picture: Picture) -> float | None:
        """Light of the white level in the scale of a picture."""
        return None if self.white is None else level_of(picture, self.white, "white")


def read_capture(
    path: Path | str,
    zero: Zero | None = None,
    sense: Sense = "anticlockwise",
    linear: bool = False,
    offset_deg: float = 0.0,
    *,
    angles: Sequence[float] | None = None,
    unit: Unit | None = None,
    black: float | str | Path | None = None,
    white: float | None = None,
    mosaic: Sequence[float] | None = None,
    bayer: str | None = None,
    size: tuple[int, int] | None = None,
    packing: str | None = None,
) -> Capture:
    """Read pictures through a rotated polariser.

    Parameters
    ----------
    path : folder or file
        A folder of pictures with the angle in their names (the number that varies), with
        `angles.json` (file names to degrees) or with a JSON file beside each, as polanalyser and
        `malus export` write; a TIFF of pages or a .npy stack, with `angles`; a frame of a
        polarisation camera, with `mosaic`.
    zero : 'vertical' or 'horizontal'
        Where angles count from: the vertical unless the layout says otherwise; cameras and
        polanalyser count from the horizontal.
    sense : 'anticlockwise' or 'clockwise', as seen in the pictures
    linear : the files' values are linear light
    offset_deg : how far the mark of 0 stands anticlockwise of `zero`
    angles : one for each picture, in their order
    unit : 'degrees' or 'radians'
        Asked for where all angles are so small that they could be radians.
    black : number, or path of a dark frame or of a folder of them
        A code of the file, below 1 a share of its largest code; light in files of floats.
    white : likewise; what the sensor gives where it is full, which becomes 1
    mosaic : the four angles of a 2 x 2 square of pixels, row by row, such as (90, 45, 135, 0)
    bayer : order of the colours of the 2 x 2 squares: 'rggb', 'bggr', 'grbg' or 'gbrg'
    size, packing : (width, height) and pixel format of a frame without a header, see `read_raw`

    Returns
    -------
    Capture
        Pictures (pictures, height, width, channels) and their angles from the vertical.

    Raises
    ------
    InputError
        Unknown words for `zero` or `sense`, values of another kind, fewer than three
        different angles modulo 180°, names without an angle or with several, angles in an unknown
        unit, pictures of different sizes, an unreadable one, or no light that is not clipped.

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
    if not isinstance(path, (str, os.PathLike)):
        raise InputError("path", "a path", type(path).__name__, "name a folder or a file")
    path = Path(path)
    check_counting(zero, sense)
    offset_deg, white = as_degrees("offset", offset_deg), as_level("white", white)
    angles, mosaic, size = as_angles("angles", angles), as_angles("mosaic", mosaic), as_size(size)
    check_belongings(path, mosaic, angles, bayer, size, packing)

    def read_one(file: Path) -> Picture:
        if size is not None and packing is not None:
            return read_raw(file, size, packing)
        picture = read_frame(file, linear or mosaic is not None)
        return picture if mosaic is None else _grey(picture)

    levels = _Levels(black, white, read_one)
    if mosaic is not None:
        check_mosaic(mosaic, bayer)
        turn = _Convention(unit, zero or "horizontal", sense, offset_deg)
        return _read_mosaic(path, mosaic, turn.from_vertical("mosaic", mosaic), bayer, levels)
    stack = open_stack(path, linear, angles, dark_files(black))
    unit = stack.unit if unit is None else unit
    turn = _Convention(unit, zero or stack.zero or "vertical", sense, offset_deg)
    where = str(path) if angles is None else "angles"
    return _read_stack(path, stack, turn.from_vertical(where, stack.angles), levels)


@dataclass(frozen=True)
class _Convention:
    """How the angles of a capture are counted."""

    unit: Unit | None
    zero: Zero
    sense: Sense
    offset_deg: float

    def from_vertical(self, where: str, angles: Sequence[float]) -> tuple[float, ...]:
        """The angles in degrees, anticlockwise from the vertical; three or more different ones."""
        degrees = in_degrees(angles, self.unit, where)
        check_angles(where, degrees)
        return tuple(conventional(a, self.zero, self.sense) + self.offset_deg for a in degrees)


def _read_stack(
    path: Path, stack: Stack, angles_deg: tuple[float, ...], levels: _Levels
) -> Capture:
    """A capture from pictures that are read one after the other."""
    first = _joined(stack.read(0))
    _check_total(path, len(stack.names), first.linear.shape)
    black, white = levels.black_of(first), levels.white_of(first)
    pictures, clipped = _read_all(path, stack, first)
    piled = np.full(pictures.shape[-1], np.inf)
    if white is not None:
        clipped |= np.any([over(light, white) for light in pictures], axis=0)
    elif not stack.never_clipped:
        clipped, piled = _with_pile_up(pictures, clipped, first)
    _shift_and_scale(pictures, black, white)
    for light, scale in zip(pictures, stack.scales, strict=bool(stack.scales)):
        light *= np.float32(scale)
    check_light(str(path), list(pictures), clipped)
    is_dark_known = levels.black is not None or stack.never_clipped
    hints = level_hints(pictures, clipped, piled, is_dark_known)
    if first.transfer is not None and first.transfer.source == "sRGB" and levels.black is None:
        hints += linearity_hints(pictures, clipped, analyser(angles_deg))
    return Capture(
        pictures, angles_deg, clipped, stack.names, first.assumption, tuple(hints),
        channels=stack.channels,
    )  # fmt: skip


def _read_all(path: Path, stack: Stack, first: Picture) -> tuple[Float32Array, BoolArray]:
    """Light of all pictures (pictures, height, width, channels), and their clipped pixels."""
    shape = first.linear.shape
    pictures = np.empty((len(stack.names), *shape), dtype=np.float32)
    clipped = np.zeros(shape[:2], dtype=bool)
    for index, name in enumerate(stack.names):
        picture = first if index == 0 else _joined(stack.read(index))
        light = picture.linear
        _check_alike(path / name, picture, first)
        pictures[index] = light
        if not stack.never_clipped:
            clipped |= over(light, picture.full_scale)
    return pictures, clipped


def _check_alike(path: Path, picture: Picture, first: Picture) -> None:
    """Refuse a picture that does not show the same pixels in the same unit as the first."""
    if picture.turned != first.turned:
        turned = "turned by an orientation tag" if picture.turned else "one that is not turned"
        expected = "pictures that are all turned, or none"
        hint = "remove the orientation tags, or take all pictures upright"
        raise InputError(str(path), expected, f"{turned}, unlike the first", hint)
    if (picture.transfer is None) != (first.transfer is None):
        kind, others = ("floats", "whole numbers")[:: 1 if picture.transfer is None else -1]
        hint = "write all in one kind: light of floats has no largest value"
        raise InputError(str(path), f"{others}, as the first", kind, hint)
    if picture.linear.shape != first.linear.shape:
        expected, hint = f"{_size(first.linear.shape)}, as the first", "take them with one camera"
        raise InputError(str(path), expected, _size(picture.linear.shape), hint)


def _read_mosaic(
    path: Path,
    mosaic: Sequence[float],
    angles_deg: tuple[float, ...],
    bayer: str | None,
    levels: _Levels,
) -> Capture:
    """A capture from one frame of a polarisation camera."""
    if not path.is_file():
        raise InputError(str(path), "one frame of the camera", "none", "name the frame's file")
    picture = levels.read_dark(path)
    if picture.turned:
        hint = "remove the orientation tag: `mosaic` counts pixels as the sensor wrote them"
        raise InputError(str(path), "a frame that is not turned", "a turned one", hint)
    frame = picture.linear
    if frame.shape[-1] != 1:
        hint = "give the frame as the sensor wrote it"
        raise InputError(str(path), "a grey frame", f"{frame.shape[-1]} channels", hint)
    check_frame(path, frame[..., 0], bayer)
    _check_total(path, 4 if bayer is None else 12, frame.shape)
    white, black = levels.white_of(picture), levels.black_of(picture)
    clipped, piled = over(frame, white or picture.full_scale), np.full(1, np.inf)
    if white is None:
        clipped, piled = _with_pile_up(frame[None], clipped, picture)
    frame = frame.copy()
    _shift_and_scale(frame, black, white)
    clipped = spread_over_neighbours(clipped, bayer)
    check_light(str(path), [frame], clipped)
    hints = level_hints(frame[None], clipped, piled, levels.black is not None)
    hints += colour_hints(frame[..., 0], bayer)
    hints += [_LOSSY] if picture.kind == "JPEG" else []
    names = tuple(f"{angle:g}°" for angle in mosaic)
    return Capture(
        demosaic(frame[..., 0], bayer), angles_deg, clipped, names, picture.assumption,
        tuple(hints), one_exposure=True,
    )  # fmt: skip


def _grey(picture: Picture) -> Picture:
    """A picture of three equal channels, as some programs save grey, with one of them."""
    light = picture.linear
    is_grey = light.shape[-1] == 3 and bool((light == light[..., :1]).all())
    return picture.with_light(light[..., :1]) if is_grey else picture


def _joined(bands: list[Picture]) -> Picture:
    """One picture whose channels are those of several of one size."""
    if len(bands) == 1:
        return bands[0]
    light = np.concatenate([band.linear for band in bands], axis=-1)
    return bands[0].with_light(light)


def _size(shape: tuple[int, ...]) -> str:
    colours = "" if shape[-1] == 1 else f" in {shape[-1]} channels"
    return f"{shape[1]} x {shape[0]}{colours}"


def _with_pile_up(
    pictures: Float32Array, clipped: BoolArray, first: Picture
) -> tuple[BoolArray, Float64Array]:
    """Clipped pixels with those at a level where values pile up, and that level by channel."""
    transfer = first.transfer
    is_light = transfer is not None and transfer.source == "linear"
    largest_code = transfer.table.shape[1] - 1 if transfer is not None and is_light else 0
    piled = saturation(pictures, largest_code)
    piled[piled >= first.full_scale] = np.inf  # which the file's own range has told already
    extended = clipped.copy()
    for light in pictures:
        extended |= over(light, piled)
    # Where nearly all would be clipped, it was a flat scene and no saturation.
    return (clipped, np.full_like(piled, np.inf)) if extended.all() else (extended, piled)


def _shift_and_scale(light: Float32Array, black: Float32Array | float, white: float | None) -> None:
    """Take the dark level away, in place, and make the white level 1 if it was given."""
    light -= np.asarray(black, dtype=np.float32)
    if white is not None:
        span = np.float32(white) - np.asarray(black, dtype=np.float32)
        if not (span > 0).all():
            raise InputError("white", "a level above black", f"{white:g}", "correct one of them")
        light /= span


def _check_total(path: Path, count: int, shape: tuple[int, ...]) -> None:
    """Refuse more pictures than memory holds, before all are decoded."""
    height, width = shape[:2]
    total = count * height * width
    if total > MAX_CAPTURE_PIXELS:
        raise InputError(
            str(path),
            f"at most {MAX_CAPTURE_PIXELS / 1e6:g} megapixels together",
            f"{count} pictures of {width} x {height} = {total / 1e6:.0f} megapixels",
            "make them smaller, or take fewer angles",
        )
