"""Label images: several objects in one picture, each of a grey level or colour of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from malus.reconstruct.photos.read_picture import read_picture
from malus.scenes.core.arrays import BoolArray
from malus.scenes.core.errors import InputError

MOST_OBJECTS = 64
"""More values than that are no labels: a photograph, or labels saved as JPEG or with soft edges."""


def read_labels(path: Path | str, shape: tuple[int, int]) -> tuple[BoolArray, ...]:
    """Masks (height, width) of the objects of a label image, in the order of its values.

    Parameters
    ----------
    path : picture of exact values, such as a PNG
        Black is no object; every other grey level or colour is one.
    shape : (height, width)
        Of the picture that it labels.

    Returns
    -------
    tuple of (height, width) bool arrays

    Raises
    ------
    InputError
        Another size, no object, more than `MOST_OBJECTS`, or an unreadable file.

    Examples
    --------
    >>> import tempfile
    >>> import PIL.Image
    >>> path = Path(tempfile.mkdtemp()) / "labels.png"
    >>> PIL.Image.fromarray(np.array([[0, 1, 1], [0, 2, 2]], np.uint8)).save(path)
    >>> [mask.sum().item() for mask in read_labels(path, (2, 3))]
    [2, 2]
    """
    path = Path(path)
    values = read_picture(path, linear=True).linear
    if values.shape[:2] != tuple(shape):
        raise InputError(
            str(path),
            f"the picture's size, {shape[1]} x {shape[0]}",
            f"{values.shape[1]} x {values.shape[0]}",
            "make it of the picture's size",
        )
    colours, index = np.unique(values.reshape(-1, values.shape[-1]), axis=0, return_inverse=True)
    labels = index.reshape(shape)
    objects = [number for number, colour in enumerate(colours) if colour.any()]
    if not 0 < len(objects) <= MOST_OBJECTS:
        expected = f"1 to {MOST_OBJECTS} objects of one value each on black"
        hint = "save labels without soft edges, as PNG; a mask of one object is another key"
        raise InputError(str(path), expected, f"{len(objects)} values", hint)
    return tuple(labels == number for number in objects)
