"""Sources of a capture's pictures: folders, pages of a TIFF, arrays, exported datasets."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from malus.reconstruct.photos.capture_angles import (
    ANGLES_FILE,
    Properties,
    Unit,
    Zero,
    angles_in_names,
    read_angles_file,
    read_properties,
)
from malus.reconstruct.photos.picture import ORIENTATION, UPRIGHT, Picture, check_size, upright
from malus.reconstruct.photos.read_picture import SUFFIXES, read_picture
from malus.reconstruct.photos.read_tiff import count_pages, interleaved
from malus.reconstruct.photos.tone_curves import linear_transfer
from malus.scenes import polarisation
from malus.scenes.core.arrays import AnyArray
from malus.scenes.core.errors import InputError, counted, reading

MAX_PICTURES = 72
_BAND = re.compile(r"(\d+(?:\.\d+)?)nm")
_STEP_ANGLES = (0.0, 45.0, 90.0, 135.0)


class Stack(NamedTuple):
    """Pictures of a capture before they are read.

    Attributes
    ----------
    names : of the pictures
    angles : as they are stated
    read : function of an index that returns the picture's bands, one Picture each
    unit, zero : what the layout says of its angles, or None
    channels : names of the bands, where the layout has bands
    scales : light of 1 in each picture
    never_clipped : the largest value is that of the brightest pixel, not the end of a range
    """

    names: tuple[str, ...]
    angles: tuple[float, ...]
    read: Callable[[int], list[Picture]]
    unit: Unit | None = None
    zero: Zero | None = None
    channels: tuple[str, ...] = ()
    scales: tuple[float, ...] = ()
    never_clipped: bool = False


def open_stack(path: Path, linear: bool, angles: Sequence[float] | None, apart: set[Path]) -> Stack:
    """The pictures of a folder or file, without decoding them; files in `apart` are left out.

    Raises
    ------
    InputError
        No pictures, no angles, more angles than pictures or fewer.
    """
    if path.is_dir():
        return _of_folder(path, linear, angles, apart)
    if not path.is_file():
        raise InputError(str(path), "a folder of pictures", "none", "check the path")
    if path.suffix.lower() == ".npy":
        return _of_array(path, angles)
    if SUFFIXES.get(path.suffix.lower()) == "TIFF":
        return _of_pages(path, linear, angles)
    hint = "a frame of a polarisation camera needs `mosaic`, such as 90,45,135,0"
    raise InputError(str(path), "a folder, a TIFF of pages or a .npy stack", "one picture", hint)


def _matched(where: str, angles: Sequence[float] | None, count: int) -> tuple[float, ...]:
    """Angles for so many pictures, as the user gave them."""
    if angles is None:
        hint = "give `angles`, one for each, in their order"
        raise InputError(where, f"angles of {count} pictures", "none", hint)
    if len(angles) != count:
        raise InputError("angles", f"{count} angles, one a picture", f"{len(angles)}", "correct it")
    return tuple(float(angle) for angle in angles)


def _of_pages(path: Path, linear: bool, angles: Sequence[float] | None) -> Stack:
    count = count_pages(path)
    if count == 1 and angles is not None:
        return _of_samples(path, angles)
    if count == 1:
        hint = "a frame of a polarisation camera needs `mosaic`, such as 90,45,135,0"
        raise InputError(str(path), "a TIFF of several pages", "one picture", hint)
    names = tuple(f"page {number}" for number in range(1, count + 1))

    def read(index: int) -> list[Picture]:
        return [read_picture(path, linear, part=str(index + 1))]

    return Stack(names, _matched(str(path), angles, count), read)


def _of_samples(path: Path, angles: Sequence[float]) -> Stack:
    """Pictures that are the channels of one TIFF page: linear light, as arrays are."""
    import tifffile

    with (
        reading(str(path), "a whole TIFF file", "save it again"),
        tifffile.TiffFile(path) as file,
    ):
        page = file.pages.first
        check_size(path, page.imagewidth, page.imagelength)
        if page.samplesperpixel != len(angles):
            form = f"one page of {page.samplesperpixel} channels"
            raise InputError(str(path), f"{len(angles)} pages or channels", form, "check `angles`")
        orientation = int(page.tags[ORIENTATION].value) if ORIENTATION in page.tags else UPRIGHT
        channels = upright(interleaved(page), orientation)
    return _of_array(path, angles, np.moveaxis(channels, -1, 0))


def _of_array(path: Path, angles: Sequence[float] | None, values: AnyArray | None = None) -> Stack:
    array = _open_array(path) if values is None else values
    count = None if angles is None else len(angles)
    if array.ndim == 3 and count not in (None, array.shape[0]) and count == array.shape[2]:
        array = np.moveaxis(array, -1, 0)
    if array.ndim not in (3, 4) or (array.ndim == 4 and array.shape[-1] not in (1, 3)):
        expected = "an array (pictures, height, width) or (pictures, height, width, 1 or 3)"
        raise InputError(str(path), expected, f"shape {array.shape}", "arrange it so")
    stated = _matched(str(path), angles, len(array))
    names = tuple(f"picture {number}" for number in range(1, len(array) + 1))
    return Stack(names, stated, lambda index: [_of_values(path, array[index])])


def read_array(path: Path) -> Picture:
    """A picture (height, width[, 1 or 3]) from a .npy file: linear light, or its codes."""
    return _of_values(path, _open_array(path))


def _open_array(path: Path) -> AnyArray:
    with reading(str(path), "an array of numbers", "write it with numpy.save"):
        array: AnyArray = np.load(path, mmap_mode="r", allow_pickle=False)
        if array.dtype.kind not in "uif" or array.size == 0:
            raise InputError(str(path), "real numbers", f"{array.dtype}, {array.shape}", "convert")
    return array


def _of_values(path: Path, values: AnyArray) -> Picture:
    """A picture of linear light from an array; codes of 8 or 16 bits are of that range."""
    planes = values if values.ndim == 3 else values[..., None]
    if planes.ndim != 3 or planes.shape[-1] not in (1, 3):
        raise InputError(
            str(path), "(height, width) or 1 or 3 channels", f"{values.shape}", "arrange it so"
        )
    check_size(path, planes.shape[1], planes.shape[0])
    native = planes.dtype.newbyteorder("=")
    if native in (np.uint8, np.uint16):
        transfer = linear_transfer(8 * native.itemsize)
        return Picture(transfer.linear(np.asarray(planes, dtype=native)), "TIFF", transfer)
    light = np.asarray(planes, dtype=np.float32)
    if not np.isfinite(light).all():
        bad = int(np.count_nonzero(~np.isfinite(light)))
        raise InputError(str(path), "finite values", counted(bad, "other"), "clean the array")
    return Picture(light, "TIFF", None)


def _of_folder(
    folder: Path, linear: bool, angles: Sequence[float] | None, apart: set[Path]
) -> Stack:
    listing = folder / ANGLES_FILE
    if listing.is_file() and angles is None:
        stated = read_angles_file(listing)
        return _of_names(folder, linear, stated)
    suffixes = {*SUFFIXES, ".npy"}
    # Hidden files are a system's own, such as the ._ files that macOS leaves on other disks.
    names = sorted(
        (p.name for p in folder.iterdir()
         if p.suffix.lower() in suffixes and p.resolve() not in apart and p.name[0] != "."),
        key=_in_number_order,
    )  # fmt: skip
    if angles is not None:
        return _of_names(
            folder, linear, dict(zip(names, _matched(str(folder), angles, len(names)), strict=True))
        )
    if not names:
        return _exported(folder, linear)
    _refuse_maps(folder, names)
    properties = {name: read_properties(folder / name) for name in names}
    if any(value is not None for value in properties.values()):
        return _of_properties(folder, properties)
    return _of_names(folder, linear, angles_in_names(folder, sorted(names)))


def _in_number_order(name: str) -> list[tuple[int, str]]:
    """Names in the order of the numbers in them, so that 2 comes before 10."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def read_frame(path: Path, linear: bool) -> Picture:
    """A picture of a capture: one of the usual formats, or an array in a .npy file."""
    return read_array(path) if path.suffix.lower() == ".npy" else read_picture(path, linear)


def _of_names(folder: Path, linear: bool, stated: dict[str, float]) -> Stack:
    names = tuple(stated)
    if len(names) > MAX_PICTURES:
        raise InputError(
            str(folder), f"at most {MAX_PICTURES} pictures", f"{len(names)}", "leave some out"
        )
    return Stack(
        names, tuple(stated.values()), lambda index: [read_frame(folder / names[index], linear)]
    )


def _of_properties(folder: Path, properties: dict[str, Properties | None]) -> Stack:
    """polanalyser's layout: a JSON file beside every picture, and values that are light."""
    missing = [name for name, value in properties.items() if value is None]
    if missing:
        expected = f"a JSON file with an angle beside {missing[0]}, as beside others"
        raise InputError(str(folder), expected, "none", "add it, or take the picture away")
    present = [value for value in properties.values() if value is not None]
    angles = _of_names(folder, True, {n: p.angle for n, p in zip(properties, present, strict=True)})
    scales = tuple(1.0 if p.full_scale is None else p.full_scale for p in present)
    stated = any(p.full_scale is not None for p in present)
    return angles._replace(unit="radians", zero="horizontal", scales=scales, never_clipped=stated)


def _refuse_maps(folder: Path, names: Sequence[str]) -> None:
    """Refuse exported maps of AoLP and DoLP: what they were made from is not in them."""
    if all(re.match(r"(aolp|dolp)_.*nm\.png$", name) for name in names):
        raise InputError(
            str(folder),
            "pictures through a polariser",
            "maps of its angle and degree, without intensity",
            "export the dataset as numpy or polanalyser instead",
        )


def _exported(folder: Path, linear: bool) -> Stack:
    """A scene that `malus export` wrote: an array of Stokes vectors, or a folder for every band."""
    if (folder / "truth.npz").is_file():
        return _of_stokes(folder / "truth.npz")
    bands = sorted(
        (float(match[1]), path)
        for path in folder.iterdir()
        if path.is_dir() and (match := _BAND.fullmatch(path.name))
    )
    if not bands:
        scenes = (folder / "conventions.json").is_file()
        content = "a folder of scenes" if scenes else "none"
        hint = "name the folder of one scene" if scenes else "check the path"
        raise InputError(str(folder), "pictures at three or more angles", content, hint)
    stacks = [_of_folder(path, linear, None, set()) for _, path in bands]
    first = stacks[0]
    for stack, (_, path) in zip(stacks, bands, strict=True):
        if stack.angles != first.angles or stack.scales != first.scales:
            raise InputError(str(path), "the angles of the other bands", "others", "export again")

    def read(index: int) -> list[Picture]:
        return [picture for stack in stacks for picture in stack.read(index)]

    return first._replace(read=read, channels=tuple(path.name for _, path in bands))


def _of_stokes(path: Path) -> Stack:
    """Pictures at four angles from the Stokes vectors (height, width, bands, 3) of a truth."""
    with reading(str(path), "an export of malus", "export it again"), np.load(path) as arrays:
        stokes = np.asarray(arrays["stokes"])
        bands = np.asarray(arrays["wavelengths_nm"], dtype=np.float64)
        if stokes.ndim != 4 or stokes.shape[2:] != (len(bands), 3) or stokes.dtype.kind != "f":
            raise InputError(str(path), "Stokes vectors", f"shape {stokes.shape}", "export again")
        check_size(path, stokes.shape[1], stokes.shape[0])
        if not np.isfinite(stokes).all():
            raise InputError(str(path), "finite Stokes vectors", "others", "export again")

    def read(index: int) -> list[Picture]:
        light = polarisation.polarised(stokes, _STEP_ANGLES[index]).astype(np.float32)
        return [Picture(light, "EXR", None)]

    names = tuple(f"{angle:g}°" for angle in _STEP_ANGLES)
    channels = tuple(f"{band:.10g}nm" for band in bands)
    return Stack(names, _STEP_ANGLES, read, "degrees", "vertical", channels, never_clipped=True)
