"""Masks and normals that come with a picture, from files of its size."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np

from malus.reconstruct.observation import as_mask
from malus.reconstruct.photos.picture import check_size
from malus.reconstruct.photos.read_exr import read_exr_vectors
from malus.reconstruct.photos.read_picture import SUFFIXES, read_picture
from malus.scenes.core.arrays import AnyArray, BoolArray, Float32Array, IntArray
from malus.scenes.core.errors import InputError, reading
from malus.scenes.core.quiet import quiet


def read_mask(path: Path | str, shape: tuple[int, int]) -> BoolArray:
    """Mask (height, width) from a picture: lighter than half is the object.

    A .npy file has True and False, 0 and 1, or 0 and 255.

    Raises
    ------
    InputError
        Another size, no pixel of the object, or an unreadable file.
    """
    path = Path(path)
    values = _mask_of_array(path) if _is_array(path) else _opaque(path).mean(axis=-1)
    _check_shape(path, values.shape, shape)
    if not (values > 0.5).any():
        hint = "check the mask; dark values of several objects are `labels`"
        raise InputError(str(path), "an object, lighter than half", "none", hint)
    return np.asarray(values > 0.5)


def _is_array(path: Path) -> bool:
    return path.suffix.lower() == ".npy"


def _array(path: Path) -> AnyArray:
    """One value a pixel from a .npy file."""
    with reading(str(path), "an array of numbers", "write it with numpy.save"):
        array: AnyArray = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.ndim != 2 or array.dtype.kind not in "buif":
        found = f"{array.dtype} of shape {array.shape}"
        raise InputError(str(path), "one number a pixel, (height, width)", found, "write it so")
    check_size(path, array.shape[1], array.shape[0])
    return np.asarray(array)


def _mask_of_array(path: Path) -> Float32Array:
    array = _array(path)
    try:
        return as_mask(array).astype(np.float32)
    except InputError as error:
        raise InputError(str(path), error.expected, error.found, error.hint) from None


def _labels_of_array(path: Path) -> AnyArray:
    array = _array(path)
    if not (array >= 0).all():  # some programs write -1 off all objects
        expected, hint = "labels from 0, which is no object", "write 0 where there is none"
        raise InputError(str(path), expected, "some below, or none at all", hint)
    return array


def _opaque(path: Path) -> Float32Array:
    """Values (height, width, channels) of a picture that hides nothing by being transparent."""
    if (values := _of_few_values(path)) is not None:
        return values
    picture = read_picture(path, linear=True)
    if picture.alpha is not None and (picture.alpha < picture.alpha.max()).any():
        hint = "write what is meant in black and white"
        raise InputError(str(path), "an opaque picture", "transparent parts", hint)
    return picture.linear


def _of_few_values(path: Path) -> Float32Array | None:
    """Values of a picture of 1 bit a pixel or of opaque colours of a palette; None of others.

    A photograph of them would not be written as it came in; a mask is only read.
    """
    import PIL.Image
    import PIL.ImageOps

    if SUFFIXES.get(path.suffix.lower()) not in _OF_FEW_VALUES or not path.is_file():
        return None
    with suppress(Exception), quiet(), PIL.Image.open(path) as image:
        wanted = {"1": "L", "P": "RGB"}.get(image.mode)
        is_plain = "transparency" not in image.info and getattr(image, "n_frames", 1) == 1
        if wanted is None or not is_plain:
            return None
        check_size(path, *image.size)
        turned = PIL.ImageOps.exif_transpose(image.convert(wanted))
        values = np.asarray(turned, np.float32) / np.float32(255)
        return values if values.ndim == 3 else values[..., None]
    return None  # what is wrong with it is told where it is read as others are


_OF_FEW_VALUES = ("PNG", "BMP", "TIFF")
"""Formats in which programs write masks and labels of 1 bit a pixel or with a palette."""

MOST_OBJECTS = 255
"""Most objects that a label image may have: more are a photograph, or the marks of a JPEG."""

_OBJECTS = f"black and 1 to {MOST_OBJECTS} other values, one an object"


def read_labels(path: Path | str, shape: tuple[int, int]) -> IntArray:
    """Label image (height, width): 0 where black, and a number from 1 for every other value.

    Every value or colour of the picture is an object of its own; they count from the darkest, or
    in the order of red, green and blue. Numbers of a .npy file count alike, and 0 is black.

    Raises
    ------
    InputError
        Another size, no object, more than `MOST_OBJECTS`, or an unreadable file.
    """
    path = Path(path)
    values = _labels_of_array(path)[..., None] if _is_array(path) else _opaque(path)
    _check_shape(path, values.shape[:2], shape)
    codes = np.zeros(values.shape[:2], np.int64)
    for channel in np.moveaxis(values, -1, 0):
        levels, ranks = np.unique(channel, return_inverse=True)
        _check_objects(path, len(levels) - 1)  # of a photograph, before it is sorted by colour
        codes = codes * len(levels) + ranks.reshape(codes.shape)
    distinct, labels = np.unique(codes, return_inverse=True)
    light = np.zeros(len(distinct), bool)
    light[labels.ravel()] = values.any(axis=-1).ravel()
    if not light.any():
        raise InputError(str(path), _OBJECTS, "black alone", "check the labels")
    _check_objects(path, int(np.count_nonzero(light)))
    numbers = np.where(light, np.cumsum(light), 0)
    return np.asarray(numbers[labels.ravel()].reshape(shape))


def _check_objects(path: Path, objects: int) -> None:
    if objects > MOST_OBJECTS:
        hint = "write labels as a PNG: lossy files mix values"
        raise InputError(str(path), _OBJECTS, f"more than {MOST_OBJECTS}", hint)


def read_normals(path: Path | str, shape: tuple[int, int]) -> Float32Array:
    """Normals (height, width, 3) from a .npy, EXR or PFM of vectors, or a picture of ½ (n + 1).

    An EXR has them in R, G, B or, as renderers write them, in X, Y, Z of a layer; both in the
    picture's frame: x right, y up, z towards the camera. A TIFF of floats, some of them below 0 or
    most of length 1, holds vectors as an EXR does. Vectors are made unit; those shorter than ½,
    that face away, or where the picture is wholly transparent, become zero: no normal.

    Raises
    ------
    InputError
        Another size, another number of channels, ½ (n + 1) where vectors belong, no normal at all,
        or an unreadable file.
    """
    path = Path(path)
    vectors = _npy(path) if _is_array(path) else _vectors(path)
    if vectors.ndim != 3 or vectors.shape[-1] != 3:
        shape_read = f"shape {vectors.shape}"
        raise InputError(
            str(path), "three values a pixel", shape_read, "write x, y, z to 3 channels"
        )
    _check_shape(path, vectors.shape[:2], shape)
    length = _lengths(vectors)[..., None]
    good = np.isfinite(length) & (length > 0.5) & (vectors[..., 2:] >= 0)
    if not good.any():
        expected = "unit vectors, z towards the camera, on the object"
        raise InputError(str(path), expected, "none", "check the order of x, y, z and their range")
    return np.where(good, vectors / np.where(good, length, 1), 0).astype(np.float32)


def _vectors(path: Path) -> AnyArray:
    if path.suffix.lower() == ".exr" and (vectors := read_exr_vectors(path)) is not None:
        return _not_encoded(path, vectors)
    picture = read_picture(path, linear=True)
    vectors = picture.linear
    if picture.kind in ("EXR", "PFM"):
        vectors = _not_encoded(path, vectors)
    elif picture.transfer is not None or not (vectors.min() < 0 or _are_unit(vectors)):
        vectors = 2 * vectors - 1
    return vectors if picture.alpha is None else np.where(picture.alpha[..., None] > 0, vectors, 0)


def _npy(path: Path) -> AnyArray:
    with reading(str(path), "an array of numbers", "write it with numpy.save"):
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        if array.ndim == 3:
            check_size(path, array.shape[1], array.shape[0])
        return _not_encoded(path, np.asarray(array, dtype=np.float32))


def _lengths(vectors: AnyArray) -> AnyArray:
    with np.errstate(over="ignore"):  # what is longer than a float holds is no normal
        return np.linalg.norm(vectors, axis=-1)


def _are_unit(vectors: AnyArray) -> bool:
    """Whether most vectors (height, width, 3), but those that are none, have length 1."""
    length = _lengths(vectors)
    of_any = length[np.isfinite(length) & (length > 0.5)]
    return bool(of_any.size) and float(np.median(np.abs(of_any - 1))) < _ROUGHLY


_ROUGHLY = 0.02
"""Difference of a length from 1 that half floats, and means over a pixel's edge, leave."""


def _not_encoded(path: Path, vectors: AnyArray) -> AnyArray:
    """The vectors. Raises InputError for values that are none below 0 and whose length is not 1.

    That is ½ (n + 1), which as vectors would all point to the upper right.
    """
    is_positive = vectors.ndim == 3 and bool((vectors > 0).any()) and not (vectors < 0).any()
    if is_positive and not _are_unit(vectors):
        found = "none below 0, and lengths that are not 1, as of (n + 1)/2"
        hint = "write n itself, or (n + 1)/2 to a PNG or TIFF"
        raise InputError(str(path), "unit vectors", found, hint)
    return vectors


def _check_shape(path: Path, actual: tuple[int, ...], expected: tuple[int, int]) -> None:
    if tuple(actual) != tuple(expected):
        raise InputError(
            str(path),
            f"the picture's size, {expected[1]} x {expected[0]}",
            f"{actual[1]} x {actual[0]}",
            "make it of the picture's size",
        )
